#include "client/viewer/overlay.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <span>
#include <tuple>
#include <utility>

#include "client/render/difference_pass.h"
#include "client/viewer/leaf_colours.h"
#include "common/keys/keys.h"
#include "common/settings/settings.h"
#include "common/wire/messages.h"

namespace ridgecast::viewer {
namespace {

constexpr ImGuiWindowFlags kPlain = ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                                    ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings |
                                    ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav;
constexpr ImGuiWindowFlags kBehind = kPlain | ImGuiWindowFlags_NoBringToFrontOnFocus, kTold = kPlain | ImGuiWindowFlags_NoInputs;
constexpr float kMargin = 10;  // between a box and the window's sides

ImU32 colourOf(const Colour& c) { return ImGui::ColorConvertFloat4ToU32(ImVec4(c[0], c[1], c[2], 1)); }

constexpr float kPlotWidth = 27;     // in letter heights
constexpr float kLabelLines = 1.5f;  // of the window's lower edge, where the pictures are named

void shadowed(ImDrawList* list, ImVec2 at, const char* text) {
  list->AddText(ImVec2(at.x + 1, at.y + 1), IM_COL32(0, 0, 0, 200), text);
  list->AddText(at, IM_COL32_WHITE, text);
}

// A window of wrapped text; `pivot`: which of its points lies at `at`, in shares of its size. Scrolls by the wheel
// and by PageUp and PageDown if `height` is less than it needs. Returns what the mouse can scroll.
template <class Fill>
Area box(const char* name, ImVec2 at, ImVec2 pivot, float alpha, float height, ImGuiWindowFlags flags, const Fill& fill) {
  const ImGuiStyle& style = ImGui::GetStyle();
  const float width = std::max(ImGui::GetIO().DisplaySize.x - 2 * kMargin, 50.0f);
  Area area;
  ImGui::SetNextWindowPos(at, ImGuiCond_Always, pivot);
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), ImVec2(width, std::max(height, 40.0f)));
  ImGui::SetNextWindowBgAlpha(alpha);
  if (ImGui::Begin(name, nullptr, flags)) {
    ImGui::PushTextWrapPos(width - 2 * style.WindowPadding.x - style.ScrollbarSize);
    fill();
    ImGui::PopTextWrapPos();
    const ImVec2 corner = ImGui::GetWindowPos(), size = ImGui::GetWindowSize();
    const auto pressed = [](ImGuiKey key) { return ImGui::IsKeyPressed(ImGui::GetKeyIndex(key)); };
    if (const int way = pressed(ImGuiKey_PageDown) - pressed(ImGuiKey_PageUp))
      ImGui::SetScrollY(std::clamp(ImGui::GetScrollY() + static_cast<float>(way) * size.y * 0.8f, 0.0f, ImGui::GetScrollMaxY()));
    if (ImGui::GetScrollMaxY() > 0) area = {corner.x, corner.y, corner.x + size.x, corner.y + size.y};
  }
  ImGui::End();
  return area;
}

void label(ImDrawList* list, float x, const char* text, bool alignRight) {
  const ImVec2 size = ImGui::CalcTextSize(text);
  shadowed(list, ImVec2(alignRight ? x - size.x - 10 : x + 10, ImGui::GetIO().DisplaySize.y - size.y - 10), text);
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

// A row of colours with their meanings below a title, at the lower left; `bottom` above the window's lower edge.
struct LegendEntry {
  Colour colour;
  std::string text;
};
void drawLegendRow(float bottom, const std::string& title, std::span<const LegendEntry> entries) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const float line = ImGui::GetTextLineHeight(), y = ImGui::GetIO().DisplaySize.y - bottom;
  float right = 10;
  for (const LegendEntry& entry : entries) right += line + 16 + ImGui::CalcTextSize(entry.text.c_str()).x;
  right = std::max(right, 14 + ImGui::CalcTextSize(title.c_str()).x);
  list->AddRectFilled(ImVec2(4, y - line - 8), ImVec2(right + 4, y + line + 4), IM_COL32(0, 0, 0, 110), 3);
  shadowed(list, ImVec2(10, y - line - 4), title.c_str());
  float x = 10;
  for (const LegendEntry& entry : entries) {
    list->AddRectFilled(ImVec2(x, y), ImVec2(x + line, y + line), colourOf(entry.colour));
    list->AddRect(ImVec2(x, y), ImVec2(x + line, y + line), IM_COL32(255, 255, 255, 160));
    shadowed(list, ImVec2(x + line + 4, y), entry.text.c_str());
    x += line + 16 + ImGui::CalcTextSize(entry.text.c_str()).x;
  }
}

// Returns how far it reaches up from the window's lower edge.
float drawLegend(const ViewerState& s) {
  const float line = ImGui::GetTextLineHeight();
  float bottom = 3 * line + 10;
  std::vector<LegendEntry> entries;
  if (s.mode == Mode::kDifference) {  // instead of the window's own text
    static constexpr std::array<const char*, 5> kShares = {"0", "1/16", "1/8", "3/16", "1/4"};
    for (std::size_t k = 0; k < kShares.size(); ++k) entries.push_back({render::kDifferenceRamp[k], kShares[k]});
    drawLegendRow(line + 10, "difference of mesh and ray march, of the whole range:", entries);
    return 2 * line + 18;
  }
  if (s.mode == Mode::kMarch) return bottom;
  if (s.lines.candidates) {
    for (const double share : {1 / kErrorRange, 0.5, 1.0, 2.0, kErrorRange}) {
      char text[20];
      std::snprintf(text, sizeof text, "%.2g", share * s.statistics.candidateUnit);
      entries.push_back({errorColour(share, 1), text});
    }
    drawLegendRow(bottom, std::to_string(s.statistics.candidates) + " candidates, error in pixels", entries);
    bottom += 2 * line + 14;
  }
  if (s.lines.borders == Borders::kLevel) {
    static constexpr std::array<const char*, 6> kSides = {"32 m", "128 m", "512 m", "2 km", "8 km", "33 km"};
    entries.clear();
    for (std::size_t k = 0; k < kSides.size(); ++k) entries.push_back({levelColour(static_cast<int>(2 * k)), kSides[k]});
    drawLegendRow(bottom, "side of a leaf", entries);
    bottom += 2 * line + 14;
  } else if (s.lines.borders == Borders::kAge) {
    const std::array<LegendEntry, 4> ages = {
        {{ageColour(0), "now"}, {ageColour(4), "4 s"}, {ageColour(16), "16 s"}, {ageColour(kOld), "1 min"}}};
    drawLegendRow(bottom, "a leaf last changed", ages);
    bottom += 2 * line + 14;
  }
  return bottom - line;
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

void drawFigures(const ViewerState& state) {
  const Statistics& s = state.statistics;
  const Motion& m = state.motion;
  ImGui::TextUnformatted(s.world.c_str());
  const char* const mesh = s.corrected ? "corrected mesh" : "mesh";
  if (s.atRest)
    ImGui::Text("at rest   %s %.1f ms", mesh, s.meshMs);
  else
    ImGui::Text("%.0f pictures/s   %s %.1f ms", s.framesPerSecond, mesh, s.meshMs);
  if (s.coarseness > 1)
    ImGui::Text("ray march %.0f ms at 1/%u, finer: %.0f %%", s.marchMs, s.coarseness, s.progress * 100);
  else
    ImGui::Text("ray march %.0f ms", s.marchMs);
  ImGui::Text("%llu triangles in %llu leaves, error %.3g", static_cast<unsigned long long>(s.triangles),
              static_cast<unsigned long long>(s.leaves), s.effectiveThreshold);
  if (s.settled)
    ImGui::Text("iteration %llu, settled", static_cast<unsigned long long>(s.iteration));
  else
    ImGui::Text("iteration %llu, building, %.0f %%, %.1f/s, latency %.0f ms", static_cast<unsigned long long>(s.iteration),
                s.building.share() * 100, s.iterationsPerSecond, s.latencyMs);
  ImGui::Text("%.2f MB received%s", static_cast<double>(s.bytes) / 1e6, s.hashOk ? "" : ", MESH DIFFERS FROM THE SERVER'S");
  ImGui::Text("x %s  y %.1f  z %s m, %.0f m above ground", m.x.c_str(), m.y, m.z.c_str(), m.aboveGround);
  if (const std::size_t others = state.outlines.members.size()) ImGui::Text("%zu other%s here (M)", others, others == 1 ? "" : "s");
  if (!state.smooth) ImGui::TextUnformatted("reduced motion: changes show at once");
  if (state.lines.frozen) ImGui::TextUnformatted("the server's camera is frozen (C)");
  if (m.following) ImGui::TextUnformatted("following the path (O ends it)");
  if (m.keyframes) ImGui::Text("recording, %zu keyframes (R ends it)", *m.keyframes);
  if (s.knownReach > 0) ImGui::Text("height map held for %.1f km around", s.knownReach / 1000);
  ImGui::Text("%s%.3g m/s%s   H help, F2 settings", m.walking ? "walking, " : "", m.speed, m.sprinting ? " x 5" : "");
}

void drawPlot(const char* name, const char* unit, const History& history) {
  char text[64];
  std::snprintf(text, sizeof text, "%s %.4g %s", name, static_cast<double>(history.newest()), unit);
  const auto value = [](void* data, int k) { return static_cast<const History*>(data)->at(static_cast<std::size_t>(k)); };
  ImGui::PlotLines("##plot", value, const_cast<History*>(&history), static_cast<int>(history.size()), 0, text, 0,
                   std::max(history.most() * 1.1f, 1e-3f), ImVec2(ImGui::GetFontSize() * kPlotWidth, ImGui::GetFontSize() * 3.2f));
}

// The stages of each iteration, stacked.
void drawStages(const Plots& plots) {
  static constexpr std::array<const char*, 5> kNames = {"select", "generate", "refine", "triangulate", "encode"};
  const ImVec2 at = ImGui::GetCursorScreenPos(), size(ImGui::GetFontSize() * kPlotWidth, ImGui::GetFontSize() * 4.5f);
  ImDrawList* list = ImGui::GetWindowDrawList();
  list->AddRectFilled(at, ImVec2(at.x + size.x, at.y + size.y), ImGui::GetColorU32(ImGuiCol_FrameBg));
  const std::size_t count = plots.stages.front().size();
  float most = 1e-3f;
  for (std::size_t k = 0; k < count; ++k) {
    float sum = 0;
    for (const History& stage : plots.stages) sum += stage.at(k);
    most = std::max(most, sum);
  }
  const auto colour = [](std::size_t stage) { return colourOf(levelColour(static_cast<int>(8 - 2 * stage))); };
  const float width = size.x / static_cast<float>(History::kLength);
  for (std::size_t k = 0; k < count; ++k) {
    float y = at.y + size.y;
    const float x = at.x + width * static_cast<float>(k);
    for (std::size_t stage = 0; stage < plots.stages.size(); ++stage) {
      const float height = size.y * 0.95f * plots.stages[stage].at(k) / most;
      list->AddRectFilled(ImVec2(x, y - height), ImVec2(x + width, y), colour(stage));
      y -= height;
    }
  }
  ImGui::Dummy(size);
  ImGui::Text("iteration, up to %.1f ms", static_cast<double>(most));
  for (std::size_t stage = 0; stage < kNames.size(); ++stage) {
    if (stage > 0) ImGui::SameLine();
    const ImVec2 square = ImGui::GetCursorScreenPos();
    const float side = ImGui::GetTextLineHeight() * 0.7f, top = square.y + ImGui::GetTextLineHeight() * 0.15f;
    list->AddRectFilled(ImVec2(square.x, top), ImVec2(square.x + side, top + side), colour(stage));
    list->AddRect(ImVec2(square.x, top), ImVec2(square.x + side, top + side), IM_COL32(255, 255, 255, 160));
    ImGui::Dummy(ImVec2(side, side));
    ImGui::SameLine(0, 3);
    ImGui::TextUnformatted(kNames[stage]);
  }
}

void drawPlots(const Plots& plots) {
  drawPlot("frame", "ms", plots.frame);
  drawStages(plots);
  drawPlot("triangles", "thousand", plots.triangles);
  drawPlot("received", "kB/s", plots.bytes);
  drawPlot("latency", "ms", plots.latency);
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
  ImGui::TextUnformatted("Letters are places on a US keyboard.");
}

void drawMessage(const std::string& message) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  box("message", ImVec2(size.x / 2, size.y / 2), ImVec2(0.5f, 0.5f), 0.9f, size.y - 2 * kMargin, kTold, [&] {
    ImGui::PushTextWrapPos(size.x * 0.6f);
    ImGui::TextUnformatted(message.c_str());
    ImGui::PopTextWrapPos();
  });
}

void drawHint(const std::string& hint) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float bottom = size.y - kLabelLines * ImGui::GetTextLineHeight() - kMargin;
  box("hint", ImVec2(size.x / 2, bottom), ImVec2(0.5f, 1), 0.95f, bottom - kMargin, kTold, [&] {
    ImGui::PushTextWrapPos(size.x * 0.8f);
    ImGui::TextUnformatted(hint.c_str());
    ImGui::PopTextWrapPos();
  });
}

// Whether Enter was pressed in the field.
template <std::size_t n>
bool entered(const char* name, std::array<char, n>& text) {
  return ImGui::InputText(name, text.data(), n, ImGuiInputTextFlags_EnterReturnsTrue);
}

bool drawDetail(Panel& p) {
  const auto name = [](void*, int k, const char** out) {
    *out = k == 0 ? "the server's" : settings::kMetrics[static_cast<std::size_t>(k)].name.data();
    return true;
  };
  bool changed = ImGui::Combo("metric", &p.metric, name, nullptr, static_cast<int>(settings::kMetrics.size()));
  const bool thesis = p.metric == static_cast<int>(wire::Metric::kThesis);
  const auto released = [&changed](bool) { changed |= ImGui::IsItemDeactivatedAfterEdit(); };
  released(ImGui::SliderFloat("threshold", &p.threshold, thesis ? 1e-7f : 0.1f, thesis ? 1e-2f : 50.0f, thesis ? "%.2e" : "%.2f",
                              ImGuiSliderFlags_Logarithmic));
  released(ImGui::SliderInt("thousand triangles", &p.triangles, 10, 2000, "%d", ImGuiSliderFlags_Logarithmic));
  released(ImGui::SliderInt("kB/s, 0: all", &p.kilobytes, 0, 20000, "%d", ImGuiSliderFlags_Logarithmic));
  return changed;
}

void drawSettings(Panel& p, bool& smooth, Requests& requests) {
  ImGui::TextDisabled("Detail, for this window alone");
  if (p.live)
    requests.settings = drawDetail(p);
  else
    ImGui::TextUnformatted("This server changes no settings on the way.");
  ImGui::Text("granted: %s", p.granted.c_str());
  ImGui::Separator();
  ImGui::TextDisabled("This window");
  ImGui::Checkbox("smooth changes (off: reduced motion)", &smooth);
  ImGui::Checkbox("invert looking up and down", &p.invertY);
  requests.vsync = ImGui::Checkbox("wait for the screen (vsync)", &p.vsync);
  ImGui::SliderFloat("text", &p.textScale, 0.7f, 3.0f, "x %.1f");
}

void drawWorlds(Panel& p, Requests& requests) {
  ImGui::TextDisabled("Place (metres)");
  if (p.typed) ImGui::SetKeyboardFocusHere();
  requests.jump = entered("x", p.x);
  requests.jump |= entered("z", p.z);
  requests.jump |= entered("above ground", p.altitude);
  requests.jump |= ImGui::Button("Go");
  ImGui::Separator();
  ImGui::TextDisabled("Another world (makes its session, or joins it)");
  requests.world = entered("terrain", p.terrain);
  requests.world |= entered("seed", p.seed);
  requests.world |= ImGui::Button("Go there");
}

void drawPeople(Panel& p, const std::vector<Outlines::Member>& members, Requests& requests) {
  if (members.empty()) ImGui::TextUnformatted("Nobody else. A link (L) brings somebody here.");
  for (const Outlines::Member& member : members) {
    ImGui::PushID(std::to_string(member.camera).c_str());
    const ImVec2 at = ImGui::GetCursorScreenPos();
    const float side = ImGui::GetFrameHeight();
    ImGui::GetWindowDrawList()->AddCircleFilled(ImVec2(at.x + side / 2, at.y + side / 2), side / 4, colourOf(member.colour));
    ImGui::Dummy(ImVec2(side, side));
    ImGui::SameLine();
    if (!member.away)
      ImGui::TextUnformatted(member.text.c_str());
    else if (ImGui::Button(member.text.c_str()))
      requests.flyTo = member.camera;
    ImGui::PopID();
  }
  ImGui::Separator();
  ImGui::Checkbox("show them in the picture", &p.members);
  ImGui::InputText("your name", p.name.data(), p.name.size());
  ImGui::TextDisabled("Others see it from your next connection on.");
}

Requests drawPanel(ViewerState& s, Area& area) {
  Requests requests;
  Panel& p = s.panel;
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x / 2, size.y / 2), ImGuiCond_Appearing, ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), ImVec2(size.x, size.y));
  if (p.typed) ImGui::SetNextWindowFocus();
  static constexpr std::array<const char*, 4> kTitles = {"", "Settings", "Worlds and places", "Who is here"};
  bool open = true;
  if (ImGui::Begin(kTitles[static_cast<std::size_t>(p.dialog)], &open,
                   ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoCollapse)) {
    ImGui::PushItemWidth(std::min(ImGui::GetFontSize() * 16, size.x * 0.45f));
    ImGui::PushTextWrapPos(size.x - 4 * ImGui::GetFontSize());
    if (p.dialog == Dialog::kSettings) drawSettings(p, s.smooth, requests);
    if (p.dialog == Dialog::kWorlds) drawWorlds(p, requests);
    if (p.dialog == Dialog::kPeople) drawPeople(p, s.outlines.members, requests);
    ImGui::PopTextWrapPos();
    if (!p.problem.empty()) {
      ImGui::PushTextWrapPos(ImGui::GetFontSize() * 26);
      ImGui::TextColored(ImVec4(1, 0.75f, 0.3f, 1), "%s", p.problem.c_str());
      ImGui::PopTextWrapPos();
    }
    ImGui::PopItemWidth();
    const ImVec2 at = ImGui::GetWindowPos(), whole = ImGui::GetWindowSize();
    area = {at.x, at.y, at.x + whole.x, at.y + whole.y};
  }
  p.typed = false;
  if (!open) p.dialog = Dialog::kNone;
  ImGui::End();
  return requests;
}

}  // namespace

Overlay::Overlay(GLFWwindow* window, float textScale) : window_(window) {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;
  io.ConfigFlags |= ImGuiConfigFlags_NavEnableKeyboard;
  ImGui::StyleColorsDark();
  // The font is drawn at the screen's scale, so that it stays sharp; the user's scale stretches it.
  float x = 1, y = 1;
  glfwGetWindowContentScale(window, &x, &y);
  int width = 1, height = 1, pixels = 1, pixelsHigh = 1;
  glfwGetWindowSize(window, &width, &height);
  glfwGetFramebufferSize(window, &pixels, &pixelsHigh);
  // If a screen coordinate is more than a pixel, the backend scales by itself.
  const float own = static_cast<float>(pixels) / static_cast<float>(std::max(width, 1));
  const float wanted = std::clamp(std::max(x, y) / std::max(own, 0.1f), 1.0f, 4.0f) * textScale;
  ImFontConfig font;
  font.SizePixels = std::round(13 * wanted);
  io.Fonts->AddFontDefault(&font);
  ImGui::GetStyle().ScaleAllSizes(wanted);
  base_ = textScale;
  ImGui_ImplGlfw_InitForOpenGL(window, false);
  glfwGetCursorPos(window, &mouseX_, &mouseY_);
  ImGui_ImplOpenGL3_Init("#version 330 core");
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

// Help, plots and figures; what is opened later takes the place of what it would cover.
void Overlay::drawBoxes(const ViewerState& state, float legend) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float height = size.y - legend - 2 * kMargin;
  const float plots = ImGui::GetFontSize() * kPlotWidth + 2 * ImGui::GetStyle().WindowPadding.x;
  if (state.help)
    return areas_.push_back(box("help", ImVec2(size.x - kMargin, kMargin), ImVec2(1, 0), 0.85f, height, kBehind, [] { drawHelp(); }));
  if (state.plots)
    areas_.push_back(box("plots", ImVec2(size.x - kMargin, size.y - 3 * kMargin), ImVec2(1, 1), 0.65f, height, kBehind,
                         [&] { drawPlots(state.statistics.plots); }));
  if (state.figures && !(state.plots && figuresWidth_ + plots + 3 * kMargin > size.x))
    areas_.push_back(box("figures", ImVec2(kMargin, kMargin), ImVec2(0, 0), 0.55f, height, kBehind, [&] {
      drawFigures(state);
      figuresWidth_ = ImGui::GetWindowWidth();
    }));
}

Requests Overlay::draw(ViewerState& state) {
  ImGuiIO& io = ImGui::GetIO();
  io.ConfigFlags = state.mouseFree ? io.ConfigFlags & ~ImGuiConfigFlags_NoMouse : io.ConfigFlags | ImGuiConfigFlags_NoMouse;
  io.FontGlobalScale = state.panel.textScale / base_;
  begin(state.panel.open());
  drawLines(state);
  drawDivider(state);
  const float legend = drawLegend(state);
  areas_.clear();
  drawBoxes(state, legend);
  if (!state.message.empty()) drawMessage(state.message);
  if (!state.hint.empty()) drawHint(state.hint);
  Requests requests;
  if (state.panel.open()) requests = drawPanel(state, areas_.emplace_back());
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
