#include "client/viewer/overlay.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <tuple>
#include <utility>

#include "client/render/difference_pass.h"
#include "client/viewer/leaf_colours.h"
#include "client/viewer/plots.h"
#include "client/viewer/theme.h"
#include "common/keys/keys.h"

namespace ridgecast::viewer {
namespace {

constexpr ImGuiWindowFlags kPlain = ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                                    ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings |
                                    ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav;
constexpr ImGuiWindowFlags kBehind = kPlain | ImGuiWindowFlags_NoBringToFrontOnFocus, kTold = kPlain | ImGuiWindowFlags_NoInputs;
constexpr float kMargin = 10;          // between a box and the window's sides
constexpr float kLegendShare = 0.42f;  // of the window's height, at most
constexpr theme::Shade kSolid{theme::kDialog.rgb, 0.95f};

ImU32 colourOf(const Colour& c) { return ImGui::ColorConvertFloat4ToU32(ImVec4(c[0], c[1], c[2], 1)); }

constexpr float kPlotWidth = 30;  // in letter heights

// Of the window's lower edge, where the pictures are named.
float namesHeight() { return 1.2f * ImGui::GetTextLineHeight() + kMargin; }

void shadowed(ImDrawList* list, ImVec2 at, const char* text) {
  list->AddText(ImVec2(at.x + 1, at.y + 1), IM_COL32(0, 0, 0, 200), text);
  list->AddText(at, IM_COL32_WHITE, text);
}

// The width of text in a box of a window's width.
float mostWidth() {
  const ImGuiStyle& style = ImGui::GetStyle();
  return ImGui::GetIO().DisplaySize.x - 2 * kMargin - 2 * style.WindowPadding.x - style.ScrollbarSize;
}

// A window of wrapped text; `pivot`: which of its points lies at `at`, in shares of its size. Scrolls by the wheel
// and by PageUp and PageDown if `height` is less than it needs. Returns where it lies; `scrolls`: whether the mouse can scroll it.
struct Box {
  Area area;
  bool scrolls = false;
};
template <class Fill>
Box box(const char* name, ImVec2 at, ImVec2 pivot, const theme::Shade& ground, float height, ImGuiWindowFlags flags, const Fill& fill) {
  const float width = std::max(ImGui::GetIO().DisplaySize.x - 2 * kMargin, 50.0f);
  Box out;
  ImGui::SetNextWindowPos(at, ImGuiCond_Always, pivot);
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), ImVec2(width, std::max(height, 40.0f)));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, theme::packed(ground));
  if (ImGui::Begin(name, nullptr, flags)) {
    ImGui::PushTextWrapPos(ImGui::GetStyle().WindowPadding.x + mostWidth());
    fill();
    ImGui::PopTextWrapPos();
    const ImVec2 corner = ImGui::GetWindowPos(), size = ImGui::GetWindowSize();
    const auto pressed = [](ImGuiKey key) { return ImGui::IsKeyPressed(ImGui::GetKeyIndex(key)); };
    if (const int way = pressed(ImGuiKey_PageDown) - pressed(ImGuiKey_PageUp))
      ImGui::SetScrollY(std::clamp(ImGui::GetScrollY() + static_cast<float>(way) * size.y * 0.8f, 0.0f, ImGui::GetScrollMaxY()));
    out = {{corner.x, corner.y, corner.x + size.x, corner.y + size.y}, ImGui::GetScrollMaxY() > 0};
  }
  ImGui::End();
  ImGui::PopStyleColor();
  return out;
}

void label(ImDrawList* list, float x, const char* text, bool alignRight) {
  const ImVec2 size = ImGui::CalcTextSize(text), pad(size.y * 0.4f, size.y * 0.1f);
  const ImVec2 at(alignRight ? x - size.x - pad.x - kMargin : x + pad.x + kMargin, ImGui::GetIO().DisplaySize.y - size.y - pad.y - kMargin);
  const ImVec2 from(at.x - pad.x, at.y - pad.y), to(at.x + size.x + pad.x, at.y + size.y + pad.y);
  list->AddRectFilled(from, to, theme::packed(theme::kGlass), size.y * 0.6f);
  list->AddRect(from, to, theme::packed(theme::kEdge), size.y * 0.6f);
  list->AddText(at, theme::packed(theme::kText), text);
}

void drawDivider(const ViewerState& s) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float x = static_cast<float>(s.meshShare()) * size.x;
  if (s.mode == Mode::kSplit) {
    list->AddLine(ImVec2(x, 0), ImVec2(x, size.y), IM_COL32(255, 255, 255, 220), 2);
    list->AddCircleFilled(ImVec2(x, size.y / 2), 7, IM_COL32(255, 255, 255, 220));
  }
  if (s.mode == Mode::kDifference) return;  // its legend says so
  if (s.mode != Mode::kMarch) label(list, x, "mesh", true);
  if (s.mode != Mode::kMesh) label(list, x, "ray march", false);
}

// Colours with their meanings below a title.
struct Legend {
  struct Entry {
    Colour colour;
    std::string text;
  };
  std::string title;
  std::vector<Entry> entries;
};

std::vector<Legend> legendsOf(const ViewerState& s) {
  std::vector<Legend> out;
  if (s.mode == Mode::kMarch) return out;
  if (s.mode == Mode::kDifference) {
    static constexpr std::array<const char*, 5> kShares = {"0", "1/16", "1/8", "3/16", "1/4"};
    Legend& legend = out.emplace_back(Legend{"difference of mesh and ray march, of the whole range", {}});
    for (std::size_t k = 0; k < kShares.size(); ++k) legend.entries.push_back({render::kDifferenceRamp[k], kShares[k]});
    return out;
  }
  if (s.lines.borders == Borders::kLevel) {
    static constexpr std::array<const char*, 6> kSides = {"32 m", "128 m", "512 m", "2 km", "8 km", "33 km"};
    Legend& legend = out.emplace_back(Legend{"side of a leaf", {}});
    for (std::size_t k = 0; k < kSides.size(); ++k) legend.entries.push_back({levelColour(static_cast<int>(2 * k)), kSides[k]});
  } else if (s.lines.borders == Borders::kAge) {
    out.push_back(
        {"a leaf last changed", {{ageColour(0), "now"}, {ageColour(4), "4 s"}, {ageColour(16), "16 s"}, {ageColour(kOld), "1 min"}}});
  }
  if (s.lines.candidates) {
    Legend& legend = out.emplace_back(Legend{std::to_string(s.statistics.candidates) + " candidates, error in pixels", {}});
    for (const double share : {1 / kErrorRange, 0.5, 1.0, 2.0, kErrorRange}) {
      char text[20];
      std::snprintf(text, sizeof text, "%.2g", share * s.statistics.candidateUnit);
      legend.entries.push_back({errorColour(share, 1), text});
    }
  }
  return out;
}

// As many entries in a line as there is room for.
void drawLegend(const Legend& legend) {
  ImGui::TextUnformatted(legend.title.c_str());
  const float line = ImGui::GetTextLineHeight(), between = line, right = mostWidth();
  float used = 0;
  for (const Legend::Entry& entry : legend.entries) {
    const float width = line * 1.3f + ImGui::CalcTextSize(entry.text.c_str()).x;
    if (used > 0 && used + between + width <= right) {
      ImGui::SameLine(0, between);
      used += between + width;
    } else {
      used = width;
    }
    const ImVec2 at = ImGui::GetCursorScreenPos();
    ImDrawList* list = ImGui::GetWindowDrawList();
    list->AddRectFilled(at, ImVec2(at.x + line, at.y + line), colourOf(entry.colour), line / 4);
    list->AddRect(at, ImVec2(at.x + line, at.y + line), theme::packed(theme::kText, 0.6f), line / 4);
    ImGui::Dummy(ImVec2(line, line));
    ImGui::SameLine(0, line * 0.3f);
    ImGui::TextUnformatted(entry.text.c_str());
  }
}

void drawLines(const ViewerState& s) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const auto at = [&size](const Spot& spot) { return ImVec2(static_cast<float>(spot.x) * size.x, static_cast<float>(spot.y) * size.y); };
  if (s.lines.frozen && s.mode != Mode::kMarch && s.mode != Mode::kDifference) {
    list->PushClipRect(ImVec2(0, 0), ImVec2(static_cast<float>(s.meshShare()) * size.x, size.y));
    for (const Segment& line : s.outlines.frozen) list->AddLine(at(line.first), at(line.second), IM_COL32(255, 220, 70, 255), 2);
    list->PopClipRect();
  }
  for (const Outlines::Member& member : s.outlines.members) {
    if (!member.at) continue;
    const ImU32 colour = colourOf(member.colour);
    for (const Segment& line : member.lines) list->AddLine(at(line.first), at(line.second), colour, 2);
    const ImVec2 spot = at(*member.at);
    list->AddCircleFilled(spot, 4, colour);
    shadowed(list, ImVec2(spot.x + 8, spot.y - ImGui::GetTextLineHeight()), member.text.c_str());
  }
}

// As on the page (client/web/src/style.css).
void drawBrush(const EditMode& edit) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const auto at = [&size](const Spot& spot) { return ImVec2(static_cast<float>(spot.x) * size.x, static_cast<float>(spot.y) * size.y); };
  for (const Segment& line : edit.lines) list->AddLine(at(line.first), at(line.second), IM_COL32(13, 19, 26, 191), 4.5f);
  for (const Segment& line : edit.lines) list->AddLine(at(line.first), at(line.second), IM_COL32(255, 209, 102, 255), 2);
}

void drawFigures(const ViewerState& state) {
  const Statistics& s = state.statistics;
  const Motion& m = state.motion;
  ImGui::TextUnformatted(s.world.c_str());
  const char* const mesh = s.drawn.corrected ? "corrected mesh" : "mesh";
  if (s.drawn.atRest)
    ImGui::Text("at rest   %s %.1f ms", mesh, s.drawn.meshMs);
  else
    ImGui::Text("%.0f pictures/s   %s %.1f ms", s.drawn.framesPerSecond, mesh, s.drawn.meshMs);
  if (s.drawn.coarseness > 1)
    ImGui::Text("ray march %.0f ms at 1/%u, finer: %.0f %%", s.drawn.marchMs, s.drawn.coarseness, s.drawn.progress * 100);
  else
    ImGui::Text("ray march %.0f ms", s.drawn.marchMs);
  ImGui::Text("%llu triangles in %llu leaves, error %.3g", static_cast<unsigned long long>(s.triangles),
              static_cast<unsigned long long>(s.leaves), s.effectiveThreshold);
  if (s.settled)
    ImGui::Text("iteration %llu, settled", static_cast<unsigned long long>(s.iteration));
  else
    ImGui::Text("iteration %llu, building, %.0f %%, %.1f/s, latency %.0f ms", static_cast<unsigned long long>(s.iteration),
                s.building.share() * 100, s.iterationsPerSecond, s.latencyMs);
  ImGui::Text("%.2f MB received%s", static_cast<double>(s.bytes) / 1e6, s.hashOk ? "" : ", MESH DIFFERS FROM THE SERVER'S");
  ImGui::Text("x %s  y %.1f  z %s m, %.0f m above ground", m.x.c_str(), m.y, m.z.c_str(), m.aboveGround);
  if (const std::size_t others = state.outlines.others) ImGui::Text("%zu other%s here (M)", others, others == 1 ? "" : "s");
  if (!state.smooth) ImGui::TextUnformatted("reduced motion: changes show at once");
  if (state.lines.frozen) ImGui::TextUnformatted("the server's camera is frozen (C)");
  if (m.following) ImGui::TextUnformatted("following the path (O ends it)");
  if (m.keyframes) ImGui::Text("recording, %zu keyframes (R ends it)", *m.keyframes);
  if (s.knownReach > 0) ImGui::Text("height map held for %.1f km around", s.knownReach / 1000);
  ImGui::Text("%s%.3g m/s%s   H help, F2 settings", m.walking ? "walking, " : "", m.speed, m.sprinting ? " x 5" : "");
}

void drawHelp() {
  const float column = ImGui::GetFontSize() * 7;
  for (const keys::Row& row : keys::table()) {
    if (row.where == "page") continue;
    ImGui::TextUnformatted(row.keys.c_str());
    ImGui::SameLine(column);
    ImGui::TextUnformatted(row.words.c_str());
  }
  ImGui::TextUnformatted("click");
  ImGui::SameLine(column);
  ImGui::TextUnformatted("look around with the mouse; Esc frees it");
  ImGui::TextUnformatted("gamepad");
  ImGui::SameLine(column);
  ImGui::TextUnformatted("sticks fly and look, triggers down and up, shoulders speed,\nA sprint, B walk, X mode, Y wireframe, Start this");
  ImGui::TextUnformatted("Letters name key positions on a US keyboard.");
}

void drawMessage(const std::string& message) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  box("message", ImVec2(size.x / 2, size.y / 2), ImVec2(0.5f, 0.5f), kSolid, size.y - 2 * kMargin, kTold, [&] {
    ImGui::PushTextWrapPos(size.x * 0.6f);
    ImGui::TextUnformatted(message.c_str());
    ImGui::PopTextWrapPos();
  });
}

void drawHint(const std::string& hint) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float bottom = size.y - namesHeight() - kMargin;
  box("hint", ImVec2(size.x / 2, bottom), ImVec2(0.5f, 1), kSolid, bottom - kMargin, kTold, [&] {
    ImGui::PushTextWrapPos(size.x * 0.8f);
    ImGui::TextUnformatted(hint.c_str());
    ImGui::PopTextWrapPos();
  });
}

}  // namespace

Overlay::Overlay(GLFWwindow* window, float textScale) : window_(window) {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;
  io.ConfigFlags |= ImGuiConfigFlags_NavEnableKeyboard;
  // Text is drawn at the screen's scale and the user's, so that it stays sharp.
  float x = 1, y = 1;
  glfwGetWindowContentScale(window, &x, &y);
  int width = 1, height = 1, pixels = 1, pixelsHigh = 1;
  glfwGetWindowSize(window, &width, &height);
  glfwGetFramebufferSize(window, &pixels, &pixelsHigh);
  // If a screen coordinate is more than a pixel, the backend scales by itself.
  const float own = static_cast<float>(pixels) / static_cast<float>(std::max(width, 1));
  screenScale_ = std::clamp(std::max(x, y) / std::max(own, 0.1f), 1.0f, 4.0f);
  ImGui_ImplGlfw_InitForOpenGL(window, false);
  glfwGetCursorPos(window, &mouseX_, &mouseY_);
  ImGui_ImplOpenGL3_Init("#version 330 core");
  dress(textScale);
}

// Between frames.
void Overlay::dress(float textScale) {
  if (std::exchange(textScale_, textScale) == textScale) return;
  ImGui_ImplOpenGL3_DestroyFontsTexture();
  theme::apply(screenScale_ * textScale);
  ImGui_ImplOpenGL3_CreateFontsTexture();
}

Overlay::~Overlay() {
  ImGui_ImplOpenGL3_Shutdown();
  ImGui_ImplGlfw_Shutdown();
  ImGui::DestroyContext();
}

bool Overlay::takesKeys() const { return ImGui::GetIO().WantCaptureKeyboard || events_.holding() || !events_.empty(); }
bool Overlay::takesMouse(double x, double y) const {
  return std::any_of(areas_.begin(), areas_.end(),
                     [x, y](const Area& a) { return x >= a.left && x < a.right && y >= a.top && y < a.bottom; });
}

void Overlay::focus(bool focused) { ImGui_ImplGlfw_WindowFocusCallback(window_, focused); }

// Begins a frame, with the input that it may see.
void Overlay::begin(bool panel) {
  ImGuiIO& io = ImGui::GetIO();
  for (const Event& e : panel ? events_.next() : events_.all()) {
    using Kind = Event::Kind;
    if (e.kind == Kind::kKey) ImGui_ImplGlfw_KeyCallback(window_, e.code, 0, e.down ? GLFW_PRESS : GLFW_RELEASE, 0);
    if (e.kind == Kind::kText) io.AddInputCharacter(static_cast<unsigned>(e.code));
    if (e.kind == Kind::kButton) buttons_[static_cast<std::size_t>(e.code)] = e.down;
    if (e.kind == Kind::kWheel) ImGui_ImplGlfw_ScrollCallback(window_, e.x, e.y);
    if (e.kind == Kind::kMove) std::tie(mouseX_, mouseY_) = std::pair(e.x, e.y);
  }
  ImGui_ImplOpenGL3_NewFrame();
  ImGui_ImplGlfw_NewFrame();
  // The mouse as it was then, not as it is now.
  io.MousePos = ImVec2(static_cast<float>(mouseX_), static_cast<float>(mouseY_));
  for (std::size_t k = 0; k < buttons_.size(); ++k) io.MouseDown[k] = buttons_[k];
  ImGui::NewFrame();
}

// A box in a corner of the window: x, y are 0 (left, top) or 1 (right, bottom, above the pictures' names).
template <class Fill>
void Overlay::place(const char* name, Extent& extent, float x, float y, float height, const Fill& fill) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float bottom = size.y - namesHeight() - kMargin;
  const ImVec2 at(x > 0 ? size.x - kMargin : kMargin, y > 0 ? bottom : top_);
  const Box drawn = box(name, at, ImVec2(x, y), theme::kGlass, height, kBehind, fill);
  extent = {static_cast<float>(drawn.area.right - drawn.area.left), static_cast<float>(drawn.area.bottom - drawn.area.top)};
  if (drawn.scrolls) areas_.push_back(drawn.area);
}

// At the top, one below the other; what lies below begins at top_.
void Overlay::drawBars(ViewerState& state, Requests& requests) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  top_ = kMargin;
  const auto bar = [&](const char* name, const auto& fill) {
    const Area area = box(name, ImVec2(size.x / 2, top_), ImVec2(0.5f, 0), theme::kGlass, size.y, kBehind, fill).area;
    areas_.push_back(area);
    top_ = static_cast<float>(area.bottom) + kMargin;
  };
  if (state.edit.on) bar("edit", [&] { requests.edit = drawEditBar(state.edit, mostWidth()); });
  if (state.clock.on) bar("clock", [&] { requests.clock = drawClockBar(state.clock, mostWidth()); });
  if (ImGui::IsPopupOpen(nullptr, ImGuiPopupFlags_AnyPopup)) areas_.push_back({0, 0, double{size.x}, double{size.y}});
}

// Help or plots at the right, figures and legends at the left. What is at the right takes the place of what it would cover.
void Overlay::drawBoxes(const ViewerState& state) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float height = size.y - namesHeight() - top_ - kMargin;
  if (state.help)
    place("help", right_, 1, 0, height, [] { drawHelp(); });
  else if (state.plots)
    place("plots", right_, 1, 0, height,
          [&] { drawPlots(state.statistics.plots, std::min(ImGui::GetFontSize() * kPlotWidth, mostWidth())); });
  else
    right_ = {};
  const auto fits = [&](const Extent& left) { return right_.width == 0 || left.width + right_.width + 3 * kMargin <= size.x; };
  const auto legends = legendsOf(state);
  const bool legend = !legends.empty() && fits(legend_);
  if (legend)
    place("legend", legend_, 0, 1, kLegendShare * size.y, [&] {
      for (const Legend& one : legends) drawLegend(one);
    });
  const float taken = legend ? legend_.height + kMargin : 0;
  if (state.figures && fits(figures_)) place("figures", figures_, 0, 0, height - taken, [&] { drawFigures(state); });
}

Requests Overlay::draw(ViewerState& state) {
  ImGuiIO& io = ImGui::GetIO();
  io.ConfigFlags = state.mouseFree ? io.ConfigFlags & ~ImGuiConfigFlags_NoMouse : io.ConfigFlags | ImGuiConfigFlags_NoMouse;
  if (!ImGui::IsAnyItemActive()) dress(state.panel.textScale);  // once the slider is let go
  begin(state.panel.open() || state.edit.on || state.clock.on);
  drawLines(state);
  drawBrush(state.edit);
  drawDivider(state);
  areas_.clear();
  const Extent boxes[] = {figures_, legend_, right_, {top_, 0}};
  Requests requests;
  drawBars(state, requests);
  drawBoxes(state);
  state.changed |= !std::ranges::equal(boxes, std::array{figures_, legend_, right_, Extent{top_, 0}});  // their places hang together
  if (!state.message.empty()) drawMessage(state.message);
  if (!state.hint.empty()) drawHint(state.hint);
  if (state.panel.open()) drawPanel(state, requests, areas_.emplace_back());
  state.changed |= !events_.empty();
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
  return requests;
}

void Overlay::drawMessageAlone(const std::string& text) {
  begin(false);
  drawMessage(text);
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

}  // namespace ridgecast::viewer
