#include "client/evaluation/flight_tables.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <utility>

namespace ridgecast::evaluation {
namespace {

using Flight = FlightResults;
using Flights = std::vector<const Flight*>;  // of one setting

// The values of all iterations that have one.
template <class Value>
std::vector<double> each(const Flight& f, const Value& value) {
  std::vector<double> out;
  for (const IterationResult& i : f.iterations)
    if (const auto v = static_cast<double>(value(i)); !std::isnan(v)) out.push_back(v);
  return out;
}

double sum(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }
double mean(const std::vector<double>& values) { return sum(values) / static_cast<double>(values.size()); }  // of none: kNothing

// The quantile of this part, 0..1.
double share(std::vector<double> values, double part) {
  if (values.empty()) return kNothing;
  std::ranges::sort(values);
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

double ofStages(const IterationResult& i) {
  double out = 0;
  for (const Stage& stage : kStages) out += stage.ms(i);
  return out;
}

// Seconds in which iterations ran.
double seconds(const Flight& f) { return static_cast<double>(f.summary.iterations) / f.summary.iterationsPerSecond; }

// The median of the repeats and half their range.
template <class Value>
std::string spread(const Flights& flights, const char* format, const Value& value) {
  std::vector<double> all;
  for (const Flight* f : flights)
    if (const double v = value(*f); std::isfinite(v)) all.push_back(v);
  if (all.empty()) return {};
  std::ranges::sort(all);
  std::string out = cell(format, all[all.size() / 2]);
  return all.back() > all.front() ? out.append(" ± ").append(cell(format, (all.back() - all.front()) / 2)) : out;
}

// The settings whose first flight is such a one.
template <class Judge>
std::vector<Flights> only(std::vector<Flights> settings, const Judge& judge) {
  std::erase_if(settings, [&](const Flights& f) { return !judge(*f.front()); });
  return settings;
}

struct Column {
  std::string title;
  const char* format;
  std::function<double(const Flight&)> value;
};

Table tableOf(const char* name, const char* title, const char* note, const std::vector<Flights>& settings,
              const std::vector<Column>& columns) {
  Table out{name, title, note, {"flight"}, {}};
  for (const Column& c : columns) out.header.push_back(c.title);
  for (const Flights& flights : settings) {
    std::vector<std::string> row{settingOf(flights.front()->run)};
    for (const Column& c : columns) row.push_back(spread(flights, c.format, c.value));
    out.rows.push_back(std::move(row));
  }
  return out;
}

#define RIDGECAST_SUMMARY(member) [](const Flight& f) { return static_cast<double>(f.summary.member); }
#define RIDGECAST_EACH(f, member) each(f, [](const IterationResult& i) { return i.member; })
#define RIDGECAST_SHARE(member, part) [](const Flight& f) { return share(RIDGECAST_EACH(f, member), part); }
#define RIDGECAST_MEAN(member) [](const Flight& f) { return mean(RIDGECAST_EACH(f, member)); }

Table likeness(const std::vector<Flights>& settings) {
  return tableOf(
      "flights", "Along the flights: likeness",
      "SSIM of the streamed mesh, as it is and corrected, against the converged ray march: during the flight, settled at its end.",
      settings,
      {{"pictures", "%.0f",
        [](const Flight& f) {
          const double n = static_cast<double>(f.summary.frames.count);  // repeats have none
          return n > 0 ? n : kNothing;
        }},
       {"SSIM mean", "%.4f", RIDGECAST_SUMMARY(mean.ssim)},
       {"corrected", "%.4f", RIDGECAST_SUMMARY(mean.corrected)},
       {"median", "%.4f", [](const Flight& f) { return median(f.summary.frames.ssim); }},
       {"least", "%.4f", RIDGECAST_SUMMARY(frames.least)},
       {"terrain alone", "%.4f", RIDGECAST_SUMMARY(mean.terrain)},
       {"unfiltered", "%.4f", RIDGECAST_SUMMARY(mean.unfiltered)},
       {"settled", "%.4f", RIDGECAST_SUMMARY(settled.ssim)},
       {"settled, corrected", "%.4f", RIDGECAST_SUMMARY(settled.corrected)},
       {"settled, terrain alone", "%.4f", RIDGECAST_SUMMARY(settled.terrain)},
       {"triangles settled", "%.0f", RIDGECAST_SUMMARY(triangles)},
       {"hashes that differed", "%.0f", RIDGECAST_SUMMARY(hashMismatches)}});
}

Table speed(const std::vector<Flights>& settings) {
  return tableOf(
      "rates", "Along the flights: rates",
      "Frames: each rendering drawn alone, medians. A place is ray-marched once for all flights over a terrain, so only CPU time compares "
      "the two. Iterations: lock-step, one pose each. Nodes are those that the server generated; each inserted vertex makes two triangles.",
      settings,
      {{"mesh frames/s", "%.2f", [](const Flight& f) { return 1e3 / f.summary.mesh.ms; }},
       {"corrected frames/s", "%.2f", [](const Flight& f) { return 1e3 / f.summary.corrected.ms; }},
       {"ray march frames/s", "%.3f", [](const Flight& f) { return 1e3 / f.summary.raymarch.ms; }},
       {"mesh faster by CPU time", "%.1f", [](const Flight& f) { return f.summary.raymarch.cpuMs / f.summary.mesh.cpuMs; }},
       {"iterations/s", "%.1f", RIDGECAST_SUMMARY(iterationsPerSecond)},
       {"nodes generated/s", "%.0f", [](const Flight& f) { return sum(RIDGECAST_EACH(f, figures.generatedLeaves)) / seconds(f); }},
       {"nodes in sight", "%.0f", RIDGECAST_MEAN(figures.visibleLeaves)},
       {"drawn/s", "%.0f", [](const Flight& f) { return mean(RIDGECAST_EACH(f, figures.visibleLeaves)) * 1e3 / f.summary.mesh.ms; }},
       {"vertices inserted/s", "%.0f", [](const Flight& f) { return sum(RIDGECAST_EACH(f, figures.inserted)) / seconds(f); }},
       {"removed/s", "%.0f", [](const Flight& f) { return sum(RIDGECAST_EACH(f, figures.removed)) / seconds(f); }},
       {"triangles held", "%.0f", RIDGECAST_MEAN(trianglesHeld)},
       {"triangles drawn/s, million", "%.2f",
        [](const Flight& f) { return mean(RIDGECAST_EACH(f, trianglesHeld)) / f.summary.mesh.ms / 1e3; }},
       {"machine taken by others", "%.0f %%", [](const Flight& f) { return 100 * f.others; }}});
}

Table stages(const std::vector<Flights>& settings) {
  std::vector<Column> columns;
  for (const Stage& stage : kStages)
    columns.push_back({stage.name, "%.2f", [&stage](const Flight& f) { return share(each(f, stage.ms), 0.5); }});
  for (const auto& [title, part] : {std::pair("all", 0.5), std::pair("p99", 0.99)})
    columns.push_back({title, "%.1f", [part = part](const Flight& f) { return share(each(f, ofStages), part); }});
  return tableOf(
      "stages", "Time of each stage",
      "Milliseconds of an iteration: medians, and the 99th percentile of the total. Apply is the client's decoding and applying.", settings,
      columns);
}

Table stream(const std::vector<Flights>& settings) {
  return tableOf("stream", "The stream",
                 "Latency from sending a pose to holding its mesh. Bytes a second: per second of wall time in which iterations ran.",
                 settings,
                 {{"megabytes", "%.2f", [](const Flight& f) { return static_cast<double>(f.summary.bytesReceived) / 1e6; }},
                  {"kB/s", "%.0f", [](const Flight& f) { return static_cast<double>(f.summary.bytesReceived) / seconds(f) / 1e3; }},
                  {"bytes an iteration", "%.0f", RIDGECAST_MEAN(bytes)},
                  {"latency ms, median", "%.1f", RIDGECAST_SHARE(latencyMs, 0.5)},
                  {"p99", "%.1f", RIDGECAST_SHARE(latencyMs, 0.99)},
                  {"worst", "%.1f", RIDGECAST_SUMMARY(latencyMsMax)},
                  {"settled after s", "%.2f", RIDGECAST_SUMMARY(settleSeconds)}});
}

Table threads(const std::vector<Flights>& settings) {
  const auto first = std::ranges::find_if(settings, [](const Flights& f) { return f.front()->run.threads > 0; });
  if (first == settings.end()) return {};
  std::vector<Flights> those;
  for (const Flights& f : settings) {
    const Run& run = f.front()->run;
    const Run& other = first->front()->run;
    const bool like = run.terrain == other.terrain && run.metric == other.metric && run.threshold == other.threshold;
    if (run.threads || (like && run.name.find("standing") == std::string::npos && run.name.find("frames") == std::string::npos))
      those.push_back(f);
  }
  return tableOf("threads", "Number of threads", "Default: every core of the server's machine.", those,
                 {{"iterations/s", "%.1f", RIDGECAST_SUMMARY(iterationsPerSecond)},
                  {"generate ms", "%.2f", RIDGECAST_SHARE(figures.generateMs, 0.5)},
                  {"refine ms", "%.2f", RIDGECAST_SHARE(figures.refineMs, 0.5)},
                  {"triangulate ms", "%.2f", RIDGECAST_SHARE(figures.triangulateMs, 0.5)},
                  {"encode ms", "%.2f", RIDGECAST_SHARE(figures.encodeMs, 0.5)},
                  {"latency ms, median", "%.1f", RIDGECAST_SHARE(latencyMs, 0.5)}});
}

// One frame an iteration, with its upload.
Table frames(const std::vector<Flights>& settings) {
  const auto those = only(settings, [](const Flight& f) { return !RIDGECAST_EACH(f, uploadMs).empty(); });
  static constexpr auto frame = [](const IterationResult& i) { return i.uploadMs + i.drawMs; };
  static constexpr auto uploaded = [](const IterationResult& i) { return i.uploadMs + i.applyMs; };
  // Frames above twice the median; `byUpload`: only those that are not without their upload.
  static constexpr auto slow = [](const Flight& f, bool byUpload) {
    const double most = 2 * share(each(f, frame), 0.5);
    return static_cast<double>(
        std::ranges::count_if(f.iterations, [&](const IterationResult& i) { return frame(i) > most && (!byUpload || i.drawMs <= most); }));
  };
  return tableOf("frames", "Frames along the flights, uploads included",
                 "One frame an iteration, at a quarter of the size. Message to uploaded: decoding, applying and uploading.", those,
                 {{"frames", "%.0f", [](const Flight& f) { return static_cast<double>(f.iterations.size()); }},
                  {"frame ms, median", "%.1f", [](const Flight& f) { return share(each(f, frame), 0.5); }},
                  {"p99", "%.1f", [](const Flight& f) { return share(each(f, frame), 0.99); }},
                  {"upload ms, median", "%.2f", RIDGECAST_SHARE(uploadMs, 0.5)},
                  {"p99", "%.2f", RIDGECAST_SHARE(uploadMs, 0.99)},
                  {"message to uploaded ms, p99", "%.2f", [](const Flight& f) { return share(each(f, uploaded), 0.99); }},
                  {"above 2 x the median", "%.0f", [](const Flight& f) { return slow(f, false); }},
                  {"because of uploads", "%.0f", [](const Flight& f) { return slow(f, true); }}});
}

Table popping(const std::vector<Flights>& settings) {
  const auto those = only(settings, [](const Flight& f) { return !std::isnan(f.summary.popping.off); });
  return tableOf("popping", "Popping",
                 "The largest change (1 - SSIM) between consecutive frames while the mesh of a camera at rest refines, 60 frames a second.",
                 those,
                 {{"morphing off", "%.4f", RIDGECAST_SUMMARY(popping.off)},
                  {"morphing on", "%.4f", RIDGECAST_SUMMARY(popping.on)},
                  {"of it left", "%.3f", [](const Flight& f) { return f.summary.popping.on / f.summary.popping.off; }}});
}

#undef RIDGECAST_SUMMARY
#undef RIDGECAST_EACH
#undef RIDGECAST_SHARE
#undef RIDGECAST_MEAN

}  // namespace

std::vector<Table> flightTables(const std::vector<Flight>& flights) {
  std::vector<Flights> settings;
  std::map<std::string, std::size_t> known;
  for (const Flight& flight : flights) {
    const auto [at, isNew] = known.try_emplace(settingOf(flight.run), settings.size());
    if (isNew) settings.emplace_back();
    settings[at->second].push_back(&flight);
  }
  std::vector<Table> out;
  // Flights without pictures have tables of their own.
  const auto pictured = only(settings, [](const Flight& f) { return f.summary.frames.count > 0; });
  for (Table& table : std::vector<Table>{likeness(pictured), speed(pictured), stages(pictured), threads(settings), stream(pictured),
                                         frames(settings), popping(settings)})
    if (!table.rows.empty()) out.push_back(std::move(table));
  return out;
}

}  // namespace ridgecast::evaluation
