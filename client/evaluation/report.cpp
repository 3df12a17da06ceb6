#include "client/evaluation/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "client/evaluation/flight_tables.h"
#include "client/evaluation/plots.h"
#include "client/evaluation/table.h"
#include "client/evaluation/targets.h"
#include "client/evaluation/view_tables.h"
#include "client/render/picture.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;

// Of summary.json, for runs.csv.
constexpr std::array<const char*, 30> kColumns = {"frames",
                                                  "ssim_mean",
                                                  "ssim_min",
                                                  "ssim_mean_terrain",
                                                  "ssim_mean_unfiltered",
                                                  "ssim_mean_corrected",
                                                  "ssim_settled",
                                                  "ssim_settled_terrain",
                                                  "ssim_settled_unfiltered",
                                                  "ssim_settled_corrected",
                                                  "triangles",
                                                  "leaves",
                                                  "iterations",
                                                  "iterations_per_second",
                                                  "mesh_frame_ms",
                                                  "mesh_frame_cpu_ms",
                                                  "corrected_frame_cpu_ms",
                                                  "raymarch_frame_cpu_ms",
                                                  "corrected_frame_ms",
                                                  "raymarch_frame_ms",
                                                  "bytes_received",
                                                  "latency_ms_mean",
                                                  "latency_ms_max",
                                                  "settle_seconds",
                                                  "hash_mismatches",
                                                  "popping_off",
                                                  "popping_on",
                                                  "samples",
                                                  "width",
                                                  "height"};

std::optional<double> value(const Json& summary, const char* key) {
  const auto it = summary.find(key);
  if (it == summary.end() || !it->is_number()) return std::nullopt;
  return it->get<double>();
}

std::string slurp(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

std::string base64(const std::string& bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    const auto at = [&](std::size_t i) { return i < bytes.size() ? static_cast<unsigned>(static_cast<unsigned char>(bytes[i])) : 0u; };
    const unsigned v = at(k) << 16 | at(k + 1) << 8 | at(k + 2);
    for (int d = 0; d < 4; ++d) out += static_cast<std::size_t>(d) <= bytes.size() - k ? kDigits[v >> (18 - 6 * d) & 63] : '=';
  }
  return out;
}

// A picture of at most 640 pixels across, for the page; empty when there is none.
std::string figure(const std::filesystem::path& file, const std::string& caption) {
  auto picture = render::readPng(file);
  if (!picture) return {};
  picture->terrain.assign(std::size_t{picture->width} * picture->height, 255);
  std::uint32_t n = 1;
  while (picture->width / n > 640 && picture->width % (2 * n) == 0 && picture->height % (2 * n) == 0) n *= 2;
  return "<figure><img alt=\"" + escapedHtml(caption) + "\" src=\"data:image/jpeg;base64," +
         base64(render::encodeJpeg(render::downsample(*picture, n), 88)) + "\"><figcaption>" + escapedHtml(caption) +
         "</figcaption></figure>\n";
}

// The picture of a flight that is least like the ray march, beside it.
std::string leastLike(const Run& run, const Json& summary) {
  if (!summary.contains("frames_names") || summary.at("frames_names").empty()) return {};
  const std::vector<double> likeness = summary.at("ssim_frames").get<std::vector<double>>();
  const auto k = static_cast<std::size_t>(std::ranges::min_element(likeness) - likeness.begin());
  const std::string name = summary.at("frames_names").at(k).get<std::string>();
  const std::string where = run.terrain + ", " + run.metric + " " + cell("%g", run.threshold) + ", after " +
                            cell("%.1f", summary.at("frames_t").at(k).get<double>()) + " s: ";
  return figure(run.folder / (name + "-mesh.png"), where + "mesh, SSIM " + cell("%.3f", likeness[k])) +
         figure(run.folder / (name + "-raymarch.png"), where + "ray march");
}

std::string html(const Table& targets, const std::vector<Run>& runs, const std::vector<Json>& summaries,
                 const std::vector<std::filesystem::path>& views, const std::vector<Table>& viewTables,
                 const std::vector<Table>& flightTables, const std::vector<Plot>& drawn, const std::string& machine) {
  std::ostringstream out;
  out << "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" "
         "content=\"width=device-width\"><title>Ridgecast: mesh against ray "
         "march</title><style>body{font:15px/1.45 sans-serif;max-width:1240px;margin:2em auto;padding:0 "
         "1em;color:#222}table{border-collapse:collapse;font-size:13px}"
         "td,th{border:1px solid #ccc;padding:3px "
         "7px;text-align:right}th{background:#f3f3f3;vertical-align:bottom}td:first-child,th:first-child{text-align:left;white-space:"
         "nowrap}"
         "tr:nth-child(odd) "
         "td{background:#fafafa}img,svg{max-width:100%;width:100%}figure{display:inline-block;width:48%;margin:.5%;vertical-align:top}"
         "figcaption{font-size:12px;color:#555}.wide{overflow-x:auto}h2{margin-top:2em}</style>\n<h1>Mesh against ray march</h1>\n<p>"
      << escapedHtml(machine) << "</p>\n";
  if (!targets.rows.empty()) out << asHtml(targets);
  if (!viewTables.empty()) {
    out << "<h2>Standing cameras, settled meshes</h2>\n";
    for (const Table& table : viewTables) out << asHtml(table);
    out << "<h3>Pictures</h3>\n";
    for (const std::filesystem::path& view : views)
      for (const auto& [file, what] : {std::pair{"mesh.png", "mesh"},
                                       {"march.png", "ray march"},
                                       {"corrected.png", "mesh, corrected"},
                                       {"loss.png", "1 - SSIM of the mesh: black 0, white 0.25 and more"}})
        out << figure(view / file, view.filename().string() + ": " + what);
  }
  if (!flightTables.empty()) {
    out << "<h2>Flights</h2>\n<p>Each row is a flight in lock-step over a server of its own; where it was repeated, median and half the "
           "range.</p>\n";
    for (const Table& table : flightTables) out << asHtml(table);
    out << "<h3>Plots</h3>\n";
    for (const Plot& p : drawn) out << "<figure>" << p.svg << "</figure>\n";
    out << "<h3>Pictures</h3>\n<p>Of each flight the one that is least like the ray march.</p>\n";
    for (std::size_t r = 0; r < runs.size(); ++r) out << leastLike(runs[r], summaries[r]);
  }
  out << "</html>\n";
  return out.str();
}

// The same tables as a document.
std::string markdown(const Table& targets, const std::vector<Table>& viewTables, const std::vector<Table>& flightTables,
                     const std::string& machine) {
  std::string out = "# Mesh against ray march\n\nWritten by `ridgecast-client evaluate`: " + machine + ".\n\n";
  if (!targets.rows.empty()) out += asMarkdown(targets);
  for (const Table& table : viewTables) out += asMarkdown(table);
  if (!flightTables.empty())
    out +=
        "Each of the following rows is a flight in lock-step over a server of its own; where it was repeated, median and half the "
        "range.\n\n";
  for (const Table& table : flightTables) out += asMarkdown(table);
  while (out.ends_with("\n\n")) out.pop_back();
  return out;
}

Outcome<void> write(const std::filesystem::path& file, const std::string& content) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << content;
  out.close();
  if (!out) return Error{"cannot write " + file.string() + ": choose a folder that may be written and has room"};
  return {};
}

// What other programs took of the machine while these were measured, in words.
std::string othersIn(const std::vector<std::filesystem::path>& folders) {
  std::vector<double> shares;
  for (const std::filesystem::path& folder : folders)
    if (const Json beside = Json::parse(slurp(folder / "machine.json"), nullptr, false); beside.is_object())
      if (const auto share = value(beside, "others")) shares.push_back(100 * *share);
  if (shares.empty()) return {};
  std::ranges::sort(shares);
  return std::string("; other programs took ")
      .append(cell("%.0f to ", shares.front()))
      .append(cell("%.0f %% of the processors meanwhile, ", shares.back()))
      .append(cell("%.0f %% in the middle", shares[shares.size() / 2]));
}

Outcome<void> writeTables(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& folders,
                          const std::filesystem::path& folder, const std::string& begun) {
  auto views = readViews(folders);
  if (!views) return views.error();
  std::vector<std::filesystem::path> measured = folders;
  for (const Run& run : runs) measured.push_back(run.folder);
  const std::string machine = begun + othersIn(measured);
  const std::vector<Table> settled = viewTables(*views);
  auto flown = flightTables(runs);
  if (!flown) return flown.error();
  std::vector<Json> summaries;
  std::string csv = "flight,terrain,metric,threshold,threads,repeat";
  for (const char* column : kColumns) csv.append(",").append(column);
  csv += "\n";
  for (const Run& run : runs) {
    summaries.push_back(Json::parse(slurp(run.folder / "summary.json"), nullptr, false));  // flightTables has read it
    csv.append(run.name).append(",").append(run.terrain).append(",").append(run.metric).append(cell(",%g", run.threshold));
    csv.append(cell(",%.0f", run.threads)).append(cell(",%.0f", run.repeat));
    for (const char* column : kColumns) csv.append(",").append(cell("%.10g", value(summaries.back(), column).value_or(std::nan(""))));
    csv += "\n";
  }
  if (!runs.empty())
    if (auto written = write(folder / "runs.csv", csv); !written) return written;
  const Table targets = targetsOf(*views, runs, summaries);
  std::vector<Table> tables = settled;
  tables.insert(tables.end(), flown->begin(), flown->end());
  tables.push_back(targets);
  for (const Table& table : tables)
    if (auto written = write(folder / (table.name + ".csv"), asCsv(table)); !written) return written;
  const std::vector<Plot> drawn = runs.empty() ? std::vector<Plot>() : plotsOf(runs, summaries);
  for (const Plot& p : drawn)
    if (auto written = write(folder / p.file, p.svg); !written) return written;
  if (auto written = write(folder / "report.md", markdown(targets, settled, *flown, machine)); !written) return written;
  return write(folder / "report.html", html(targets, runs, summaries, folders, settled, *flown, drawn, machine));
}

}  // namespace

Outcome<void> writeReport(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& views,
                          const std::filesystem::path& folder, const std::string& machine) {
  try {
    return writeTables(runs, views, folder, machine);
  } catch (const Json::exception& e) {
    return Error{folder.string() + " holds figures of another version (" + e.what() + "): choose another --out"};
  }
}

}  // namespace ridgecast::evaluation
