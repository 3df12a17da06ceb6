#pragma once
// The server's own figures by name, as GET /metrics shows them. Rooms add to them where things happen.

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "common/settings/settings.h"

namespace ridgecast::metrics {

using prometheus::Counter, prometheus::Gauge, prometheus::Histogram, prometheus::Labels;

// Metrics that Prometheus scrapes, by prometheus-cpp, and their text (exposition format 0.0.4). Made once, at the start; any thread may
// change them. A metric lives as long as its registry.
class Registry {
 public:
  Counter& counter(const std::string& name, const std::string& help, const Labels& labels = {});
  Gauge& gauge(const std::string& name, const std::string& help, const Labels& labels = {});
  // `bounds` ascend.
  Histogram& histogram(const std::string& name, const std::string& help, const std::vector<double>& bounds, const Labels& labels = {});
  // A value that is computed when it is scraped, by whatever thread scrapes. Values of one name must be added one after another.
  void compute(const std::string& name, const std::string& help, std::function<double()> value, const Labels& labels = {},
               bool counts = false);

  std::string text() const;

 private:
  struct Computed {
    std::string name, help;
    std::vector<prometheus::ClientMetric::Label> labels;
    bool counts;
    std::function<double()> value;
  };
  prometheus::Registry registry_;
  mutable std::mutex mutex_;
  std::vector<Computed> computed_;
};

// Why somebody was refused or sent away.
enum class Refusal {
  kConnections,  // too many in all
  kAddress,      // too many from one address
  kHost,         // a name that may be another's for this machine
  kOrigin,
  kToken,    // none, or an invalid one
  kRight,    // a valid one that lacks the right or the session
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
  kRemoved,  // by an operator
  kInternal,
};
inline constexpr std::array<std::string_view, 23> kRefusalNames{
    "connections", "address", "host",     "origin",   "token",        "right",        "session",   "full",
    "header",      "request", "tls",      "patience", "message_size", "message_rate", "malformed", "version",
    "invalid",     "limit",   "draining", "expired",  "busy",         "removed",      "internal"};

constexpr std::string_view name(Refusal reason) { return kRefusalNames[static_cast<std::size_t>(reason)]; }

struct Metrics {
  Metrics();
  void refused(Refusal reason) { refusals[static_cast<std::size_t>(reason)]->Increment(); }
  void iterated(const settings::IterationStats& figures);  // one iteration, its encoding included

  Registry registry;  // first: the others are its
  Counter &iterations, &iterationsSent, &iterationsLate, &inserted, &removed, &heights;
  Histogram& delivery;                 // from a pose's arrival to its first iteration's departure
  std::array<Histogram*, 5> stages{};  // select, generate, refine, triangulate, encode
  Gauge& triangles;                    // live, of all cameras
  Gauge& withheld;                     // cameras from which a budget or a busy machine withholds detail
  Counter &resends, &mismatches;       // requests for leaves again; acknowledgements of another mesh
  Counter &bytesSent, &bytesReceived, &messagesReceived;
  Counter &connections, &tlsHandshakes, &streams;
  // An HTTP answer. `route`: of a fixed set.
  void answered(const std::string& route, unsigned status);
  // Work for HTTP answers, by queue: answers, snapshots, worlds.
  struct Work {
    Histogram &wait, &seconds;
  };
  Work work(const std::string& queue);
  Gauge& streamsOpen;
  std::array<Counter*, kRefusalNames.size()> refusals{};
};

}  // namespace ridgecast::metrics
