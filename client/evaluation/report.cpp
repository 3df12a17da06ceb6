#include "client/evaluation/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;
using Points = std::vector<std::pair<double, double>>;

// Okabe and Ito's palette, told apart by colour-blind eyes.
constexpr std::array<const char*, 7> kColours = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"};

struct Column {
  const char* key;    // of summary.json
  const char* title;  // with its unit
  const char* format;
};
constexpr std::array<Column, 17> kColumns = {{{"frames", "pictures", "%.0f"},
                                              {"ssim_mean", "SSIM mean", "%.4f"},
                                              {"ssim_min", "SSIM least", "%.4f"},
                                              {"ssim_settled", "SSIM settled", "%.4f"},
                                              {"ssim_settled_terrain", "SSIM settled, terrain alone", "%.4f"},
                                              {"triangles", "triangles settled", "%.0f"},
                                              {"leaves", "nodes", "%.0f"},
                                              {"iterations", "iterations", "%.0f"},
                                              {"iterations_per_second", "iterations/s", "%.2f"},
                                              {"mesh_frame_ms", "mesh ms/frame", "%.1f"},
                                              {"raymarch_frame_ms", "ray march ms/frame", "%.1f"},
                                              {"bytes_received", "bytes", "%.0f"},
                                              {"latency_ms_mean", "latency ms", "%.1f"},
                                              {"settle_seconds", "settled after s", "%.1f"},
                                              {"hash_mismatches", "hashes that differed", "%.0f"},
                                              {"popping_off", "popping, morphing off", "%.4f"},
                                              {"popping_on", "popping, morphing on", "%.4f"}}};

std::string text(const char* format, double v) {
  char out[64];
  std::snprintf(out, sizeof out, format, v);
  return out;
}

std::optional<double> value(const Json& summary, const char* key) {
  const auto it = summary.find(key);
  if (it == summary.end() || !it->is_number()) return std::nullopt;
  return it->get<double>();
}

std::string escaped(const std::string& s) {
  std::string out;
  for (const char c : s) out += c == '<' ? "&lt;" : c == '&' ? "&amp;" : c == '"' ? "&quot;" : std::string(1, c);
  return out;
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
std::string plot(const std::string& title, const std::string& xTitle, const std::string& yTitle,
                 const std::map<std::string, Points>& lines) {
  constexpr double kWidth = 640, kHeight = 320, kLeft = 70, kBottom = 44, kTop = 34, kRight = 170;
  double most = 1e-9, last = 1e-9;
  for (const auto& [name, points] : lines)
    for (const auto& [x, y] : points) most = std::max(most, y), last = std::max(last, x);
  const auto px = [&](double x) { return kLeft + x / last * (kWidth - kLeft - kRight); };
  const auto py = [&](double y) { return kHeight - kBottom - y / most * (kHeight - kBottom - kTop); };
  std::ostringstream out;
  out << R"(<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 320" font-family="sans-serif" font-size="12" role="img" aria-label=")"
      << escaped(title) << "\"><rect width=\"640\" height=\"320\" fill=\"#fff\"/><text x=\"" << kLeft << "\" y=\"20\" font-size=\"14\">"
      << escaped(title) << "</text>\n";
  for (int k = 0; k <= 4; ++k) {
    const double y = most * k / 4, x = last * k / 4;
    out << "<line x1=\"" << kLeft << "\" x2=\"" << kWidth - kRight << "\" y1=\"" << py(y) << "\" y2=\"" << py(y)
        << "\" stroke=\"#ddd\"/><text x=\"" << kLeft - 6 << "\" y=\"" << py(y) + 4 << "\" text-anchor=\"end\">" << text("%.3g", y)
        << "</text><text x=\"" << px(x) << "\" y=\"" << kHeight - kBottom + 16 << "\" text-anchor=\"middle\">" << text("%.3g", x)
        << "</text>\n";
  }
  out << "<text x=\"" << (kLeft + kWidth - kRight) / 2 << "\" y=\"" << kHeight - 8 << "\" text-anchor=\"middle\">" << escaped(xTitle)
      << "</text><text transform=\"translate(14 " << kHeight / 2 << ") rotate(-90)\" text-anchor=\"middle\">" << escaped(yTitle)
      << "</text>\n";
  std::size_t k = 0;
  for (const auto& [name, points] : lines) {
    const char* colour = kColours[k % kColours.size()];
    out << "<polyline fill=\"none\" stroke-width=\"2\" stroke=\"" << colour << "\" points=\"";
    for (const auto& [x, y] : points) out << text("%.1f", px(x)) << "," << text("%.1f", py(y)) << " ";
    const double y = kTop + 16 * static_cast<double>(k++);
    out << "\"/><rect x=\"" << kWidth - kRight + 12 << "\" y=\"" << y << "\" width=\"12\" height=\"4\" fill=\"" << colour
        << "\"/><text x=\"" << kWidth - kRight + 30 << "\" y=\"" << y + 7 << "\">" << escaped(name) << "</text>\n";
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
  std::map<std::string, Points> triangles, bytes, popping;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (const auto it = summaries[r].find("popping_frames"); it != summaries[r].end())
      for (const char* which : {"off", "on"})
        for (std::size_t k = 0; k < (*it)[which].size(); ++k)
          popping[std::string("morphing ") + which].push_back({static_cast<double>(k) / 60, (*it)[which][k].get<double>()});
    if (runs[r].repeat > 1 || runs[r].threads) continue;
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
  if (!popping.empty()) out.push_back({"popping.svg", plot("Change from frame to frame, standing camera", "seconds", "1 - SSIM", popping)});
  return out;
}

// Mean and half the range of what repeats of one setting gave.
std::string spread(const std::vector<double>& values, const char* format) {
  if (values.empty()) return "";
  const auto [least, most] = std::ranges::minmax(values);
  double sum = 0;
  for (const double v : values) sum += v;
  std::string out = text(format, sum / static_cast<double>(values.size()));
  return values.size() > 1 ? out + " &plusmn; " + text(format, (most - least) / 2) : out;
}

std::string html(const std::vector<Run>& runs, const std::vector<Json>& summaries, const std::vector<Plot>& drawn,
                 const std::string& machine) {
  std::ostringstream out;
  out << "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Ridgecast: mesh against ray march</title><style>body{font:15px "
         "sans-serif;max-width:1200px;"
         "margin:2em auto;padding:0 1em}table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #ccc;padding:3px "
         "7px;text-align:right}th{background:#f3f3f3}"
         "td:first-child{text-align:left}img,svg{max-width:100%}figure{display:inline-block;width:48%;margin:.5%}.wide{overflow-x:auto}</"
         "style>\n<h1>Mesh against ray march</h1>\n<p>"
      << escaped(machine)
      << "</p>\n<p>Each row is a flight in lock-step over a server of its own; where it was repeated, mean and half the range. SSIM "
         "compares the streamed mesh with a "
         "converged ray march of the same camera: along the flight, and at its end, settled; on the whole picture and on terrain alone. "
         "Shading is filtered by footprint alike on both "
         "sides.</p>\n<div class=\"wide\"><table><tr><th>flight";
  for (const Column& c : kColumns) out << "<th>" << c.title;
  out << "\n";
  std::map<std::string, std::vector<std::size_t>> settings;
  std::vector<std::string> order;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const std::string key = runs[r].name.substr(0, runs[r].name.rfind("-r"));
    if (!settings.contains(key)) order.push_back(key);
    settings[key].push_back(r);
  }
  for (const std::string& key : order) {
    out << "<tr><td>" << escaped(key);
    for (const Column& c : kColumns) {
      std::vector<double> values;
      for (const std::size_t r : settings[key])
        if (const auto v = value(summaries[r], c.key)) values.push_back(*v);
      out << "<td>" << spread(values, c.format);
    }
    out << "\n";
  }
  out << "</table></div>\n<h2>Plots</h2>\n";
  for (const Plot& p : drawn) out << "<figure>" << p.svg << "</figure>\n";
  out << "<h2>Pictures</h2>\n";
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (runs[r].repeat > 1) continue;
    for (const char* picture : {"settled-mesh.png", "settled-raymarch.png"}) {
      const std::string bytes = slurp(runs[r].folder / picture);
      if (!bytes.empty())
        out << "<figure><img alt=\"\" src=\"data:image/png;base64," << base64(bytes) << "\"><figcaption>" << escaped(runs[r].name) << ", "
            << picture << "</figcaption></figure>\n";
    }
  }
  out << "</html>\n";
  return out.str();
}

Outcome<void> write(const std::filesystem::path& file, const std::string& content) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << content;
  out.close();
  if (!out) return Error{"cannot write " + file.string() + ": choose a folder that may be written and has room"};
  return {};
}

}  // namespace

Outcome<void> writeReport(const std::vector<Run>& runs, const std::filesystem::path& folder, const std::string& machine) {
  std::vector<Json> summaries;
  std::string csv = "flight,terrain,metric,threshold,threads,repeat";
  for (const Column& c : kColumns) csv.append(",").append(c.key);
  csv += "\n";
  for (const Run& run : runs) {
    Json summary = Json::parse(slurp(run.folder / "summary.json"), nullptr, false);
    if (!summary.is_object()) return Error{(run.folder / "summary.json").string() + " is broken: remove the folder, and it is flown again"};
    csv += run.name + "," + run.terrain + "," + run.metric + "," + text("%g", run.threshold) + "," + std::to_string(run.threads) + "," +
           std::to_string(run.repeat);
    for (const Column& c : kColumns) {
      const auto v = value(summary, c.key);
      csv += "," + (v ? text("%.10g", *v) : std::string());
    }
    csv += "\n";
    summaries.push_back(std::move(summary));
  }
  if (auto written = write(folder / "runs.csv", csv); !written) return written;
  const std::vector<Plot> drawn = plots(runs, summaries);
  for (const Plot& p : drawn)
    if (auto written = write(folder / p.file, p.svg); !written) return written;
  return write(folder / "report.html", html(runs, summaries, drawn, machine));
}

}  // namespace ridgecast::evaluation
