#include "client/viewer/plots.h"

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "client/viewer/theme.h"

namespace ridgecast::viewer {
namespace {

constexpr float kLines = 3.6f;  // the height of a plot, in lines of text

// The next of 1, 2, 5, 10, 20, ... times a power of ten.
double roundUp(double value) {
  const double unit = std::pow(10, std::floor(std::log10(std::max(value, 1e-3))));
  for (const double step : {1.0, 2.0, 5.0})
    if (value <= step * unit) return step * unit;
  return 10 * unit;
}

std::string text(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%.4g", value);
  return out;
}

// Title, axes with their labels, and where the values lie between them.
class Frame {
 public:
  // `ago`: how old the oldest of History::kLength values is.
  Frame(const std::string& title, const char* ago, double most, float width) : list_(ImGui::GetWindowDrawList()), top_(roundUp(most)) {
    ImGui::TextUnformatted(title.c_str());
    const float line = ImGui::GetTextLineHeight();
    const std::array<double, 3> ticks = {top_, top_ / 2, 0};
    float labels = 0;
    for (const double tick : ticks) labels = std::max(labels, ImGui::CalcTextSize(text(tick).c_str()).x);
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    from_ = ImVec2(corner.x + labels + line / 2, corner.y + line / 2);
    to_ = ImVec2(corner.x + width, from_.y + kLines * line);
    list_->AddRectFilled(from_, to_, theme::packed(theme::kField));
    const ImU32 muted = theme::packed(theme::kMuted), edge = theme::packed(theme::kEdge);
    for (const double tick : ticks) {
      const std::string label = text(tick);
      const float y = std::round(at(0, tick).y);
      list_->AddLine(ImVec2(from_.x, y), ImVec2(to_.x, y), edge);
      list_->AddText(ImVec2(from_.x - line / 4 - ImGui::CalcTextSize(label.c_str()).x, y - line / 2), muted, label.c_str());
    }
    list_->AddText(ImVec2(from_.x, to_.y + line / 4), muted, ago);
    list_->AddText(ImVec2(to_.x - ImGui::CalcTextSize("now").x, to_.y + line / 4), muted, "now");
    ImGui::Dummy(ImVec2(width, line * (kLines + 1.75f)));
  }
  // Of the value that is `age` older than the newest.
  ImVec2 at(std::size_t age, double value) const {
    const float x = to_.x - (to_.x - from_.x) * static_cast<float>(age) / static_cast<float>(History::kLength - 1);
    return {x, to_.y - (to_.y - from_.y) * static_cast<float>(std::min(value / top_, 1.0))};
  }
  ImDrawList* list() const { return list_; }

 private:
  ImDrawList* const list_;
  const double top_;
  ImVec2 from_, to_;
};

void drawPlot(const std::string& name, const char* unit, const char* ago, const History& history, float width) {
  const Frame frame(name + ", " + unit + ": " + text(static_cast<double>(history.newest())), ago, static_cast<double>(history.most()),
                    width);
  std::vector<ImVec2> points;
  for (std::size_t k = 0; k < history.size(); ++k) points.push_back(frame.at(history.size() - 1 - k, static_cast<double>(history.at(k))));
  frame.list()->AddPolyline(points.data(), static_cast<int>(points.size()), theme::packed(theme::kAccent), 0,
                            std::max(1.0f, ImGui::GetFontSize() / 10));
}

// A name beside its colour, on the next line if there is no more room.
void drawStageName(const char* name, ImU32 colour, float width, bool first) {
  const float side = ImGui::GetTextLineHeight() * 0.7f, gap = side / 3;
  ImGui::SameLine(0, 2 * side);
  const float left = ImGui::GetCursorPosX() - ImGui::GetStyle().WindowPadding.x;
  if (first || left + side + gap + ImGui::CalcTextSize(name).x > width) ImGui::NewLine();
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const float top = at.y + side * 0.2f;
  ImGui::GetWindowDrawList()->AddRectFilled(ImVec2(at.x, top), ImVec2(at.x + side, top + side), colour);
  ImGui::Dummy(ImVec2(side, side));
  ImGui::SameLine(0, gap);
  ImGui::TextUnformatted(name);
}

// The stages of each iteration, stacked.
void drawStages(const Plots& plots, float width) {
  static constexpr std::array<const char*, 5> kNames = {"select", "generate", "refine", "triangulate", "encode"};
  const std::size_t count = plots.stages.front().size();
  double most = 0, newest = 0;
  for (std::size_t k = 0; k < count; ++k) {
    newest = 0;
    for (const History& stage : plots.stages) newest += static_cast<double>(stage.at(k));
    most = std::max(most, newest);
  }
  const auto colour = [](std::size_t stage) {
    const Colour c = levelColour(static_cast<int>(8 - 2 * stage));
    return ImGui::ColorConvertFloat4ToU32(ImVec4(c[0], c[1], c[2], 1));
  };
  const Frame frame("the server's work on an iteration, ms: " + text(newest), "240 iterations ago", most, width);
  for (std::size_t k = 0; k < count; ++k) {
    double below = 0;
    for (std::size_t stage = 0; stage < plots.stages.size(); ++stage) {
      const double above = below + static_cast<double>(plots.stages[stage].at(k));
      const ImVec2 high = frame.at(count - 1 - k, above), low = frame.at(count - std::min(k + 1, count), below);
      frame.list()->AddRectFilled(high, ImVec2(std::max(low.x, high.x + 1), low.y), colour(stage));
      below = above;
    }
  }
  for (std::size_t stage = 0; stage < kNames.size(); ++stage) drawStageName(kNames[stage], colour(stage), width, stage == 0);
}

}  // namespace

void drawPlots(const Plots& plots, float width) {
  drawPlot("time from picture to picture", "ms", "240 pictures ago", plots.frame, width);
  drawStages(plots, width);
  drawPlot("triangles held", "thousands", "240 half seconds ago", plots.triangles, width);
  drawPlot("received", "kB/s", "240 half seconds ago", plots.bytes, width);
  drawPlot("from a pose to its mesh", "ms", "240 meshes ago", plots.latency, width);
}

}  // namespace ridgecast::viewer
