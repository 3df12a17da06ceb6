#include "client/viewer/overlay.h"

#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

namespace ridgecast::viewer {
namespace {

constexpr ImGuiWindowFlags kPlain = ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                                    ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav;

void label(ImDrawList* list, float x, const char* text, bool alignRight) {
  const ImVec2 size = ImGui::CalcTextSize(text);
  const ImVec2 at(alignRight ? x - size.x - 10 : x + 10, ImGui::GetIO().DisplaySize.y - size.y - 10);
  list->AddText(ImVec2(at.x + 1, at.y + 1), IM_COL32(0, 0, 0, 200), text);
  list->AddText(at, IM_COL32_WHITE, text);
}

void drawDivider(const Shown& shown) {
  ImDrawList* list = ImGui::GetBackgroundDrawList();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float x = shown.mode == Mode::kSplit ? static_cast<float>(shown.divider) * size.x : shown.mode == Mode::kMesh ? size.x : 0.0f;
  if (shown.mode == Mode::kSplit) {
    list->AddLine(ImVec2(x, 0), ImVec2(x, size.y), IM_COL32(255, 255, 255, 220), 2);
    list->AddCircleFilled(ImVec2(x, size.y / 2), 7, IM_COL32(255, 255, 255, 220));
  }
  if (shown.mode == Mode::kDifference) return label(list, x, "difference of mesh and ray march", false);
  if (shown.mode != Mode::kMarch) label(list, x, "mesh", true);
  if (shown.mode != Mode::kMesh) label(list, x, "ray march", false);
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
    ImGui::Text("iteration %llu, %.1f/s, latency %.0f ms%s", static_cast<unsigned long long>(s.iteration), s.iterationsPerSecond,
                s.latencyMs, s.settled ? ", settled" : "");
    ImGui::Text("%.2f MB received%s", static_cast<double>(s.bytes) / 1e6, s.hashOk ? "" : ", MESH DIFFERS FROM THE SERVER'S");
    ImGui::Text("x %.1f  y %.1f  z %.1f m, %.0f m above ground", s.x, s.y, s.z, s.aboveGround);
    if (!s.smooth) ImGui::TextUnformatted("morphing is off (M)");
    if (s.recording) ImGui::Text("recording, %llu keyframes (R ends it)", static_cast<unsigned long long>(s.keyframes));
    if (s.knownReach > 0) ImGui::Text("height map held for %.1f km around", s.knownReach / 1000);
    ImGui::Text("%.0f m/s   F1 help", s.speed);
  }
  ImGui::End();
}

void drawHelp(const Shown& s) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x - 10, 10), ImGuiCond_Always, ImVec2(1, 0));
  ImGui::SetNextWindowBgAlpha(0.7f);
  if (ImGui::Begin("help", nullptr, kPlain)) {
    ImGui::TextUnformatted(
        "W A S D      fly forward, left, back, right\n"
        "E / Space    up          Q / Ctrl    down\n"
        "Shift        five times as fast\n"
        "mouse wheel  speed\n"
        "1 / 2 / 3    mesh / ray march / both\n"
        "4            their difference as a heat map\n"
        "M            changes of the mesh: smooth or at once\n"
        "R            record a camera path, and end it\n"
        "F12          screenshot\n"
        "<- / ->      move the divider (or drag it)\n"
        "F1 help      F3 figures");
    ImGui::TextUnformatted(s.mouseFree ? "click        look around with the mouse\nEsc          quit"
                                       : "mouse        look around\nEsc          free the mouse");
  }
  ImGui::End();
}

void drawMessage(const Shown& s) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x / 2, size.y / 2), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowBgAlpha(0.8f);
  if (ImGui::Begin("message", nullptr, kPlain)) {
    ImGui::PushTextWrapPos(size.x * 0.6f);
    ImGui::TextUnformatted(s.message.c_str());
    ImGui::PopTextWrapPos();
  }
  ImGui::End();
}

}  // namespace

Overlay::Overlay(GLFWwindow* window) {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGui::GetIO().IniFilename = nullptr;
  ImGui::StyleColorsDark();
  // Chains to the callbacks that the window already has.
  ImGui_ImplGlfw_InitForOpenGL(window, true);
  ImGui_ImplOpenGL3_Init("#version 330 core");
}

Overlay::~Overlay() {
  ImGui_ImplOpenGL3_Shutdown();
  ImGui_ImplGlfw_Shutdown();
  ImGui::DestroyContext();
}

void Overlay::draw(const Shown& shown) {
  ImGui_ImplOpenGL3_NewFrame();
  ImGui_ImplGlfw_NewFrame();
  ImGui::NewFrame();
  drawDivider(shown);
  if (shown.figures) drawFigures(shown);
  if (shown.help) drawHelp(shown);
  if (!shown.message.empty()) drawMessage(shown);
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

}  // namespace ridgecast::viewer
