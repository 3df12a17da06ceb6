#pragma once
// The one port: HTTP requests and WebSocket streams. The only room of the server that sees sockets; Boost.Beast stays in http.cpp
// and stream.cpp, OpenSSL in common/transport.
//
// Every connection has one strand; nothing of it runs twice at a time, and one writer sends its messages in order. Encoding and all work
// on meshes runs on the cameras' pools; the threads here only move bytes.
//
// Bounds, each followed by what happens beyond it:
//   connections        maxConnections          HTTP 503; where 32 are being told so, closed at once
//   of one address     maxConnectionsPerAddress      HTTP 429, or closed as above; a /64 of IPv6 is one address
//   request header     maxHeaderBytes          HTTP 431
//   TLS, request, hello   patience each        closed; a stream without hello is told why
//   client message     maxMessageBytes         Error, close 1009
//   messages a second  maxMessagesPerSecond, twice at once   Error, close 1008
//   token              until it expires        Error, close 1008
//   way out            kMaxQueuedMessages      closed (a session keeps to its window, so it does not happen)
//   silence            idle, pings at half     closed
//   work for answers   prompt-, patient-, worldJobs HTTP 503 with Retry-After; ends when the asker hangs up or half-closes
//   answers on the way maxAnswerBytes          HTTP 503 to who asks for patient work meanwhile
//   slow readers       patience, then 64 KiB/s closed
// A message that is none, or another protocol version: Error, close 1002 (text: 1003). A message out of place or of range that the session
// refuses: Error, close 1008. The process lives on.

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/wire/wire.h"
#include "server/access/network.h"
#include "server/http/gate.h"
#include "server/http/jobs.h"
#include "server/http/routes.h"
#include "server/session/session.h"

namespace ridgecast::net {

inline constexpr std::size_t kMaxQueuedMessages = 128;

struct Settings : http::Access {  // host: what it listens on
  std::uint16_t port = 7070;                       // 0: any free one
  bool allowInsecure = false;                      // listen on other than loopback addresses without TLS or without tokens
  std::filesystem::path tlsCertificate, tlsKey;    // PEM; both or none
  std::vector<access::Network> trustedProxies;
  unsigned threads = 2;
  std::uint32_t maxConnections = 512;
  std::uint32_t maxConnectionsPerAddress = 256;  // 0: no limit
  std::uint32_t maxHeaderBytes = 8192;
  std::size_t maxMessageBytes = wire::kMaxClientMessageBytes;
  std::uint32_t maxMessagesPerSecond = 4000;  // 0: no limit
  std::chrono::milliseconds patience{10'000};
  std::chrono::milliseconds idle{60'000};
  http::Jobs::Limits promptJobs{2, 64, 0};   // answers that take milliseconds
  http::Jobs::Limits patientJobs{1, 4, 15};  // answers that take seconds, as --snapshot-niceness says
  http::Jobs::Limits worldJobs{1, 8, 10};    // worlds that are compiled
  std::size_t maxAnswerBytes = std::size_t{1} << 30;
  std::chrono::milliseconds drain{5'000};
  std::string reconnectUrl;  // told to clients when the server leaves; empty: where they came from
};

class Server {
 public:
  // Listens and serves until destroyed. Errors, for people: the host is no address of this machine or not a loopback address, the port
  // is in use or not permitted.
  static Outcome<std::unique_ptr<Server>> listen(const Settings& settings, std::shared_ptr<session::Directory> directory,
                                                 std::vector<http::Route> routes = {});
  // Shuts down. The machine must be gone by then: first shutdown(), then the machine, then this, so that no task still sends.
  virtual ~Server() = default;
  // Any thread, all of these.
  // Not ready: /readyz says so, no stream is opened, those that are open are told to connect again. The port stays open.
  virtual void drain() = 0;
  virtual void undrain() = 0;
  // Reads certificate and tokens again, for connections to come. Error: what is wrong; then those there are stay.
  virtual std::optional<Error> reload() = 0;
  // As drain(), and accepts no more; waits for streams to end and for the answers that are worked at, at most settings.drain,
  // then serves no more.
  virtual void shutdown() = 0;
  virtual std::uint16_t port() const = 0;
  virtual std::string url() const = 0;  // http://ADDRESS:PORT
};

}  // namespace ridgecast::net
