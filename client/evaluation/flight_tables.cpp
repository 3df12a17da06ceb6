#include "client/evaluation/flight_tables.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <numeric>
#include <optional>
#include <sstream>

#include "client/evaluation/json_numbers.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;

struct Flight {
  const Run* run;
  Json summary;
  std::map<std::string, std::vector<double>> columns;  // of its iterations
  Json machine;                                        // what it did beside it
  double mean(const char* key) const {
    const auto it = columns.find(key);
    if (it == columns.end() || it->second.empty()) return kNothing;
    return std::accumulate(it->second.begin(), it->second.end(), 0.0) / static_cast<double>(it->second.size());
  }
  double sum(const char* key) const {
    const auto it = columns.find(key);
    return it == columns.end() ? 0 : std::accumulate(it->second.begin(), it->second.end(), 0.0);
  }
  double share(const char* key, double part) const {
    const auto it = columns.find(key);
    if (it == columns.end() || it->second.empty()) return kNothing;
    std::vector<double> sorted = it->second;
    std::ranges::sort(sorted);
    return sorted[static_cast<std::size_t>(part * static_cast<double>(sorted.size() - 1))];
  }
  // All stages of an iteration, milliseconds.
  double stages(double part) const {
    std::vector<double> sums;
    for (const char* key : {"select_ms", "generate_ms", "refine_ms", "triangulate_ms", "encode_ms", "apply_ms"}) {
      const auto it = columns.find(key);
      if (it == columns.end()) return kNothing;
      sums.resize(it->second.size());
      for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += it->second[k];
    }
    if (sums.empty()) return kNothing;
    std::ranges::sort(sums);
    return sums[static_cast<std::size_t>(part * static_cast<double>(sums.size() - 1))];
  }
  // Seconds in which iterations ran.
  double seconds() const { return number(summary, "iterations") / number(summary, "iterations_per_second"); }
};

using Flights = std::vector<const Flight*>;  // of one setting

std::string settingOf(const Run& run) { return run.name.substr(0, run.name.rfind("-r")); }

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

struct Column {
  std::string title;
  const char* format;
  double (*value)(const Flight&);
};

Table tableOf(const char* name, const char* title, const char* note, const std::vector<Flights>& settings,
              const std::vector<Column>& columns) {
  Table out{name, title, note, {"flight"}, {}};
  for (const Column& c : columns) out.header.push_back(c.title);
  for (const Flights& flights : settings) {
    std::vector<std::string> row{settingOf(*flights.front()->run)};
    for (const Column& c : columns) row.push_back(spread(flights, c.format, c.value));
    out.rows.push_back(std::move(row));
  }
  return out;
}

#define RIDGECAST_MEDIAN(key) [](const Flight& f) { return f.share(key, 0.5); }
#define RIDGECAST_SUMMARY(key) [](const Flight& f) { return number(f.summary, key); }
#define RIDGECAST_MEAN(key) [](const Flight& f) { return f.mean(key); }

Table likeness(const std::vector<Flights>& settings) {
  return tableOf("flights", "Along the flights: likeness",
                 "SSIM of the streamed mesh against the converged ray march of the same camera, as it was held at that moment, and at the "
                 "end, settled.",
                 settings,
                 {{"pictures", "%.0f",
                   [](const Flight& f) {
                     const double n = number(f.summary, "frames");  // repeats have none
                     return n > 0 ? n : kNothing;
                   }},
                  {"SSIM mean", "%.4f", RIDGECAST_SUMMARY("ssim_mean")},
                  {"median", "%.4f",
                   [](const Flight& f) {
                     auto all = f.summary.value("ssim_frames", std::vector<double>());
                     std::ranges::sort(all);
                     return all.empty() ? kNothing : all[all.size() / 2];
                   }},
                  {"least", "%.4f", RIDGECAST_SUMMARY("ssim_min")},
                  {"terrain alone", "%.4f", RIDGECAST_SUMMARY("ssim_mean_terrain")},
                  {"unfiltered", "%.4f", RIDGECAST_SUMMARY("ssim_mean_unfiltered")},
                  {"corrected", "%.4f", RIDGECAST_SUMMARY("ssim_mean_corrected")},
                  {"settled", "%.4f", RIDGECAST_SUMMARY("ssim_settled")},
                  {"settled, terrain alone", "%.4f", RIDGECAST_SUMMARY("ssim_settled_terrain")},
                  {"triangles settled", "%.0f", RIDGECAST_SUMMARY("triangles")},
                  {"hashes that differed", "%.0f", RIDGECAST_SUMMARY("hash_mismatches")}});
}

Table speed(const std::vector<Flights>& settings) {
  return tableOf(
      "rates", "Along the flights: what happens a second",
      "Frames as both renderings draw them alone, medians; each place is ray-marched once for all flights over a terrain, so that only the "
      "processors' time compares the two here. Iterations in lock-step, one pose each; nodes that the server generated "
      "and vertices that it inserted, each of which makes two triangles.",
      settings,
      {{"mesh frames/s", "%.2f", [](const Flight& f) { return 1e3 / number(f.summary, "mesh_frame_ms"); }},
       {"corrected frames/s", "%.2f", [](const Flight& f) { return 1e3 / number(f.summary, "corrected_frame_ms"); }},
       {"ray march frames/s", "%.3f", [](const Flight& f) { return 1e3 / number(f.summary, "raymarch_frame_ms"); }},
       {"mesh faster by CPU time", "%.1f",
        [](const Flight& f) { return number(f.summary, "raymarch_frame_cpu_ms") / number(f.summary, "mesh_frame_cpu_ms"); }},
       {"iterations/s", "%.1f", RIDGECAST_SUMMARY("iterations_per_second")},
       {"nodes generated/s", "%.0f", [](const Flight& f) { return f.sum("leaves_generated") / f.seconds(); }},
       {"nodes in sight", "%.0f", RIDGECAST_MEAN("leaves_visible")},
       {"drawn/s", "%.0f", [](const Flight& f) { return f.mean("leaves_visible") * 1e3 / number(f.summary, "mesh_frame_ms"); }},
       {"vertices inserted/s", "%.0f", [](const Flight& f) { return f.sum("inserted") / f.seconds(); }},
       {"removed/s", "%.0f", [](const Flight& f) { return f.sum("removed") / f.seconds(); }},
       {"triangles held", "%.0f", RIDGECAST_MEAN("triangles_held")},
       {"triangles drawn/s, million", "%.2f",
        [](const Flight& f) { return f.mean("triangles_held") / number(f.summary, "mesh_frame_ms") / 1e3; }},
       {"machine taken by others", "%.0f %%", [](const Flight& f) { return 100 * number(f.machine, "others"); }}});
}

Table stages(const std::vector<Flights>& settings) {
  return tableOf(
      "stages", "Time of each stage",
      "Milliseconds of an iteration, medians, and the 99th percentile of the whole of it; apply is the client's decoding and applying.",
      settings,
      {{"select", "%.2f", RIDGECAST_MEDIAN("select_ms")},
       {"generate", "%.2f", RIDGECAST_MEDIAN("generate_ms")},
       {"refine", "%.2f", RIDGECAST_MEDIAN("refine_ms")},
       {"triangulate", "%.2f", RIDGECAST_MEDIAN("triangulate_ms")},
       {"encode", "%.2f", RIDGECAST_MEDIAN("encode_ms")},
       {"apply", "%.2f", RIDGECAST_MEDIAN("apply_ms")},
       {"all", "%.1f", [](const Flight& f) { return f.stages(0.5); }},
       {"p99", "%.1f", [](const Flight& f) { return f.stages(0.99); }}});
}

Table stream(const std::vector<Flights>& settings) {
  return tableOf("stream", "The stream",
                 "Latency from sending a pose to having its mesh. Bytes a second of wall time in which iterations ran.", settings,
                 {{"megabytes", "%.2f", [](const Flight& f) { return number(f.summary, "bytes_received") / 1e6; }},
                  {"kB/s", "%.0f", [](const Flight& f) { return number(f.summary, "bytes_received") / f.seconds() / 1e3; }},
                  {"bytes an iteration", "%.0f", RIDGECAST_MEAN("bytes")},
                  {"latency ms, median", "%.1f", [](const Flight& f) { return f.share("latency_ms", 0.5); }},
                  {"p99", "%.1f", [](const Flight& f) { return f.share("latency_ms", 0.99); }},
                  {"worst", "%.1f", RIDGECAST_SUMMARY("latency_ms_max")},
                  {"settled after s", "%.2f", RIDGECAST_SUMMARY("settle_seconds")}});
}

Table threads(const std::vector<Flights>& settings) {
  std::vector<Flights> those;
  const auto first = std::ranges::find_if(settings, [](const Flights& f) { return f.front()->run->threads > 0; });
  for (const Flights& f : settings) {
    const Run& run = *f.front()->run;
    const bool like = first != settings.end() && run.terrain == first->front()->run->terrain && run.metric == first->front()->run->metric &&
                      run.threshold == first->front()->run->threshold;
    if (run.threads || (like && run.name.find("standing") == std::string::npos && run.name.find("frames") == std::string::npos))
      those.push_back(f);
  }
  if (first == settings.end()) those.clear();
  return tableOf("threads", "Influence of the number of threads", "Flights without a number use every core of the server's machine.", those,
                 {{"iterations/s", "%.1f", RIDGECAST_SUMMARY("iterations_per_second")},
                  {"generate ms", "%.2f", RIDGECAST_MEDIAN("generate_ms")},
                  {"refine ms", "%.2f", RIDGECAST_MEDIAN("refine_ms")},
                  {"triangulate ms", "%.2f", RIDGECAST_MEDIAN("triangulate_ms")},
                  {"encode ms", "%.2f", RIDGECAST_MEDIAN("encode_ms")},
                  {"latency ms, median", "%.1f", [](const Flight& f) { return f.share("latency_ms", 0.5); }}});
}

// Every iteration a frame: what the uploads do to it.
Table frames(const std::vector<Flights>& settings) {
  std::vector<Flights> those;
  for (const Flights& f : settings)
    if (f.front()->columns.contains("upload_ms")) those.push_back(f);
  static const auto frame = [](const Flight& f, std::size_t k) { return f.columns.at("upload_ms")[k] + f.columns.at("draw_ms")[k]; };
  static const auto median = [](const Flight& f) {
    std::vector<double> all;
    for (std::size_t k = 0; k < f.columns.at("upload_ms").size(); ++k) all.push_back(frame(f, k));
    std::ranges::nth_element(all, all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2));
    return all[all.size() / 2];
  };
  // Frames above twice the median; and those of them that would not be without their upload.
  static const auto slow = [](const Flight& f, bool byUpload) {
    const double most = 2 * median(f);
    double n = 0;
    for (std::size_t k = 0; k < f.columns.at("upload_ms").size(); ++k)
      n += frame(f, k) > most && (!byUpload || f.columns.at("draw_ms")[k] <= most);
    return n;
  };
  return tableOf(
      "frames", "Frames along the flights, uploads included",
      "One frame an iteration, at a quarter of the size. Message to uploaded: decoding, applying and bringing it to the graphics card.",
      those,
      {{"frames", "%.0f", [](const Flight& f) { return static_cast<double>(f.columns.at("upload_ms").size()); }},
       {"frame ms, median", "%.1f", median},
       {"p99", "%.1f",
        [](const Flight& f) {
          std::vector<double> all;
          for (std::size_t k = 0; k < f.columns.at("upload_ms").size(); ++k) all.push_back(frame(f, k));
          std::ranges::sort(all);
          return all[static_cast<std::size_t>(0.99 * static_cast<double>(all.size() - 1))];
        }},
       {"upload ms, median", "%.2f", [](const Flight& f) { return f.share("upload_ms", 0.5); }},
       {"p99", "%.2f", [](const Flight& f) { return f.share("upload_ms", 0.99); }},
       {"message to uploaded ms, p99", "%.2f",
        [](const Flight& f) {
          std::vector<double> all;
          for (std::size_t k = 0; k < f.columns.at("upload_ms").size(); ++k)
            all.push_back(f.columns.at("upload_ms")[k] + f.columns.at("apply_ms")[k]);
          std::ranges::sort(all);
          return all[static_cast<std::size_t>(0.99 * static_cast<double>(all.size() - 1))];
        }},
       {"above 2 x the median", "%.0f", [](const Flight& f) { return slow(f, false); }},
       {"because of uploads", "%.0f", [](const Flight& f) { return slow(f, true); }}});
}

Table popping(const std::vector<Flights>& settings) {
  std::vector<Flights> those;
  for (const Flights& f : settings)
    if (f.front()->summary.contains("popping_off")) those.push_back(f);
  return tableOf(
      "popping", "Popping",
      "The largest change between consecutive frames, 1 - SSIM, of a camera that stands still while the mesh refines, 60 frames a second.",
      those,
      {{"morphing off", "%.4f", RIDGECAST_SUMMARY("popping_off")},
       {"morphing on", "%.4f", RIDGECAST_SUMMARY("popping_on")},
       {"of it left", "%.3f", [](const Flight& f) { return number(f.summary, "popping_on") / number(f.summary, "popping_off"); }}});
}

#undef RIDGECAST_SUMMARY
#undef RIDGECAST_MEAN

}  // namespace

Outcome<std::vector<Table>> flightTables(const std::vector<Run>& runs) {
  std::vector<Flight> flights;
  for (const Run& run : runs) {
    Flight flight{&run, {}, {}, {}};
    if (std::ifstream beside(run.folder / "machine.json"); beside) flight.machine = Json::parse(beside, nullptr, false);
    std::ifstream in(run.folder / "summary.json");
    std::ostringstream text;
    text << in.rdbuf();
    flight.summary = Json::parse(text.str(), nullptr, false);
    if (!flight.summary.is_object())
      return Error{(run.folder / "summary.json").string() + " is broken: remove the folder, and it is flown again"};
    std::ifstream lines(run.folder / "iterations.jsonl");
    for (std::string line; std::getline(lines, line);) {
      const Json one = Json::parse(line, nullptr, false);
      if (!one.is_object()) continue;
      for (const auto& [key, value] : one.items())
        if (value.is_number()) flight.columns[key].push_back(value.get<double>());
    }
    flights.push_back(std::move(flight));
  }
  std::vector<Flights> settings;
  std::map<std::string, std::size_t> known;
  for (const Flight& flight : flights) {
    const auto [at, isNew] = known.try_emplace(settingOf(*flight.run), settings.size());
    if (isNew) settings.emplace_back();
    settings[at->second].push_back(&flight);
  }
  std::vector<Table> out;
  // The others are there for tables of their own.
  std::vector<Flights> pictured;
  for (const Flights& f : settings)
    if (number(f.front()->summary, "frames") > 0) pictured.push_back(f);
  for (Table& table : std::vector<Table>{likeness(pictured), speed(pictured), stages(pictured), threads(settings), stream(pictured),
                                         frames(settings), popping(settings)})
    if (!table.rows.empty()) out.push_back(std::move(table));
  return out;
}

}  // namespace ridgecast::evaluation
