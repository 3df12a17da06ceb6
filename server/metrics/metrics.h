#pragma once
// The server's own figures by name, as GET /metrics shows them. Rooms add to them where things happen.

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <filesystem>
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
  // A value that is computed when it is scraped, by whatever thread scrapes.
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

// What withholds detail from a camera: its budget of triangles, that of bytes, or want of processor (conversation/rate.h, InsertionRate).
enum class Withheld { kNone, kTriangles, kBytes, kProcessor };
inline constexpr std::array<std::string_view, 3> kWithheldNames{"triangles", "bytes", "processor"};  // without kNone

// Why an edit was refused: as editing::Edits::Answer::Why.
inline constexpr std::array<std::string_view, 5> kEditRefusals{"wrong", "early", "full", "over", "other"};

struct Metrics {
  Metrics();
  void refused(Refusal reason) { refusals[static_cast<std::size_t>(reason)]->Increment(); }
  void iterated(const settings::IterationStats& figures);  // one iteration, its encoding included

  Registry registry;  // first: the others are its
  Counter &iterations, &iterationsSent, &iterationsLate, &inserted, &removed, &heights;
  Histogram& delivery;                                   // from a pose's arrival to its first iteration's departure
  std::array<Histogram*, 5> stages{};                    // select, generate, refine, triangulate, encode
  Gauge& triangles;                                      // live, of all cameras
  std::array<Gauge*, kWithheldNames.size()> withheld{};  // cameras
  Counter &resends, &mismatches;                         // requests for leaves again; acknowledgements of another mesh
  Counter &bytesSent, &bytesReceived, &messagesReceived;
  Counter &connections, &tlsHandshakes, &streams;
  // From now on, how full the disk of this folder is; `of`: what lies there.
  void watchDisk(const std::string& of, const std::filesystem::path& folder);
  // An HTTP answer. `route`: of a fixed set.
  void answered(const std::string& route, unsigned status);
  // Work for HTTP answers, by queue: answers, snapshots, worlds.
  struct Work {
    Histogram &wait, &seconds;
  };
  Work work(const std::string& queue);
  Counter& editsMade;  // acknowledged; one repeated with its key counts again
  std::array<Counter*, kEditRefusals.size()> editRefusals{};
  Histogram& editCommit;   // of a group of edits
  Gauge& editLogsFailing;  // sessions
  Gauge& streamsOpen;
  std::array<Counter*, kRefusalNames.size()> refusals{};
};

}  // namespace ridgecast::metrics
