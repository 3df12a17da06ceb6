#pragma once
// Text and lines over the two pictures: statistics, plots, help, messages, the panel, the divider, other members, a frozen camera's edges.
// Uses Dear ImGui.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/viewer/event_queue.h"
#include "client/viewer/viewer_state.h"

struct GLFWwindow;

namespace ridgecast::viewer {

// What the user requested in the panel since the last frame.
struct Requests {
  bool settings = false, jump = false, world = false, vsync = false;
  std::optional<std::uint64_t> flyTo;  // a member's camera
};

struct Area {
  double left = 0, top = 0, right = 0, bottom = 0;  // screen coordinates
};

class Overlay {
 public:
  Overlay(GLFWwindow* window, float textScale);  // the context must be current; textScale is relative to the window's own
  ~Overlay();
  Overlay(const Overlay&) = delete;
  Requests draw(ViewerState& state);  // into the window's framebuffer
  void drawMessageAlone(const std::string& text);

  // Input events from the window's callbacks. An open panel sees a frame's worth at a time.
  void hear(const Event& event) { events_.add(event); }
  void focus(bool focused);
  // The panel opens to be typed into, by a key that was just heard: later text is meant for it.
  void awaitTyping() { events_.holdFor(kFramesToFocus); }
  // Whether keys go to the panel, if it is open.
  bool takesKeys() const;
  // Whether clicks and the wheel at this place (screen coordinates) go to the panel or to a box that scrolls.
  bool takesMouse(double x, double y) const;

 private:
  static constexpr int kFramesToFocus = 2;  // until a field that requests keys gets them
  void begin(bool panel);
  void drawBoxes(const ViewerState& state, float legend);
  GLFWwindow* const window_;
  float base_ = 1;
  EventQueue events_;
  std::array<bool, EventQueue::kButtons> buttons_{};
  double mouseX_ = 0, mouseY_ = 0;
  std::vector<Area> areas_;  // that take the mouse, as last drawn
  float figuresWidth_ = 0;   // as last drawn
};

}  // namespace ridgecast::viewer
