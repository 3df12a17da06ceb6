#pragma once
// The port for HTTP requests and WebSocket streams, and the admin port, if any. The only room of the server that sees sockets; Boost.Beast
// stays in fetch.cpp, http.cpp and stream.cpp, OpenSSL in common/transport.
//
// Each connection has one strand: its handlers never run concurrently, and one writer sends its messages in order. Encoding and all work on
// meshes runs on the cameras' pools; the threads here only move bytes.
//
//   limit of               by                         beyond it
//   connections            maxConnections             HTTP 503; closed at once while 32 are getting this answer
//   of one address         maxConnectionsPerAddress   HTTP 429, or closed as above; a /64 of IPv6 is one address
//   of the admin port      64                         closed
//   request header         maxHeaderBytes             HTTP 431
//   TLS, request, hello    timeout each              closed; for hello with an error
//   client message         maxMessageBytes            Error, close 1009
//   messages a second      maxMessagesPerSecond       the next is read later; of pings and pongs: Error, close 1008
//   bytes of messages      session::kMessageBytesPerSecond, of a client   the next is read once those are paid for
//   token                  its expiry, or a reload    Error, close 1008
//   queued messages        kMaxQueuedMessages         closed (does not happen: a session keeps to its window)
//   silence                idle, ping at half         closed
//   work for answers       prompt-, tile-, patient-, worldJobs   HTTP 503 with Retry-After; ends if the client hangs up or half-closes
//   of one client          Jobs::share               HTTP 429 with Retry-After
//   unsent answers         maxAnswerBytes             HTTP 503 for patient work
//   slow readers           timeout, then 64 KiB/s    closed
// An invalid message or another protocol version: Error, close 1002 (text: 1003). A message that the session refuses (out of place or
// range): Error, close 1008. The process continues.

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
#include "server/directory/directory.h"
#include "server/http/jobs.h"
#include "server/http/request_filter.h"
#include "server/http/routes.h"
#include "server/session/session.h"

namespace ridgecast::net {

inline constexpr std::size_t kMaxQueuedMessages = 128;
// After a signal the program ends within drainDelay, drain and this: what its manager must wait before it kills it.
inline constexpr std::chrono::seconds kAfterDrain{15};

struct Settings : http::Access {                 // host: the address to listen on
  std::uint16_t port = 7070;                     // 0: any free one
  std::uint16_t adminPort = 0;                   // of /healthz, /readyz, /metrics and /version, plain and without tokens; 0: none
  std::string adminHost;                         // empty: host
  bool allowInsecure = false;                    // permits other than loopback addresses without TLS or without tokens
  std::filesystem::path tlsCertificate, tlsKey;  // PEM; both or none
  std::vector<access::Network> trustedProxies;
  unsigned threads = 2;
  std::uint32_t maxConnections = 512;
  std::uint32_t maxConnectionsPerAddress = 256;  // 0: unlimited
  std::uint32_t maxHeaderBytes = 8192;
  std::size_t maxMessageBytes = wire::kMaxClientMessageBytes;
  std::uint32_t maxMessagesPerSecond = 4000;  // 0: unlimited
  std::chrono::milliseconds timeout{10'000};
  std::chrono::milliseconds idle{60'000};
  http::Jobs::Limits promptJobs{2, 512};   // answers that take milliseconds
  http::Jobs::Limits tileJobs{1, 128};     // 3D and map tiles: some 50 ms each, many at a time
  http::Jobs::Limits patientJobs{1, 4};    // answers that take seconds
  http::Jobs::Limits worldJobs{1, 8, 10};  // compilation of worlds
  std::size_t maxAnswerBytes = std::size_t{1} << 30;
  std::chrono::milliseconds drainDelay{0};  // between /readyz's 503 and the drain at shutdown: balancers lag
  std::chrono::milliseconds drain{5'000};
  std::string url;           // of this server alone, for people and other servers; empty: that of the port
  std::string reconnectUrl;  // sent to clients when the server leaves; empty: the same address
};

class Server {
 public:
  // Listens and serves until destroyed. Errors, for people: the host is not an address of this machine or not loopback; the port is in use
  // or not permitted.
  static Outcome<std::unique_ptr<Server>> listen(const Settings& settings, std::shared_ptr<directory::Directory> directory,
                                                 std::vector<http::Route> routes = {});
  // Shuts down. Order: shutdown(), then destroy the executor, then this, so that no task still sends.
  virtual ~Server() = default;
  // All from any thread.
  // Stops accepting streams: /readyz answers 503, open streams are told to reconnect. The port stays open.
  virtual void drain() = 0;
  virtual void undrain() = 0;
  // Tells the streams of a session that has a successor (Directory::replace) to connect again.
  virtual void sendAway(const session::Session& session) = 0;
  // Reloads certificate and tokens: the certificate for new connections, the tokens for open streams too. On an error, which is returned,
  // both stay as they were.
  virtual std::optional<Error> reload() = 0;
  // /readyz answers 503 from now on. After settings.drainDelay drain(); then waits for streams and answers in progress to end, up to
  // settings.drain. Accepts connections until the end.
  virtual void shutdown() = 0;
  virtual std::uint16_t port() const = 0;
  virtual std::string url() const = 0;       // http://ADDRESS:PORT
  virtual std::string adminUrl() const = 0;  // likewise; empty: none
};

}  // namespace ridgecast::net
