#include "client/evaluation/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "client/evaluation/flight_tables.h"
#include "client/evaluation/table.h"
#include "client/evaluation/view_tables.h"
#include "client/render/picture.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;
using Points = std::vector<std::pair<double, double>>;

// Okabe and Ito's palette, told apart by colour-blind eyes.
constexpr std::array<const char*, 7> kColours = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"};

// Of summary.json, for runs.csv.
constexpr std::array<const char*, 27> kColumns = {"frames",
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

// Lines over one pair of axes.
std::string plot(const std::string& title, const std::string& xTitle, const std::string& yTitle, const std::map<std::string, Points>& lines,
                 double lowest = 0) {
  constexpr double kWidth = 640, kHeight = 320, kLeft = 70, kBottom = 44, kTop = 34, kRight = 170;
  double most = lowest + 1e-9, last = 1e-9;
  for (const auto& [name, points] : lines)
    for (const auto& [x, y] : points) most = std::max(most, y), last = std::max(last, x);
  const auto px = [&](double x) { return kLeft + x / last * (kWidth - kLeft - kRight); };
  const auto py = [&](double y) { return kHeight - kBottom - (y - lowest) / (most - lowest) * (kHeight - kBottom - kTop); };
  std::ostringstream out;
  out << R"(<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 320" font-family="sans-serif" font-size="12" role="img" aria-label=")"
      << escapedHtml(title) << "\"><rect width=\"640\" height=\"320\" fill=\"#fff\"/><text x=\"" << kLeft << "\" y=\"20\" font-size=\"14\">"
      << escapedHtml(title) << "</text>\n";
  for (int k = 0; k <= 4; ++k) {
    const double y = lowest + (most - lowest) * k / 4, x = last * k / 4;
    out << "<line x1=\"" << kLeft << "\" x2=\"" << kWidth - kRight << "\" y1=\"" << py(y) << "\" y2=\"" << py(y)
        << "\" stroke=\"#ddd\"/><text x=\"" << kLeft - 6 << "\" y=\"" << py(y) + 4 << "\" text-anchor=\"end\">" << cell("%.3g", y)
        << "</text><text x=\"" << px(x) << "\" y=\"" << kHeight - kBottom + 16 << "\" text-anchor=\"middle\">" << cell("%.3g", x)
        << "</text>\n";
  }
  out << "<text x=\"" << (kLeft + kWidth - kRight) / 2 << "\" y=\"" << kHeight - 8 << "\" text-anchor=\"middle\">" << escapedHtml(xTitle)
      << "</text><text transform=\"translate(14 " << kHeight / 2 << ") rotate(-90)\" text-anchor=\"middle\">" << escapedHtml(yTitle)
      << "</text>\n";
  std::size_t k = 0;
  for (const auto& [name, points] : lines) {
    const char* colour = kColours[k % kColours.size()];
    out << "<polyline fill=\"none\" stroke-width=\"2\" stroke=\"" << colour << "\" points=\"";
    for (const auto& [x, y] : points) out << cell("%.1f", px(x)) << "," << cell("%.1f", py(y)) << " ";
    const double y = kTop + 16 * static_cast<double>(k++);
    out << "\"/><rect x=\"" << kWidth - kRight + 12 << "\" y=\"" << y << "\" width=\"12\" height=\"4\" fill=\"" << colour
        << "\"/><text x=\"" << kWidth - kRight + 30 << "\" y=\"" << y + 7 << "\">" << escapedHtml(name) << "</text>\n";
  }
  out << "</svg>\n";
  return out.str();
}

std::vector<Json> iterationsOf(const Run& run) {
  std::vector<Json> out;
  std::ifstream in(run.folder / "iterations.jsonl");
  for (std::string line; std::getline(in, line);)
    if (Json one = Json::parse(line, nullptr, false); one.is_object()) out.push_back(std::move(one));
  return out;
}

struct Plot {
  std::string file, svg;
};

std::vector<Plot> plots(const std::vector<Run>& runs, const std::vector<Json>& summaries) {
  std::vector<Plot> out;
  std::map<std::string, Points> triangles, bytes, popping, likeness;
  std::map<std::pair<std::string, std::string>, std::size_t> finest;
  double least = 1;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (const auto it = summaries[r].find("popping_frames"); it != summaries[r].end())
      for (const char* which : {"off", "on"})
        for (std::size_t k = 0; k < (*it)[which].size(); ++k)
          popping[runs[r].terrain + ", morphing " + which].push_back({static_cast<double>(k) / 60, (*it)[which][k].get<double>()});
    // One line for each terrain and metric: its finest flight.
    const std::pair key{runs[r].terrain, runs[r].metric};
    if (const auto [at, isNew] = finest.try_emplace(key, r); runs[r].threads || (!isNew && runs[at->second].threshold <= runs[r].threshold))
      continue;
    else
      at->second = r;
  }
  for (const auto& [key, r] : finest) {
    if (const auto it = summaries[r].find("ssim_frames"); it != summaries[r].end() && it->size() > 1) {
      std::vector<double> sorted = it->get<std::vector<double>>();
      std::ranges::sort(sorted);
      least = std::min(least, sorted.front());
      for (std::size_t k = 0; k < sorted.size(); ++k)
        likeness[runs[r].name].push_back({static_cast<double>(k) / static_cast<double>(sorted.size() - 1), sorted[k]});
    }
    const std::vector<Json> iterations = iterationsOf(runs[r]);
    double sum = 0, n = 0;
    for (const Json& i : iterations) {
      triangles[runs[r].name].push_back({++n, value(i, "triangles_held").value_or(0)});
      bytes[runs[r].name].push_back({n, sum += value(i, "bytes").value_or(0) / 1e6});
    }
  }
  out.push_back({"triangles.svg", plot("Triangles held", "iteration", "triangles", triangles)});
  out.push_back({"bytes.svg", plot("Received", "iteration", "megabytes", bytes)});
  if (!runs.empty()) {
    std::map<std::string, Points> stages;
    double n = 0;
    for (const Json& i : iterationsOf(runs.front())) {
      ++n;
      for (const char* stage : {"select_ms", "generate_ms", "refine_ms", "triangulate_ms", "encode_ms", "apply_ms"})
        stages[stage].push_back({n, value(i, stage).value_or(0)});
    }
    out.push_back({"stages.svg", plot("Time of each stage, " + runs.front().name, "iteration", "milliseconds", stages)});
  }
  if (!likeness.empty())
    out.push_back({"likeness.svg", plot("SSIM along the flights: distribution", "share of the pictures below", "SSIM", likeness,
                                        std::floor(least * 20) / 20)});
  if (!popping.empty()) out.push_back({"popping.svg", plot("Change from frame to frame, standing camera", "seconds", "1 - SSIM", popping)});
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

std::string html(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& views, const std::vector<Table>& viewTables,
                 const std::vector<Table>& flightTables, const std::vector<Plot>& drawn, const std::string& machine) {
  std::ostringstream out;
  out << "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" "
         "content=\"width=device-width\"><title>Ridgecast: mesh against ray "
         "march</title><style>body{font:15px/1.45 sans-serif;max-width:1240px;margin:2em auto;padding:0 "
         "1em;color:#222}table{border-collapse:collapse;font-size:13px}"
         "td,th{border:1px solid #ccc;padding:3px "
         "7px;text-align:right}th{background:#f3f3f3;vertical-align:bottom}td:first-child{text-align:left;white-space:nowrap}"
         "tr:nth-child(odd) "
         "td{background:#fafafa}img,svg{max-width:100%;width:100%}figure{display:inline-block;width:48%;margin:.5%;vertical-align:top}"
         "figcaption{font-size:12px;color:#555}.wide{overflow-x:auto}h2{margin-top:2em}</style>\n<h1>Mesh against ray march</h1>\n<p>"
      << escapedHtml(machine) << "</p>\n";
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
    out << "<h2>Flights</h2>\n<p>Each row is a flight in lock-step over a server of its own; where it was repeated, mean and half the "
           "range.</p>\n";
    for (const Table& table : flightTables) out << asHtml(table);
    out << "<h3>Plots</h3>\n";
    for (const Plot& p : drawn) out << "<figure>" << p.svg << "</figure>\n";
    out << "<h3>Pictures</h3>\n";
    for (const Run& run : runs)
      if (run.repeat == 1)
        for (const auto& [file, what] : {std::pair{"settled-mesh.png", "mesh"}, {"settled-raymarch.png", "ray march"}})
          out << figure(run.folder / file, run.name + ", settled: " + what);
  }
  out << "</html>\n";
  return out.str();
}

// The same tables as a document.
std::string markdown(const std::vector<Table>& viewTables, const std::vector<Table>& flightTables, const std::string& machine) {
  std::string out = "# Mesh against ray march\n\nWritten by `ridgecast-client evaluate`: " + machine + ".\n\n";
  for (const Table& table : viewTables) out += asMarkdown(table);
  if (!flightTables.empty())
    out +=
        "Each of the following rows is a flight in lock-step over a server of its own; where it was repeated, mean and half the range.\n\n";
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

}  // namespace

Outcome<void> writeReport(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& views,
                          const std::filesystem::path& folder, const std::string& machine) {
  auto settled = viewTables(views);
  if (!settled) return settled.error();
  auto flown = flightTables(runs);
  if (!flown) return flown.error();
  std::vector<Json> summaries;
  std::string csv = "flight,terrain,metric,threshold,threads,repeat";
  for (const char* column : kColumns) csv.append(",").append(column);
  csv += "\n";
  for (const Run& run : runs) {
    summaries.push_back(Json::parse(slurp(run.folder / "summary.json"), nullptr, false));  // flightTables has read it
    csv += run.name + "," + run.terrain + "," + run.metric + "," + cell("%g", run.threshold) + "," + std::to_string(run.threads) + "," +
           std::to_string(run.repeat);
    for (const char* column : kColumns) csv += "," + cell("%.10g", value(summaries.back(), column).value_or(std::nan("")));
    csv += "\n";
  }
  if (!runs.empty())
    if (auto written = write(folder / "runs.csv", csv); !written) return written;
  for (const std::vector<Table>& tables : {*settled, *flown})
    for (const Table& table : tables)
      if (auto written = write(folder / (table.name + ".csv"), asCsv(table)); !written) return written;
  const std::vector<Plot> drawn = runs.empty() ? std::vector<Plot>() : plots(runs, summaries);
  for (const Plot& p : drawn)
    if (auto written = write(folder / p.file, p.svg); !written) return written;
  if (auto written = write(folder / "report.md", markdown(*settled, *flown, machine)); !written) return written;
  return write(folder / "report.html", html(runs, views, *settled, *flown, drawn, machine));
}

}  // namespace ridgecast::evaluation
