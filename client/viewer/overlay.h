#pragma once
// Text and lines over the two pictures: statistics, plots, help, messages, the panel, the divider, other members, a frozen camera's edges.
// Uses Dear ImGui.

#include <array>
#include <string>
#include <vector>

#include "client/viewer/event_queue.h"
#include "client/viewer/panel.h"
#include "client/viewer/viewer_state.h"

struct GLFWwindow;

namespace ridgecast::viewer {

class Overlay {
 public:
  Overlay(GLFWwindow* window, float textScale);  // the context must be current; textScale is relative to the screen's own
  ~Overlay();
  Overlay(const Overlay&) = delete;
  Requests draw(ViewerState& state);  // into the window's framebuffer
  void drawMessageAlone(const std::string& text);

  // Input events from the window's callbacks. An open panel sees a frame's worth at a time.
  void hear(const Event& event) { events_.add(event); }
  void focus(bool focused);
  // A key just heard opens the panel for typing: later text is meant for it.
  void awaitTyping() { events_.holdFor(kFramesToFocus); }
  // Whether keys go to the panel, if it is open.
  bool takesKeys() const;
  // Whether clicks and the wheel at this place (screen coordinates) go to the panel or to a box that scrolls.
  bool takesMouse(double x, double y) const;

 private:
  static constexpr int kFramesToFocus = 2;  // until a field that requests keys gets them
  // A box's size as last drawn; it lies one frame behind.
  struct Extent {
    float width = 0, height = 0;
    bool operator==(const Extent&) const = default;
  };
  void dress(float textScale);
  void begin(bool panel);
  void drawBars(ViewerState& state, Requests& requests);
  void drawBoxes(const ViewerState& state);
  template <class Fill>
  void place(const char* name, Extent& extent, float x, float y, float height, const Fill& fill);
  GLFWwindow* const window_;
  float screenScale_ = 1, textScale_ = 0;
  EventQueue events_;
  std::array<bool, EventQueue::kButtons> buttons_{};
  double mouseX_ = 0, mouseY_ = 0;
  std::vector<Area> areas_;          // that take the mouse, as last drawn
  Extent figures_, legend_, right_;  // right: help or plots
  float top_ = 0;                    // below which these begin
};

}  // namespace ridgecast::viewer
