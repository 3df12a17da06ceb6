#pragma once
// The dialogs: settings, worlds and places, who is here; and the bars of the edit mode and the clock. Drawn by Dear ImGui. Internal to the
// room.

#include <cstdint>
#include <optional>
#include <string>

#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

// What the user pressed in the bar of the edit mode since the last frame.
struct EditRequests {
  std::optional<core::Tool> tool;
  std::optional<std::uint32_t> material;
  int notches = 0;  // of the brush's size
  bool here = false, endRoad = false, undo = false;
};

// What the user requested since the last frame, in the panel and the bars.
struct Requests {
  bool settings = false, jump = false, world = false, vsync = false;
  std::optional<std::uint64_t> flyTo;  // a member's camera
  std::optional<std::string> session;  // to enter
  EditRequests edit;
  std::optional<wire::SetClock> clock;
};

struct Area {
  double left = 0, top = 0, right = 0, bottom = 0;  // screen coordinates
};

// The open dialog. `area`: where it takes the mouse.
void drawPanel(ViewerState& state, Requests& requests, Area& area);

// The tools of the edit mode, into the box that is being drawn, of a width that its text wraps at.
EditRequests drawEditBar(const EditMode& edit, float width);
// The session's clock, likewise.
std::optional<wire::SetClock> drawClockBar(core::ClockBar& clock, float width);

}  // namespace ridgecast::viewer
