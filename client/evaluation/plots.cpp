#include "client/evaluation/plots.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include "client/evaluation/table.h"

namespace ridgecast::evaluation {
namespace {

using Lines = std::map<std::string, std::vector<std::pair<double, double>>>;

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
std::string plot(const std::string& title, const std::string& xTitle, const std::string& yTitle, const Lines& lines, double lowest = 0) {
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

// The finest flight with pictures over each terrain by each metric.
std::map<std::string, const FlightResults*> finestOf(const std::vector<FlightResults>& flights) {
  std::map<std::pair<std::string, std::string>, const FlightResults*> finest;
  for (const FlightResults& f : flights) {
    if (f.summary.frames.ssim.empty()) continue;
    const FlightResults*& known = finest[{f.run.terrain, f.run.metric}];
    if (!known || f.run.threshold < known->run.threshold) known = &f;
  }
  std::map<std::string, const FlightResults*> out;
  for (const auto& [key, f] : finest) out[key.first + " " + key.second + " " + cell("%g", f->run.threshold)] = f;
  return out;
}

}  // namespace

std::vector<Plot> plotsOf(const std::vector<FlightResults>& flights) {
  if (flights.empty()) return {};
  Lines triangles, bytes, stages, popping, likeness, along;
  double least = 1;
  for (const auto& [name, f] : finestOf(flights)) {
    std::vector<double> sorted = f->summary.frames.ssim;
    for (std::size_t k = 0; k < std::min(sorted.size(), f->summary.frames.t.size()); ++k)
      along[name].push_back({f->summary.frames.t[k], sorted[k]});
    std::ranges::sort(sorted);
    least = std::min(least, sorted.front());
    for (std::size_t k = 0; k < sorted.size() && sorted.size() > 1; ++k)
      likeness[name].push_back({static_cast<double>(k) / static_cast<double>(sorted.size() - 1), sorted[k]});
    double n = 0, sum = 0;
    for (const IterationResult& i : f->iterations) {
      triangles[name].push_back({++n, static_cast<double>(i.trianglesHeld)});
      bytes[name].push_back({n, sum += static_cast<double>(i.bytes) / 1e6});
    }
  }
  for (const FlightResults& f : flights)
    for (const auto& [which, changes] : f.summary.popping.frames)
      for (std::size_t k = 0; k < changes.size(); ++k)
        popping[f.run.terrain + ", morphing " + which].push_back({static_cast<double>(k) / 60, changes[k]});
  const FlightResults& first = flights.front();
  for (const Stage& stage : kStages)
    for (std::size_t k = 0; k < first.iterations.size(); ++k)
      stages[stage.name].push_back({static_cast<double>(k + 1), stage.ms(first.iterations[k])});

  std::vector<Plot> out = {{"triangles.svg", plot("Triangles held", "iteration", "triangles", triangles)},
                           {"bytes.svg", plot("Received", "iteration", "megabytes", bytes)},
                           {"stages.svg", plot("Time of each stage, " + settingOf(first.run), "iteration", "milliseconds", stages)}};
  const double lowest = std::floor(least * 20) / 20;
  if (!likeness.empty())
    out.push_back({"likeness.svg", plot("SSIM along the flights: distribution", "share of the pictures below", "SSIM", likeness, lowest)});
  if (!along.empty()) out.push_back({"likeness-along.svg", plot("SSIM along the flights", "seconds of the path", "SSIM", along, lowest)});
  if (!popping.empty()) out.push_back({"popping.svg", plot("Change from frame to frame, standing camera", "seconds", "1 - SSIM", popping)});
  return out;
}

}  // namespace ridgecast::evaluation
