#include "client/viewer/overlay.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "client/render/difference_pass.h"
#include "client/viewer/leaf_colours.h"

namespace ridgecast::viewer {
namespace {

constexpr ImGuiWindowFlags kPlain = ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                                    ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav;

ImU32 colourOf(const Colour& c, float alpha = 1) { return ImGui::ColorConvertFloat4ToU32(ImVec4(c[0], c[1], c[2], alpha)); }

constexpr float kPlotWidth = 27;  // in letter heights

void shadowed(ImDrawList* list, ImVec2 at, const char* text) {
  list->AddText(ImVec2(at.x + 1, at.y + 1), IM_COL32(0, 0, 0, 200), text);
  list->AddText(at, IM_COL32_WHITE, text);
}

void label(ImDrawList* list, float x, const char* text, bool alignRight) {
  const ImVec2 size = ImGui::CalcTextSize(text);
  shadowed(list, ImVec2(alignRight ? x - size.x - 10 : x + 10, ImGui::GetIO().DisplaySize.y - size.y - 10), text);
}

void drawDivider(const Shown& shown) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float x = shown.mode == Mode::kSplit ? static_cast<float>(shown.divider) * size.x : shown.mode == Mode::kMesh ? size.x : 0.0f;
  if (shown.mode == Mode::kSplit) {
    list->AddLine(ImVec2(x, 0), ImVec2(x, size.y), IM_COL32(255, 255, 255, 220), 2);
    list->AddCircleFilled(ImVec2(x, size.y / 2), 7, IM_COL32(255, 255, 255, 220));
  }
  if (shown.mode == Mode::kDifference) return;  // its legend says so
  if (shown.mode != Mode::kMarch) label(list, x, "mesh", true);
  if (shown.mode != Mode::kMesh) label(list, x, "ray march", false);
}

// The legend of colours, at the lower left.
void drawLegend(const Shown& s) {
  const bool structure = s.mode == Mode::kMesh || s.mode == Mode::kSplit, differs = s.mode == Mode::kDifference;
  if (!differs && !(structure && (s.candidates || s.borders != Borders::kNone))) return;
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const float line = ImGui::GetTextLineHeight();
  float x = 10, y = ImGui::GetIO().DisplaySize.y - 3 * line - 10, widest = 0;
  list->ChannelsSplit(2);  // text, over its background
  list->ChannelsSetCurrent(1);
  const auto shade = [&] {  // behind the lines from y - line on
    list->ChannelsSetCurrent(0);
    list->AddRectFilled(ImVec2(4, y - line - 8), ImVec2(std::max(x, widest) + 4, y + line + 4), IM_COL32(0, 0, 0, 110), 3);
    list->ChannelsSetCurrent(1);
  };
  const auto title = [&](const char* text) {
    shadowed(list, ImVec2(x, y - line - 4), text);
    widest = x + ImGui::CalcTextSize(text).x + 4;
  };
  const auto entry = [&](const Colour& colour, const char* text) {
    list->AddRectFilled(ImVec2(x, y), ImVec2(x + line, y + line), colourOf(colour));
    list->AddRect(ImVec2(x, y), ImVec2(x + line, y + line), IM_COL32(255, 255, 255, 160));
    shadowed(list, ImVec2(x + line + 4, y), text);
    x += line + 16 + ImGui::CalcTextSize(text).x;
  };
  if (differs) {  // instead of the window's own text
    y += 2 * line;
    title("difference of mesh and ray march, of the whole range:");
    static constexpr std::array<const char*, 5> kShares = {"0", "1/16", "1/8", "3/16", "1/4"};
    for (std::size_t k = 0; k < kShares.size(); ++k) entry(render::kDifferenceRamp[k], kShares[k]);
    shade();
    list->ChannelsMerge();
    return;
  }
  if (s.candidates) {
    char text[80];
    std::snprintf(text, sizeof text, "%zu candidates: error in pixels", s.candidateCount);
    title(text);
    for (const double share : {1 / kErrorRange, 0.5, 1.0, 2.0, kErrorRange}) {
      std::snprintf(text, sizeof text, "%.2g", share * s.candidateUnit);
      entry(errorColour(share, 1), text);
    }
    shade();
    x = 10;
    y -= 2 * line + 14;
  }
  if (s.borders != Borders::kNone) title(s.borders == Borders::kLevel ? "leaves by level: side" : "leaves by age: changed");
  if (s.borders == Borders::kLevel) {
    static constexpr std::array<const char*, 6> kSides = {"32 m", "128 m", "512 m", "2 km", "8 km", "33 km"};
    for (int k = 0; k < 6; ++k) entry(levelColour(2 * k), kSides[static_cast<std::size_t>(k)]);
  } else if (s.borders == Borders::kAge) {
    entry(ageColour(0), "now");
    entry(ageColour(4), "4 s");
    entry(ageColour(16), "16 s");
    entry(ageColour(kOld), "1 min");
  }
  if (s.borders != Borders::kNone) shade();
  list->ChannelsMerge();
}

void drawLines(const Shown& s) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const auto at = [&size](const Spot& spot) { return ImVec2(static_cast<float>(spot.x) * size.x, static_cast<float>(spot.y) * size.y); };
  if (s.frozen && s.mode != Mode::kMarch && s.mode != Mode::kDifference) {
    const float right = s.mode == Mode::kSplit ? static_cast<float>(s.divider) * size.x : size.x;
    list->PushClipRect(ImVec2(0, 0), ImVec2(right, size.y));
    for (const Line& line : s.frozenEdges) list->AddLine(at(line.first), at(line.second), IM_COL32(255, 220, 70, 255), 2);
    list->PopClipRect();
  }
  for (const Marker& marker : s.markers) {
    for (const Line& line : marker.lines) list->AddLine(at(line.first), at(line.second), IM_COL32(80, 220, 255, 255), 2);
    const ImVec2 spot = at(marker.at);
    list->AddCircleFilled(spot, 4, IM_COL32(80, 220, 255, 255));
    shadowed(list, ImVec2(spot.x + 8, spot.y - ImGui::GetTextLineHeight()), marker.name.c_str());
  }
}

void drawFigures(const Shown& s) {
  ImGui::SetNextWindowPos(ImVec2(10, 10));
  ImGui::SetNextWindowBgAlpha(0.55f);
  if (ImGui::Begin("figures", nullptr, kPlain)) {
    ImGui::TextUnformatted(s.world.c_str());
    ImGui::Text("%.0f frames/s   mesh %.1f ms", s.framesPerSecond, s.meshMs);
    if (s.coarseness > 1)
      ImGui::Text("ray march %.0f ms at 1/%u, finer: %.0f %%", s.marchMs, s.coarseness, s.progress * 100);
    else
      ImGui::Text("ray march %.0f ms", s.marchMs);
    ImGui::Text("%llu triangles in %llu leaves", static_cast<unsigned long long>(s.triangles), static_cast<unsigned long long>(s.leaves));
    ImGui::Text("iteration %llu, %.1f/s, latency %.0f ms", static_cast<unsigned long long>(s.iteration), s.iterationsPerSecond,
                s.latencyMs);
    if (s.settled)
      ImGui::TextUnformatted("settled");
    else
      ImGui::Text("building, %.0f %%", s.building * 100);
    ImGui::Text("%.2f MB received%s", static_cast<double>(s.bytes) / 1e6, s.hashOk ? "" : ", MESH DIFFERS FROM THE SERVER'S");
    ImGui::Text("x %s  y %.1f  z %s m, %.0f m above ground", s.x.c_str(), s.y, s.z.c_str(), s.aboveGround);
    if (s.members) ImGui::Text("%zu other%s in this session", s.members, s.members == 1 ? "" : "s");
    if (!s.smooth) ImGui::TextUnformatted("reduced motion: changes show at once (M)");
    if (s.frozen) ImGui::TextUnformatted("the server's camera is frozen (C)");
    if (s.following) ImGui::TextUnformatted("following the path (P ends it)");
    if (s.recording) ImGui::Text("recording, %llu keyframes (R ends it)", static_cast<unsigned long long>(s.keyframes));
    if (s.knownReach > 0) ImGui::Text("height map held for %.1f km around", s.knownReach / 1000);
    ImGui::Text("%s%.3g m/s%s   F1 help, F2 settings", s.walking ? "walking, " : "", s.speed, s.sprinting ? " x 5" : "");
  }
  ImGui::End();
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

void drawPlots(const Shown& s) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x - 10, size.y - 30), ImGuiCond_Always, ImVec2(1, 1));
  ImGui::SetNextWindowBgAlpha(0.65f);
  if (ImGui::Begin("plots", nullptr, kPlain)) {
    drawPlot("frame", "ms", s.history.frame);
    drawStages(s.history);
    drawPlot("triangles", "thousand", s.history.triangles);
    drawPlot("received", "kB/s", s.history.bytes);
    drawPlot("latency", "ms", s.history.latency);
  }
  ImGui::End();
}

void drawHelp(const Shown& s) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x - 10, 10), ImGuiCond_Always, ImVec2(1, 0));
  ImGui::SetNextWindowBgAlpha(0.75f);
  if (ImGui::Begin("help", nullptr, kPlain)) {
    ImGui::TextUnformatted(
        "W A S D      fly forward, left, back, right\n"
        "E / Space    up          Q / Ctrl    down\n"
        "arrows       look around\n"
        "Shift        five times as fast: hold, or tap to keep\n"
        "+ / -        speed (or the mouse wheel)\n"
        "G            walk on the ground\n"
        "1 / 2 / 3    mesh / ray march / both\n"
        "4            their difference as a heat map\n"
        ", / .        move the divider (or drag it)\n"
        "F            edges of the triangles\n"
        "B            leaves by level / by age / not at all\n"
        "C            freeze the camera that the server sees\n"
        "K            candidates for vertices, by their error\n"
        "N            the others in the session\n"
        "M            changes of the mesh: smooth or at once\n"
        "T            the mesh corrected onto the true surface\n"
        "J / L        jump to a place / enter another world\n"
        "R            record a camera path, and end it\n"
        "P            follow that path, or the one of --path\n"
        "V            wait for the screen, or not\n"
        "F2 settings  F3 figures  F4 plots\n"
        "F11 full screen          F12 screenshot\n"
        "Letters are places on a US keyboard.");
    ImGui::TextUnformatted(s.mouseFree ? "click        look around with the mouse\nEsc          close this, then quit"
                                       : "mouse        look around\nEsc          free the mouse");
    ImGui::TextUnformatted(
        "gamepad      sticks fly and look, triggers down and up,\n"
        "             shoulders speed, A sprint, B walk, X mode, Y edges");
  }
  ImGui::End();
}

void drawMessage(const std::string& message) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x / 2, size.y / 2), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowBgAlpha(0.8f);
  if (ImGui::Begin("message", nullptr, kPlain)) {
    ImGui::PushTextWrapPos(size.x * 0.6f);
    ImGui::TextUnformatted(message.c_str());
    ImGui::PopTextWrapPos();
  }
  ImGui::End();
}

void drawHint(const Shown& s) {
  const ImVec2 size = ImGui::GetIO().DisplaySize, text = ImGui::CalcTextSize(s.hint.c_str());
  shadowed(ImGui::GetForegroundDrawList(), ImVec2((size.x - text.x) / 2, size.y - 3 * ImGui::GetTextLineHeight() - 10), s.hint.c_str());
}

template <class Area>
Wishes drawPanel(Shown& s, Area& area) {
  Wishes wishes;
  Choices& c = s.choices;
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x / 2, size.y / 2), ImGuiCond_Appearing, ImVec2(0.5f, 0.5f));
  const Focus focus = std::exchange(s.focus, Focus::kNone);
  if (focus != Focus::kNone) ImGui::SetNextWindowFocus();
  if (ImGui::Begin("Settings", &s.panel,
                   ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoCollapse)) {
    ImGui::PushItemWidth(ImGui::GetFontSize() * 16);
    ImGui::TextDisabled("Go to (metres)");
    if (focus == Focus::kJump) ImGui::SetKeyboardFocusHere();
    bool go = ImGui::InputText("x", c.x.data(), c.x.size(), ImGuiInputTextFlags_EnterReturnsTrue);
    go |= ImGui::InputText("z", c.z.data(), c.z.size(), ImGuiInputTextFlags_EnterReturnsTrue);
    go |= ImGui::InputText("above ground", c.altitude.data(), c.altitude.size(), ImGuiInputTextFlags_EnterReturnsTrue);
    wishes.jump = ImGui::Button("Jump") || go;
    ImGui::Separator();
    ImGui::TextDisabled("Detail, for this window alone");
    if (s.live) {
      static constexpr std::array<const char*, 4> kMetrics = {"the server's", "pixels", "thesis", "area"};
      wishes.settings |= ImGui::Combo("metric", &c.metric, kMetrics.data(), static_cast<int>(kMetrics.size()));
      const bool thesis = c.metric == static_cast<int>(wire::Metric::kThesis);
      ImGui::SliderFloat("threshold", &c.threshold, thesis ? 1e-7f : 0.1f, thesis ? 1e-2f : 50.0f, thesis ? "%.2e" : "%.2f",
                         ImGuiSliderFlags_Logarithmic);
      wishes.settings |= ImGui::IsItemDeactivatedAfterEdit();
      ImGui::SliderInt("thousand triangles", &c.triangles, 10, 2000, "%d", ImGuiSliderFlags_Logarithmic);
      wishes.settings |= ImGui::IsItemDeactivatedAfterEdit();
      ImGui::SliderInt("kB/s, 0: all", &c.kilobytes, 0, 20000, "%d", ImGuiSliderFlags_Logarithmic);
      wishes.settings |= ImGui::IsItemDeactivatedAfterEdit();
    } else {
      ImGui::TextUnformatted("This server changes no settings on the way.");
    }
    ImGui::Text("granted: %s", s.granted.c_str());
    ImGui::Separator();
    ImGui::TextDisabled("Another world (makes its session, or joins it)");
    if (focus == Focus::kWorld) ImGui::SetKeyboardFocusHere();
    bool enter = ImGui::InputText("terrain", c.terrain.data(), c.terrain.size(), ImGuiInputTextFlags_EnterReturnsTrue);
    enter |= ImGui::InputText("seed", c.seed.data(), c.seed.size(), ImGuiInputTextFlags_EnterReturnsTrue);
    wishes.world = ImGui::Button("Enter") || enter;
    ImGui::Separator();
    ImGui::TextDisabled("This window");
    ImGui::Checkbox("smooth changes (off: reduced motion)", &s.smooth);
    ImGui::Checkbox("invert looking up and down", &c.invertY);
    wishes.vsync = ImGui::Checkbox("wait for the screen (vsync)", &c.vsync);
    ImGui::Checkbox("the others in the session", &c.members);
    ImGui::SliderFloat("text", &c.textScale, 0.7f, 3.0f, "x %.1f");
    if (!s.problem.empty()) {
      ImGui::PushTextWrapPos(ImGui::GetFontSize() * 26);
      ImGui::TextColored(ImVec4(1, 0.75f, 0.3f, 1), "%s", s.problem.c_str());
      ImGui::PopTextWrapPos();
    }
    ImGui::PopItemWidth();
    const ImVec2 at = ImGui::GetWindowPos(), whole = ImGui::GetWindowSize();
    area = {at.x, at.y, at.x + whole.x, at.y + whole.y};
  }
  ImGui::End();
  return wishes;
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
// What the panel requested follows from the mouse's place in the last frame.
bool Overlay::takesMouse(double x, double y) const {
  return ImGui::GetIO().WantCaptureMouse || (x >= panel_.left && x < panel_.right && y >= panel_.top && y < panel_.bottom);
}

void Overlay::focus(bool focused) { ImGui_ImplGlfw_WindowFocusCallback(window_, focused); }

// Begins a frame, with the input that it may see.
void Overlay::begin(bool panel) {
  ImGuiIO& io = ImGui::GetIO();
  for (const Event& e : panel ? events_.next() : events_.all()) {
    switch (e.kind) {
      case Event::Kind::kKey:
        ImGui_ImplGlfw_KeyCallback(window_, e.code, 0, e.down ? GLFW_PRESS : GLFW_RELEASE, 0);
        break;
      case Event::Kind::kText:
        io.AddInputCharacter(static_cast<unsigned>(e.code));
        break;
      case Event::Kind::kButton:
        buttons_[static_cast<std::size_t>(e.code)] = e.down;
        break;
      case Event::Kind::kWheel:
        ImGui_ImplGlfw_ScrollCallback(window_, e.x, e.y);
        break;
      case Event::Kind::kMove:
        mouseX_ = e.x;
        mouseY_ = e.y;
        break;
    }
  }
  ImGui_ImplOpenGL3_NewFrame();
  ImGui_ImplGlfw_NewFrame();
  // The mouse as it was then, not as it is now.
  io.MousePos = ImVec2(static_cast<float>(mouseX_), static_cast<float>(mouseY_));
  for (std::size_t k = 0; k < buttons_.size(); ++k) io.MouseDown[k] = buttons_[k];
  ImGui::NewFrame();
}

Wishes Overlay::draw(Shown& shown) {
  ImGuiIO& io = ImGui::GetIO();
  io.ConfigFlags = shown.mouseFree ? io.ConfigFlags & ~ImGuiConfigFlags_NoMouse : io.ConfigFlags | ImGuiConfigFlags_NoMouse;
  io.FontGlobalScale = shown.choices.textScale / base_;
  begin(shown.panel);
  drawLines(shown);
  drawDivider(shown);
  drawLegend(shown);
  if (shown.figures) drawFigures(shown);
  if (shown.plots && !shown.help) drawPlots(shown);
  if (shown.help) drawHelp(shown);
  if (!shown.message.empty()) drawMessage(shown.message);
  if (!shown.hint.empty()) drawHint(shown);
  Wishes wishes;
  panel_ = {};
  if (shown.panel) wishes = drawPanel(shown, panel_);
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
  return wishes;
}

void Overlay::drawMessageAlone(const std::string& text) {
  begin(false);
  drawMessage(text);
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

}  // namespace ridgecast::viewer
