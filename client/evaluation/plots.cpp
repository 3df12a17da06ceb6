#include "client/evaluation/plots.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <utility>

#include "client/evaluation/json_numbers.h"
#include "client/evaluation/table.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;
using Points = std::vector<std::pair<double, double>>;

// Okabe and Ito's palette, told apart by colour-blind eyes.
constexpr std::array<const char*, 7> kColours = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"};

// Between two marks of an axis so long: 1, 2 or 5 times a power of ten, three to seven of them.
double stepOf(double length) {
  const double power = std::pow(10, std::floor(std::log10(length / 3)));
  for (const double times : {1.0, 2.0, 5.0, 10.0})
    if (length / (times * power) <= 6) return times * power;
  return 10 * power;
}

// Lines over one pair of axes.
std::string plot(const std::string& title, const std::string& xTitle, const std::string& yTitle, const std::map<std::string, Points>& lines,
                 double lowest = 0) {
  constexpr double kWidth = 680, kHeight = 320, kLeft = 70, kBottom = 44, kTop = 34, kRight = 200;
  double highest = lowest + 1e-9, last = 1e-9;
  for (const auto& [name, points] : lines)
    for (const auto& [x, y] : points) highest = std::max(highest, y), last = std::max(last, x);
  const double yStep = stepOf(highest - lowest), xStep = stepOf(last);
  const double most = lowest + yStep * std::ceil((highest - lowest) / yStep - 1e-9);
  const bool thousands = highest >= 10'000;
  const auto px = [&](double x) { return kLeft + x / last * (kWidth - kLeft - kRight); };
  const auto py = [&](double y) { return kHeight - kBottom - (y - lowest) / (most - lowest) * (kHeight - kBottom - kTop); };
  std::ostringstream out;
  out << R"(<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 680 320" font-family="sans-serif" font-size="12" role="img" aria-label=")"
      << escapedHtml(title) << "\"><rect width=\"680\" height=\"320\" fill=\"#fff\"/><text x=\"" << kLeft << "\" y=\"20\" font-size=\"14\">"
      << escapedHtml(title) << "</text>\n";
  for (double y = lowest; y < most + yStep / 2; y += yStep)
    out << "<line x1=\"" << kLeft << "\" x2=\"" << kWidth - kRight << "\" y1=\"" << py(y) << "\" y2=\"" << py(y)
        << "\" stroke=\"#ddd\"/><text x=\"" << kLeft - 6 << "\" y=\"" << py(y) + 4 << "\" text-anchor=\"end\">"
        << (thousands ? cell("%gk", y / 1000) : cell("%.3g", std::abs(y) < yStep / 2 ? 0 : y)) << "</text>\n";
  for (double x = 0; x < last + xStep / 1e6; x += xStep)
    out << "<text x=\"" << px(x) << "\" y=\"" << kHeight - kBottom + 16 << "\" text-anchor=\"middle\">" << cell("%.3g", x) << "</text>\n";
  out << "<text x=\"" << (kLeft + kWidth - kRight) / 2 << "\" y=\"" << kHeight - 8 << "\" text-anchor=\"middle\">" << escapedHtml(xTitle)
      << "</text><text transform=\"translate(14 " << kHeight / 2 << ") rotate(-90)\" text-anchor=\"middle\">" << escapedHtml(yTitle)
      << "</text>\n";
  std::size_t k = 0;
  for (const auto& [name, points] : lines) {
    const char* colour = kColours[k % kColours.size()];
    const char* dash = k < kColours.size() ? "" : "\" stroke-dasharray=\"5 3";
    out << "<polyline fill=\"none\" stroke-width=\"1.5\" stroke=\"" << colour << dash << "\" points=\"";
    for (const auto& [x, y] : points) out << cell("%.1f", px(x)) << "," << cell("%.1f", py(y)) << " ";
    const double y = kTop + 16 * static_cast<double>(k++);
    out << "\"/><line x1=\"" << kWidth - kRight + 12 << "\" x2=\"" << kWidth - kRight + 26 << "\" y1=\"" << y + 2 << "\" y2=\"" << y + 2
        << "\" stroke-width=\"3\" stroke=\"" << colour << dash << "\"/><text x=\"" << kWidth - kRight + 30 << "\" y=\"" << y + 7 << "\">"
        << escapedHtml(name) << "</text>\n";
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

}  // namespace

std::vector<Plot> plotsOf(const std::vector<Run>& runs, const std::vector<nlohmann::json>& summaries) {
  std::vector<Plot> out;
  std::map<std::string, Points> triangles, bytes, popping, likeness, along;
  std::map<std::pair<std::string, std::string>, std::size_t> finest;
  double least = 1;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (const auto it = summaries[r].find("popping_frames"); it != summaries[r].end())
      for (const char* which : {"off", "on"})
        for (std::size_t k = 0; k < (*it)[which].size(); ++k)
          popping[runs[r].terrain + ", morphing " + which].push_back({static_cast<double>(k) / 60, (*it)[which][k].get<double>()});
    // One line for each terrain and metric: its finest flight of those with pictures.
    if (!summaries[r].contains("ssim_frames") || summaries[r].at("ssim_frames").empty()) continue;
    const auto [at, isNew] = finest.try_emplace({runs[r].terrain, runs[r].metric}, r);
    if (!isNew && runs[r].threshold < runs[at->second].threshold) at->second = r;
  }
  for (const auto& [key, r] : finest) {
    const std::string name = key.first + " " + key.second + " " + cell("%g", runs[r].threshold);
    const auto values = summaries[r].at("ssim_frames").get<std::vector<double>>();
    const auto times = summaries[r].value("frames_t", std::vector<double>());
    for (std::size_t k = 0; k < std::min(values.size(), times.size()); ++k) along[name].push_back({times[k], values[k]});
    std::vector<double> sorted = values;
    std::ranges::sort(sorted);
    least = std::min(least, sorted.front());
    for (std::size_t k = 0; k < sorted.size() && sorted.size() > 1; ++k)
      likeness[name].push_back({static_cast<double>(k) / static_cast<double>(sorted.size() - 1), sorted[k]});
    const std::vector<Json> iterations = iterationsOf(runs[r]);
    double sum = 0, n = 0;
    for (const Json& i : iterations) {
      triangles[name].push_back({++n, number(i, "triangles_held")});
      bytes[name].push_back({n, sum += number(i, "bytes") / 1e6});
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
        stages[std::string(stage).substr(0, std::string(stage).find('_'))].push_back({n, number(i, stage)});
    }
    out.push_back({"stages.svg", plot("Time of each stage, " + runs.front().name.substr(0, runs.front().name.rfind("-r")), "iteration",
                                      "milliseconds", stages)});
  }
  if (!likeness.empty())
    out.push_back({"likeness.svg", plot("SSIM along the flights: distribution", "share of the pictures below", "SSIM", likeness,
                                        std::floor(least * 20) / 20)});
  if (!along.empty())
    out.push_back(
        {"likeness-along.svg", plot("SSIM along the flights", "seconds of the path", "SSIM", along, std::floor(least * 20) / 20)});
  if (!popping.empty()) out.push_back({"popping.svg", plot("Change from frame to frame, standing camera", "seconds", "1 - SSIM", popping)});
  return out;
}

}  // namespace ridgecast::evaluation
