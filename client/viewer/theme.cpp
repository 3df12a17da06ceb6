#include "client/viewer/theme.h"

#include <imgui.h>
#include <imgui_freetype.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <system_error>

namespace ridgecast::viewer::theme {
namespace {

constexpr const char* kFont = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";
constexpr float kPixels = 14;     // a line of text, 12 of them the letters' em as on the page
constexpr float kMaxPixels = 48;  // larger text is stretched: the texture of all letters has to fit the driver

// Latin, Greek and Cyrillic, for names; quotes, dashes and the ellipsis.
constexpr std::array<ImWchar, 7> kLetters = {0x0020, 0x052f, 0x2010, 0x203a, 0x20ac, 0x20ac, 0};

void setColours(ImGuiStyle& style) {
  const auto set = [&style](ImGuiCol what, const Shade& shade, float alpha = 1) {
    style.Colors[what] = ImGui::ColorConvertU32ToFloat4(packed(shade, alpha));
  };
  constexpr Shade kWhite{0xffffff};
  for (const ImGuiCol edge : {ImGuiCol_Border, ImGuiCol_Separator}) set(edge, kEdge);
  for (const ImGuiCol field : {ImGuiCol_FrameBg, ImGuiCol_PopupBg}) set(field, kField);
  for (const ImGuiCol title : {ImGuiCol_WindowBg, ImGuiCol_TitleBg, ImGuiCol_TitleBgActive}) set(title, kDialog);
  for (const ImGuiCol hovered : {ImGuiCol_FrameBgHovered, ImGuiCol_ButtonHovered, ImGuiCol_HeaderHovered}) set(hovered, kWhite, 0.16f);
  for (const ImGuiCol active : {ImGuiCol_FrameBgActive, ImGuiCol_ButtonActive, ImGuiCol_HeaderActive}) set(active, kWhite, 0.24f);
  for (const ImGuiCol accent :
       {ImGuiCol_CheckMark, ImGuiCol_SliderGrab, ImGuiCol_SliderGrabActive, ImGuiCol_NavHighlight, ImGuiCol_PlotLines})
    set(accent, kAccent);
  set(ImGuiCol_Text, kText);
  set(ImGuiCol_TextDisabled, kMuted);
  set(ImGuiCol_TextSelectedBg, kAccent, 0.4f);
  set(ImGuiCol_Button, kWhite, 0.08f);
  set(ImGuiCol_Header, kAccent, 0.3f);
  set(ImGuiCol_ScrollbarBg, kWhite, 0.04f);
  set(ImGuiCol_ScrollbarGrab, kWhite, 0.25f);
}

void loadFont(float pixels) {
  ImGuiIO& io = ImGui::GetIO();
  io.Fonts->Clear();
  io.Fonts->FontBuilderIO = ImGuiFreeType::GetBuilderForFreeType();
  io.Fonts->FontBuilderFlags = ImGuiFreeTypeBuilderFlags_LightHinting;
  const float loaded = std::round(std::min(pixels, kMaxPixels));
  io.FontGlobalScale = std::max(1.0f, pixels / kMaxPixels);
  std::error_code ignored;
  if (std::filesystem::exists(kFont, ignored)) {
    io.Fonts->AddFontFromFileTTF(kFont, loaded, nullptr, kLetters.data());
    return;
  }
  ImFontConfig own;
  own.SizePixels = loaded;
  io.Fonts->AddFontDefault(&own);
}

}  // namespace

void apply(float scale) {
  ImGuiStyle& style = ImGui::GetStyle() = ImGuiStyle();
  ImGui::StyleColorsDark();
  setColours(style);
  style.WindowRounding = 9;
  style.FrameRounding = style.PopupRounding = style.GrabRounding = style.ScrollbarRounding = 6;
  style.WindowPadding = ImVec2(10, 7);
  style.FramePadding = ImVec2(7, 3);
  style.ScrollbarSize = 12;
  style.WindowTitleAlign = ImVec2(0, 0.5f);
  style.ScaleAllSizes(scale);
  loadFont(kPixels * scale);
}

}  // namespace ridgecast::viewer::theme
