#include "client/evaluation/report.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "client/evaluation/flight_tables.h"
#include "client/evaluation/plots.h"
#include "client/evaluation/table.h"
#include "client/evaluation/targets.h"
#include "client/evaluation/text_file.h"
#include "client/evaluation/view_tables.h"
#include "client/render/picture.h"

namespace ridgecast::evaluation {
namespace {

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

// The picture of a flight that is least like the ray march, beside the march.
std::string leastLike(const FlightResults& f) {
  const auto& frames = f.summary.frames;
  if (frames.names.empty()) return {};
  const auto k = static_cast<std::size_t>(std::ranges::min_element(frames.ssim) - frames.ssim.begin());
  const std::string& name = frames.names.at(k);
  const std::string where =
      f.run.terrain + ", " + f.run.metric + " " + cell("%g", f.run.threshold) + ", after " + cell("%.1f", frames.t.at(k)) + " s: ";
  return figure(f.run.folder / (name + "-mesh.png"), where + "mesh, SSIM " + cell("%.3f", frames.ssim[k])) +
         figure(f.run.folder / (name + "-raymarch.png"), where + "ray march");
}

// What both documents show.
struct Report {
  std::string machine;
  Table targets;
  std::vector<Table> viewTables, flightTables;
};

constexpr std::string_view kRows = "Each row below is a lock-step flight with its own server. Repeated flights: median ± half the range.";

std::string html(const Report& report, const std::vector<FlightResults>& flights, const std::vector<std::filesystem::path>& views,
                 const std::vector<Plot>& plots) {
  std::ostringstream out;
  out << R"(<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Ridgecast: mesh against ray march</title>
<style>body{font:15px/1.45 sans-serif;max-width:1240px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #ccc;padding:3px 7px;text-align:right}
th{background:#f3f3f3;vertical-align:bottom}td:first-child,th:first-child{text-align:left;white-space:nowrap}
tr:nth-child(odd) td{background:#fafafa}img,svg{max-width:100%;width:100%}
figure{display:inline-block;width:48%;margin:.5%;vertical-align:top}figcaption{font-size:12px;color:#555}
.wide{overflow-x:auto}h2{margin-top:2em}</style>
<h1>Mesh against ray march</h1>
<p>)" << escapedHtml(report.machine)
      << "</p>\n";
  if (!report.targets.rows.empty()) out << asHtml(report.targets);
  if (!report.viewTables.empty()) {
    out << "<h2>Cameras at rest, settled meshes</h2>\n";
    for (const Table& table : report.viewTables) out << asHtml(table);
    out << "<h3>Pictures</h3>\n";
    for (const std::filesystem::path& view : views)
      for (const auto& [file, what] : {std::pair{"mesh.png", "mesh"},
                                       {"march.png", "ray march"},
                                       {"corrected.png", "mesh, corrected"},
                                       {"loss.png", "1 - SSIM of the mesh: black 0, white 0.25 and more"}})
        out << figure(view / file, view.filename().string() + ": " + what);
  }
  if (!report.flightTables.empty()) {
    out << "<h2>Flights</h2>\n<p>" << kRows << "</p>\n";
    for (const Table& table : report.flightTables) out << asHtml(table);
    out << "<h3>Plots</h3>\n";
    for (const Plot& p : plots) out << "<figure>" << p.svg << "</figure>\n";
    out << "<h3>Pictures</h3>\n<p>For each flight, the picture least like the ray march.</p>\n";
    for (const FlightResults& f : flights) out << leastLike(f);
  }
  out << "</html>\n";
  return out.str();
}

// The same tables as a document.
std::string markdown(const Report& report) {
  std::string out = "# Mesh against ray march\n\nWritten by `ridgecast-client evaluate`: " + report.machine + ".\n\n";
  if (!report.targets.rows.empty()) out += asMarkdown(report.targets);
  for (const Table& table : report.viewTables) out += asMarkdown(table);
  if (!report.flightTables.empty()) out.append(kRows).append("\n\n");
  for (const Table& table : report.flightTables) out += asMarkdown(table);
  while (out.ends_with("\n\n")) out.pop_back();
  return out;
}

// The CPU share of other programs during the measurements, in words.
std::string othersIn(const std::vector<std::filesystem::path>& views, const std::vector<FlightResults>& flights) {
  std::vector<double> shares;
  for (const std::filesystem::path& view : views) shares.push_back(100 * othersOf(view));
  for (const FlightResults& f : flights) shares.push_back(100 * f.others);
  std::erase_if(shares, [](double share) { return std::isnan(share); });
  if (shares.empty()) return {};
  const auto [least, greatest] = std::ranges::minmax(shares);
  return "; CPU share of other programs meanwhile " + cell("%.0f to ", least) + cell("%.0f %%, median ", greatest) +
         cell("%.0f %%", median(shares));
}

std::string runsCsv(const std::vector<FlightResults>& flights) {
  std::string out = "flight,terrain,metric,threshold,threads,repeat";
  for (const auto& [key, value] : numbersOf({})) out.append(",").append(key);
  for (const auto& [run, summary, iterations, others] : flights) {
    out += "\n" + run.name + "," + run.terrain + "," + run.metric;
    out += cell(",%g", run.threshold) + cell(",%.0f", run.threads) + cell(",%.0f", run.repeat);
    for (const auto& [key, value] : numbersOf(summary)) out += "," + cell("%.10g", value);
  }
  return out + "\n";
}

Outcome<void> writeTables(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& folders,
                          const std::filesystem::path& folder, const std::string& begun) {
  auto views = readViews(folders);
  if (!views) return views.error();
  std::vector<FlightResults> flights;
  for (const Run& run : runs) {
    auto results = readResults(run);
    if (!results) return results.error();
    flights.push_back(std::move(*results));
  }
  const Report report{begun + othersIn(folders, flights), targetsOf(*views, flights), viewTables(*views), flightTables(flights)};
  const std::vector<Plot> plots = plotsOf(flights);
  std::map<std::string, std::string> files = {
      {"report.md", markdown(report)}, {"report.html", html(report, flights, folders, plots)}, {"targets.csv", asCsv(report.targets)}};
  if (!flights.empty()) files["runs.csv"] = runsCsv(flights);
  for (const auto* tables : {&report.viewTables, &report.flightTables})
    for (const Table& table : *tables) files[table.name + ".csv"] = asCsv(table);
  for (const Plot& p : plots) files[p.file] = p.svg;
  for (const auto& [name, text] : files)
    if (auto written = writeText(folder / name, text); !written) return written;
  return {};
}

}  // namespace

Outcome<void> writeReport(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& views,
                          const std::filesystem::path& folder, const std::string& machine) {
  try {
    return writeTables(runs, views, folder, machine);
  } catch (const nlohmann::json::exception& e) {
    return Error{folder.string() + " holds results of another version (" + e.what() + "): choose another --out"};
  }
}

}  // namespace ridgecast::evaluation
