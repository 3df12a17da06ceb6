#include "server/metrics/metrics.h"

#include <prometheus/text_serializer.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <system_error>

#include "common/outcome/contract.h"

namespace ridgecast::metrics {

namespace {

double residentBytes() {
  std::ifstream in("/proc/self/statm");
  double size = 0, resident = 0;
  in >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double processorSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

double openFiles() {
  std::error_code failed;
  const std::filesystem::directory_iterator files("/proc/self/fd", failed), end;
  return failed ? 0 : static_cast<double>(std::distance(files, end)) - 1;  // without the one that lists them
}

double maxFiles() {
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  return static_cast<double>(limit.rlim_cur);
}

const std::vector<double> kCommits{0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10};
const std::vector<double> kStageSeconds{0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5};
const std::vector<double> kDeliveries{0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 5};
const std::vector<double> kWork{0.001, 0.01, 0.1, 0.5, 1, 2, 5, 10, 20, 60, 120};

constexpr std::array<std::string_view, 5> kStages{"select", "generate", "refine", "triangulate", "encode"};

}  // namespace

Counter& Registry::counter(const std::string& name, const std::string& help, const Labels& labels) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry_).Add(labels);
}

Gauge& Registry::gauge(const std::string& name, const std::string& help, const Labels& labels) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(registry_).Add(labels);
}

Histogram& Registry::histogram(const std::string& name, const std::string& help, const std::vector<double>& bounds, const Labels& labels) {
  expects(std::ranges::is_sorted(bounds), "the bounds of a histogram ascend");
  return prometheus::BuildHistogram().Name(name).Help(help).Register(registry_).Add(labels, bounds);
}

void Registry::compute(const std::string& name, const std::string& help, std::function<double()> value, const Labels& labels, bool counts) {
  Computed computed{name, help, {}, counts, std::move(value)};
  for (const auto& [key, text] : labels) computed.labels.push_back({key, text});
  const std::lock_guard lock(mutex_);
  computed_.push_back(std::move(computed));
}

std::string Registry::text() const {
  auto families = registry_.Collect();
  const std::lock_guard lock(mutex_);
  for (const Computed& computed : computed_) {
    auto family = std::ranges::find(families, computed.name, &prometheus::MetricFamily::name);
    if (family == families.end())
      family = families.insert(
          family, {computed.name, computed.help, computed.counts ? prometheus::MetricType::Counter : prometheus::MetricType::Gauge, {}});
    auto& metric = family->metric.emplace_back();
    metric.label = computed.labels;
    (computed.counts ? metric.counter.value : metric.gauge.value) = computed.value();
  }
  return prometheus::TextSerializer().Serialize(families);
}

Metrics::Metrics()
    : iterations(registry.counter("ridgecast_iterations_total", "Iterations of all cameras.")),
      iterationsSent(registry.counter("ridgecast_iterations_sent_total", "Iterations that were sent to a client.")),
      iterationsLate(registry.counter("ridgecast_iterations_late_total", "Iterations sent when a newer pose had come already.")),
      inserted(registry.counter("ridgecast_vertices_inserted_total", "Vertices inserted into meshes.")),
      removed(registry.counter("ridgecast_vertices_removed_total", "Vertices removed from meshes.")),
      heights(registry.counter("ridgecast_heights_total", "Heights evaluated by iterations.")),
      delivery(registry.histogram("ridgecast_delivery_seconds", "From a pose's arrival until its first iteration has left.", kDeliveries)),
      triangles(registry.gauge("ridgecast_triangles", "Live triangles of all cameras' meshes.")),
      resends(registry.counter("ridgecast_resend_requests_total", "Requests for leaves to be sent again.")),
      mismatches(registry.counter("ridgecast_hash_mismatches_total", "Acknowledgements of a mesh other than the one sent.")),
      bytesSent(registry.counter("ridgecast_sent_bytes_total", "Bytes of messages and answers sent.")),
      bytesReceived(registry.counter("ridgecast_received_bytes_total", "Bytes of messages received.")),
      messagesReceived(registry.counter("ridgecast_received_messages_total", "Messages received.")),
      connections(registry.counter("ridgecast_connections_total", "Connections accepted.")),
      tlsHandshakes(registry.counter("ridgecast_tls_handshakes_total", "TLS handshakes completed.")),
      streams(registry.counter("ridgecast_streams_total", "Streams opened.")),
      editsMade(registry.counter("ridgecast_edits_total", "Edits acknowledged.")),
      editCommit(registry.histogram("ridgecast_edit_commit_seconds", "How long a group of edits took to be stored.", kCommits)),
      editLogsFailing(registry.gauge("ridgecast_edit_logs_failing", "Sessions whose edits could not be stored when last tried.")),
      streamsOpen(registry.gauge("ridgecast_streams", "Streams that are open.")) {
  for (std::size_t k = 0; k < stages.size(); ++k)
    stages[k] = &registry.histogram("ridgecast_stage_seconds", "Seconds that each stage of an iteration took.", kStageSeconds,
                                    {{"stage", std::string(kStages[k])}});
  for (std::size_t k = 0; k < withheld.size(); ++k)
    withheld[k] = &registry.gauge("ridgecast_cameras_withheld",
                                  "Cameras from which detail is withheld, by what is short: triangles or bytes that they may have, or "
                                  "processor.",
                                  {{"short", std::string(kWithheldNames[k])}});
  for (std::size_t k = 0; k < editRefusals.size(); ++k)
    editRefusals[k] = &registry.counter("ridgecast_edit_refusals_total",
                                        "Edits refused: wrong, too early after others, no room for them, or their session is over.",
                                        {{"reason", std::string(kEditRefusals[k])}});
  for (std::size_t k = 0; k < refusals.size(); ++k)
    refusals[k] = &registry.counter("ridgecast_refusals_total", "Connections, requests and streams refused or sent away, by reason.",
                                    {{"reason", std::string(kRefusalNames[k])}});
  registry.compute("process_resident_memory_bytes", "Memory of this process.", residentBytes);
  registry.compute("process_cpu_seconds_total", "Processor time of this process.", processorSeconds, {}, true);
  registry.compute("process_open_fds", "Files and sockets that this process has open.", openFiles);
  registry.compute("process_max_fds", "The most that it may have open.", maxFiles);
  registry.compute("process_start_time_seconds", "When this process began, seconds since 1970.",
                   [now = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count()] { return now; });
}

void Metrics::watchDisk(const std::string& of, const std::filesystem::path& folder) {
  const auto compute = [&](const char* name, const char* help, std::uintmax_t std::filesystem::space_info::*part) {
    registry.compute(name, help,
                     [folder, part]() -> double {
                       std::error_code failed;
                       const auto found = std::filesystem::space(folder, failed);
                       return failed ? std::numeric_limits<double>::quiet_NaN() : static_cast<double>(found.*part);
                     },
                     {{"of", of}});
  };
  compute("ridgecast_disk_bytes", "The disk of these files.", &std::filesystem::space_info::capacity);
  compute("ridgecast_disk_free_bytes", "What this process may still write there.", &std::filesystem::space_info::available);
}

void Metrics::answered(const std::string& route, unsigned status) {
  registry.counter("ridgecast_http_requests_total", "HTTP requests answered.", {{"route", route}, {"status", std::to_string(status)}})
      .Increment();
}

Metrics::Work Metrics::work(const std::string& queue) {
  return {
      registry.histogram("ridgecast_queue_wait_seconds", "How long work for HTTP answers waited for a thread.", kWork, {{"queue", queue}}),
      registry.histogram("ridgecast_work_seconds", "How long it then took.", kWork, {{"queue", queue}})};
}

void Metrics::iterated(const settings::IterationStats& f) {
  iterations.Increment();
  inserted.Increment(f.inserted);
  removed.Increment(f.removed);
  heights.Increment(f.heights);
  const double milliseconds[] = {f.selectMs, f.generateMs, f.refineMs, f.triangulateMs, f.encodeMs};
  for (std::size_t k = 0; k < stages.size(); ++k) stages[k]->Observe(milliseconds[k] / 1000);
}

}  // namespace ridgecast::metrics
