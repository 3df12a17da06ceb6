#include "tests/bench/panels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <sstream>

namespace ridgecast::bench {
namespace {

constexpr double kWidth = 400, kHeight = 250, kLeft = 58, kRight = 14, kTop = 46, kBottom = 40, kHead = 34;
constexpr const char* kColours[] = {"#0b6e99", "#d1495b", "#2a9d4a", "#7b4fa3", "#c98a00"};  // told apart by the colour-blind, too

std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", v);
  if (v >= 1000) std::snprintf(text, sizeof text, "%.0f", v);
  return text;
}

struct Axis {
  double low, high;
  bool logarithmic;
  double at(double v) const {
    const double share = logarithmic ? std::log(v / low) / std::log(high / low) : (v - low) / (high - low);
    return kTop + (1 - share) * (kHeight - kTop - kBottom);
  }
  std::vector<double> ticks() const {
    std::vector<double> out;
    if (logarithmic) {
      for (double v = low; v <= high * 1.001; v *= 10) out.push_back(v);
    } else {
      for (int k = 0; k <= 4; ++k) out.push_back(low + (high - low) * k / 4);
    }
    return out;
  }
};

bool shown(double v, bool logarithmic) { return std::isfinite(v) && (!logarithmic || v > 0); }

Axis axisOf(const Panel& panel) {
  double low = panel.wanted > 0 ? panel.wanted : HUGE_VAL, high = panel.wanted;
  for (const Curve& curve : panel.curves)
    for (double v : curve.y)
      if (shown(v, panel.logarithmic)) low = std::min(low, v), high = std::max(high, v);
  if (!(high > 0)) high = 1;
  if (panel.logarithmic)
    return {std::pow(10, std::floor(std::log10(std::min(low, high / 2)))), std::pow(10, std::ceil(std::log10(high))), true};
  const double step = std::pow(10, std::floor(std::log10(high))) / 2;
  return {0, std::ceil(high / step) * step, false};
}

}  // namespace

std::string drawPanels(const std::string& title, const std::string& xTitle, const std::vector<double>& x,
                       const std::vector<Panel>& panels) {
  const auto count = static_cast<double>(panels.size());
  const double columns = std::min(2.0, count), rows = std::ceil(count / columns);
  std::ostringstream out;
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " << columns * kWidth << " " << rows * kHeight + kHead
      << "\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"14\" y=\"24\" "
         "font-size=\"13\">"
      << title << "</text>\n";
  const auto across = [&](std::size_t k) {
    return kLeft + (x.size() < 2 ? 0.5 : static_cast<double>(k) / static_cast<double>(x.size() - 1)) * (kWidth - kLeft - kRight);
  };
  for (std::size_t p = 0; p < panels.size(); ++p) {
    const Panel& panel = panels[p];
    const Axis axis = axisOf(panel);
    const auto column = static_cast<double>(p % static_cast<std::size_t>(columns)), row = std::floor(static_cast<double>(p) / columns);
    out << "<g transform=\"translate(" << column * kWidth << "," << row * kHeight + kHead << ")\">\n<text x=\"" << kLeft
        << "\" y=\"16\" font-weight=\"bold\">" << panel.title << "</text>\n";
    for (double v : axis.ticks())
      out << "<path d=\"M" << kLeft << " " << axis.at(v) << "H" << kWidth - kRight << "\" stroke=\"#ddd\"/><text x=\"" << kLeft - 6
          << "\" y=\"" << axis.at(v) + 4 << "\" text-anchor=\"end\">" << number(v) << "</text>\n";
    for (std::size_t k = 0; k < x.size(); ++k)
      out << "<text x=\"" << across(k) << "\" y=\"" << kHeight - kBottom + 18 << "\" text-anchor=\"middle\">" << number(x[k])
          << "</text>\n";
    out << "<text x=\"" << (kLeft + kWidth - kRight) / 2 << "\" y=\"" << kHeight - 6 << "\" text-anchor=\"middle\">" << xTitle
        << "</text>\n";
    if (panel.wanted > 0)
      out << "<path d=\"M" << kLeft << " " << axis.at(panel.wanted) << "H" << kWidth - kRight
          << "\" stroke=\"#555\" stroke-dasharray=\"5 4\"/><text x=\"" << kLeft + 4 << "\" y=\"" << axis.at(panel.wanted) - 4
          << "\" fill=\"#555\">" << panel.wantedText << "</text>\n";
    double legend = kLeft;
    for (std::size_t c = 0; c < panel.curves.size(); ++c) {
      const Curve& curve = panel.curves[c];
      const char* colour = kColours[c % std::size(kColours)];
      std::string path;
      for (std::size_t k = 0; k < x.size() && k < curve.y.size(); ++k) {
        if (!shown(curve.y[k], panel.logarithmic)) continue;
        path += path.empty() ? "M" : "L";
        path += number(across(k));
        path += " ";
        path += number(axis.at(curve.y[k]));
        out << "<circle cx=\"" << across(k) << "\" cy=\"" << axis.at(curve.y[k]) << "\" r=\"3\" fill=\"" << colour << "\"/>";
      }
      out << "\n<path d=\"" << path << "\" fill=\"none\" stroke=\"" << colour << "\" stroke-width=\"2\"/>\n";
      if (panel.curves.size() < 2) continue;
      out << "<text x=\"" << legend << "\" y=\"34\" fill=\"" << colour << "\">" << curve.name << "</text>\n";
      legend += 12 + 7 * static_cast<double>(curve.name.size());
    }
    out << "</g>\n";
  }
  out << "</svg>\n";
  return out.str();
}

}  // namespace ridgecast::bench
