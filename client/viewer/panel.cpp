#include "client/viewer/panel.h"

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <string>

#include "client/viewer/theme.h"
#include "common/edits/operation.h"
#include "common/settings/settings.h"
#include "common/terrain/materials.h"
#include "common/wire/messages.h"

namespace ridgecast::viewer {
namespace {

// Whether Enter was pressed in the field.
template <std::size_t n>
bool entered(const char* name, std::array<char, n>& text) {
  return ImGui::InputText(name, text.data(), n, ImGuiInputTextFlags_EnterReturnsTrue);
}

// Also by Enter, when the keyboard is on it.
bool button(const char* text) {
  const bool clicked = ImGui::Button(text);
  return clicked || (ImGui::IsItemFocused() && ImGui::IsKeyPressed(ImGui::GetKeyIndex(ImGuiKey_Enter)));
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
  released(ImGui::SliderInt("kB/s, 0: unlimited", &p.kilobytes, 0, 20000, "%d", ImGuiSliderFlags_Logarithmic));
  return changed;
}

void drawSettings(Panel& p, bool& smooth, Requests& requests) {
  ImGui::TextDisabled("Detail, for this window alone");
  if (p.live)
    requests.settings = drawDetail(p);
  else
    ImGui::TextUnformatted("This server cannot change settings during a stream.");
  ImGui::Text("granted: %s", p.granted.c_str());
  ImGui::Separator();
  ImGui::TextDisabled("This window");
  ImGui::Checkbox("smooth changes (off: reduced motion)", &smooth);
  ImGui::Checkbox("invert looking up and down", &p.invertY);
  requests.vsync = ImGui::Checkbox("wait for the screen (vsync)", &p.vsync);
  ImGui::SliderFloat("text", &p.textScale, 0.7f, 3.0f, "x %.1f");
}

void drawSessions(Panel& p, Requests& requests) {
  ImGui::TextDisabled("The server's sessions");
  if (!p.offer.problem.empty()) ImGui::TextUnformatted(p.offer.problem.c_str());
  for (const Worlds::Session& session : p.offer.worlds.sessions) {
    const std::string text =
        session.name + ": " + session.terrain + ", seed " + std::to_string(session.seed) + ", " + std::to_string(session.members) + " here";
    if (session.name == p.offer.here)
      ImGui::TextDisabled("%s; yours", text.c_str());
    else if (button(text.c_str()))
      requests.session = session.name;
  }
}

void drawTerrains(Panel& p, Requests& requests) {
  ImGui::TextDisabled("Another world (makes its session, or joins it)");
  requests.world = entered("terrain", p.terrain);
  requests.world |= entered("seed", p.seed);
  requests.world |= button("Go there");
  for (const Worlds::Terrain& terrain : p.offer.worlds.terrains) {
    if (button(terrain.name.c_str())) {
      std::snprintf(p.terrain.data(), p.terrain.size(), "%s", terrain.name.c_str());
      requests.world = true;
    }
    ImGui::SameLine();
    ImGui::TextUnformatted(terrain.summary.c_str());
  }
}

void drawWorlds(Panel& p, Requests& requests) {
  ImGui::TextDisabled("Place (metres)");
  if (p.typed) ImGui::SetKeyboardFocusHere();
  requests.jump = entered("x", p.x);
  requests.jump |= entered("z", p.z);
  requests.jump |= entered("above ground", p.altitude);
  requests.jump |= button("Go");
  ImGui::Separator();
  drawSessions(p, requests);
  ImGui::Separator();
  drawTerrains(p, requests);
}

void drawPeople(Panel& p, const Outlines& outlines, Requests& requests) {
  const std::vector<Outlines::Member>& members = outlines.members;
  if (outlines.others == 0) ImGui::TextUnformatted("Nobody else. A link (L) brings somebody here.");
  for (const Outlines::Member& member : members) {
    ImGui::PushID(std::to_string(member.camera).c_str());
    const ImVec2 at = ImGui::GetCursorScreenPos();
    const float side = ImGui::GetFrameHeight();
    ImGui::GetWindowDrawList()->AddCircleFilled(
        ImVec2(at.x + side / 2, at.y + side / 2), side / 4,
        ImGui::ColorConvertFloat4ToU32(ImVec4(member.colour[0], member.colour[1], member.colour[2], 1)));
    ImGui::Dummy(ImVec2(side, side));
    ImGui::SameLine();
    if (!member.away)
      ImGui::TextUnformatted(member.text.c_str());
    else if (button(member.text.c_str()))
      requests.flyTo = member.camera;
    ImGui::PopID();
  }
  if (outlines.others > members.size()) ImGui::Text("and %zu farther away", outlines.others - members.size());
  ImGui::Separator();
  ImGui::Checkbox("show them in the picture", &p.members);
  ImGui::InputText("your name", p.name.data(), p.name.size());
  ImGui::TextDisabled("Others see it after your next connection.");
}

// In the line of the last item if there is room.
void inLine(float right, float width) {
  ImGui::SameLine();
  if (ImGui::GetCursorPosX() + width > right) ImGui::NewLine();
}

bool tool(const char* name, float right, bool chosen = false) {
  inLine(right, ImGui::CalcTextSize(name).x + 2 * ImGui::GetStyle().FramePadding.x);
  if (chosen) {
    ImGui::PushStyleColor(ImGuiCol_Button, theme::packed(theme::kAccent));
    ImGui::PushStyleColor(ImGuiCol_ButtonHovered, theme::packed(theme::kAccent));
    ImGui::PushStyleColor(ImGuiCol_Text, theme::packed(theme::kOnAccent));
  }
  const bool pressed = ImGui::Button(name);
  if (chosen) ImGui::PopStyleColor(3);
  return pressed;
}

}  // namespace

EditRequests drawEditBar(const EditMode& edit, float width) {
  EditRequests requests;
  const float right = ImGui::GetCursorPosX() + width, letter = ImGui::GetFontSize();
  ImGui::Dummy({0, 0});
  for (std::size_t k = 0; k < core::kToolNames.size(); ++k)
    if (const auto which = static_cast<core::Tool>(k); tool(core::kToolNames[k], right, which == edit.tool)) requests.tool = which;
  const auto material = [](std::uint32_t k) { return k == 0 ? "as it is" : terrain::kMaterials[k - 1]; };
  inLine(right, 7 * letter);
  ImGui::SetNextItemWidth(7 * letter);
  if (ImGui::BeginCombo("##material", material(edit.material), ImGuiComboFlags_HeightLargest)) {
    for (std::uint32_t k = 0; k <= edits::kMaterials; ++k)
      if (ImGui::Selectable(material(k), k == edit.material)) requests.material = k;
    ImGui::EndCombo();
  }
  requests.notches -= tool("-", right);
  requests.notches += tool("+", right);
  const float words = std::max(ImGui::CalcTextSize(edit.words.c_str()).x, 14 * letter);  // what follows stays where it is
  inLine(right, words);
  const float after = ImGui::GetCursorPosX() + words;
  ImGui::AlignTextToFramePadding();
  ImGui::TextUnformatted(edit.words.c_str());
  ImGui::SameLine(after);
  ImGui::Dummy({0, 0});
  requests.here = tool("Here", right);
  ImGui::BeginDisabled(!edit.mayUndo);
  requests.undo = tool("Undo", right);
  ImGui::EndDisabled();
  if (edit.tool == core::Tool::kRoad) requests.endRoad = tool("End road", right);
  return requests;
}

std::optional<wire::SetClock> drawClockBar(core::ClockBar& clock, float width) {
  std::optional<wire::SetClock> request;
  const float right = ImGui::GetCursorPosX() + width, letter = ImGui::GetFontSize();
  const auto words = [&](const std::string& text, float least) {
    const float room = std::max(ImGui::CalcTextSize(text.c_str()).x, least * letter);  // what follows stays where it is
    inLine(right, room);
    const float after = ImGui::GetCursorPosX() + room;
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(text.c_str());
    ImGui::SameLine(after);
    ImGui::Dummy({0, 0});
  };
  ImGui::Dummy({0, 0});
  words(core::clockText(clock.dragged ? static_cast<std::uint64_t>(*clock.dragged * 1e6f) : clock.time) +
            (clock.end == 0 ? "" : " / " + core::clockText(clock.end)),
        clock.end == 0 ? 4 : 8);
  ImGui::BeginDisabled(!clock.driver.empty());
  if (clock.end != 0 && clock.jumps) {
    float at = clock.dragged.value_or(static_cast<float>(clock.time) / 1e6f);
    inLine(right, 14 * letter);
    ImGui::SetNextItemWidth(14 * letter);
    ImGui::SliderFloat("##time", &at, 0, static_cast<float>(clock.end) / 1e6f, "", ImGuiSliderFlags_AlwaysClamp | ImGuiSliderFlags_NoInput);
    if (ImGui::IsItemDeactivatedAfterEdit()) request = core::movedTo(clock, static_cast<std::uint64_t>(at * 1e6f));
    clock.dragged = ImGui::IsItemActive() ? std::optional(at) : std::nullopt;
    if (tool("-10 s", right)) request = core::movedBy(clock, -core::kClockSkip);
  }
  if (tool(clock.isOver() ? "Again" : clock.runs ? "Pause" : "Resume", right)) request = core::toggled(clock);
  if (clock.jumps && tool("+10 s", right)) request = core::movedBy(clock, core::kClockSkip);
  if (tool("Slower", right)) request = core::faster(clock, false);
  words(core::rateText(clock.rate), 2.5f);
  if (tool("Faster", right)) request = core::faster(clock, true);
  ImGui::EndDisabled();
  if (!clock.driver.empty()) words(clock.driver + " owns it", 0);
  return request;
}

void drawPanel(ViewerState& s, Requests& requests, Area& area) {
  Panel& p = s.panel;
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(size.x / 2, size.y / 2), ImGuiCond_Appearing, ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSizeConstraints(ImVec2(0, 0), ImVec2(size.x, size.y));
  if (p.typed) ImGui::SetNextWindowFocus();
  static constexpr std::array<const char*, 4> kTitles = {"", "Settings", "Worlds and places", "Who is here"};
  bool open = true;
  if (ImGui::Begin(kTitles[static_cast<std::size_t>(p.dialog)], &open,
                   ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoCollapse)) {
    ImGui::PushItemWidth(std::min(ImGui::GetFontSize() * 16, size.x * 0.36f));
    ImGui::PushTextWrapPos(size.x - 4 * ImGui::GetFontSize());
    if (p.dialog == Dialog::kSettings) drawSettings(p, s.smooth, requests);
    if (p.dialog == Dialog::kWorlds) drawWorlds(p, requests);
    if (p.dialog == Dialog::kPeople) drawPeople(p, s.outlines, requests);
    ImGui::PopTextWrapPos();
    if (!p.problem.empty()) {
      ImGui::PushTextWrapPos(ImGui::GetFontSize() * 26);
      ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(theme::packed(theme::kWarning)), "%s", p.problem.c_str());
      ImGui::PopTextWrapPos();
    }
    ImGui::PopItemWidth();
    const ImVec2 whole = ImGui::GetWindowSize(), old = ImGui::GetWindowPos();
    // It grows when the server's list comes, and stays in sight.
    const ImVec2 at(std::max(0.0f, std::min(old.x, size.x - whole.x)), std::max(0.0f, std::min(old.y, size.y - whole.y)));
    if (at.x != old.x || at.y != old.y) ImGui::SetWindowPos(at);  // which ends the centring of a window just opened
    area = {at.x, at.y, at.x + whole.x, at.y + whole.y};
  }
  p.typed = false;
  if (!open) p.dialog = Dialog::kNone;
  ImGui::End();
}

}  // namespace ridgecast::viewer
