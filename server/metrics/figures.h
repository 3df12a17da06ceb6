#pragma once
// The server's own figures by name, as GET /metrics shows them. Rooms add to them where things happen.

#include <array>
#include <string_view>

#include "common/settings/settings.h"
#include "server/metrics/registry.h"

namespace ridgecast::metrics {

// Why somebody was refused or sent away.
enum class Refusal {
  kConnections,  // too many in all
  kAddress,      // too many from one address
  kHost,         // a name that may be another's for this machine
  kOrigin,
  kToken,    // none, or one that is not good
  kRight,    // a good one that lacks the right or the session
  kSession,  // no such session, or a name that is none
  kFull,     // cameras or members
  kHeader,
  kRequest,  // no HTTP, no such path, no such method
  kTls,
  kTimeout,
  kMessageSize,
  kMessageRate,
  kMalformed,
  kVersion,
  kInvalid,
  kLimit,
  kDraining,
  kExpired,
  kBusy,
  kInternal,
};
inline constexpr std::array<std::string_view, 22> kRefusalNames{
    "connections", "address", "host",     "origin",   "token",        "right",        "session",   "full",
    "header",      "request", "tls",      "patience", "message_size", "message_rate", "malformed", "version",
    "invalid",     "limit",   "draining", "expired",  "busy",         "internal"};

struct Figures {
  Figures();
  void refused(Refusal reason) { refusals[static_cast<std::size_t>(reason)]->Increment(); }
  void iterated(const settings::Figures& figures);  // one iteration, its encoding included

  Registry registry;  // first: the others are its
  Counter &iterations, &iterationsSent, &inserted, &removed, &heights;
  std::array<Histogram*, 5> stages{};  // select, generate, refine, triangulate, encode
  Gauge& triangles;                    // live, of all cameras
  Counter &bytesSent, &bytesReceived, &messagesReceived;
  Counter &connections, &tlsHandshakes, &requests, &streams;
  Gauge& streamsOpen;
  std::array<Counter*, kRefusalNames.size()> refusals{};
};

}  // namespace ridgecast::metrics
