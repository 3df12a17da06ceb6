#pragma once
// Keyboard, mouse and gamepad: what is held or moves becomes Input, what goes down becomes actions. Main thread only.

#include <array>
#include <functional>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "client/viewer/controls.h"
#include "client/viewer/overlay.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

// What a key or a gamepad's button (GLFW's numbers) does.
struct Action {
  static constexpr int kNone = -2;
  int key;
  std::function<void()> perform;
  bool whileTyping = false;  // also while the panel has the keys
  int button = kNone;
  bool control = false;  // with Ctrl held; the others only without
};

class Devices {
 public:
  // Listens to the window as long as it lives. Passes every event on to the overlay. Performs actions at once, within glfwPollEvents() or
  // read(). Drags the divider.
  Devices(GLFWwindow* window, ViewerState& state, Overlay& overlay, std::vector<Action> actions);
  ~Devices();
  Devices(const Devices&) = delete;

  // What moves the camera in this frame of `seconds`.
  Input read(double seconds);
  void freeMouse(bool free);

 private:
  void onKey(int key, bool down, bool control);
  void onMove(double x, double y);
  void onButton(int button, bool down);
  void readPad(double seconds);
  bool held(int key) const;
  bool onOverlay() const;                                                    // whether the mouse is on what scrolls or is clicked
  bool typing() const { return state_.panel.open && overlay_.takesKeys(); }  // keys go to the panel
  double width() const;                                                      // screen coordinates, as the mouse's
  void moveDivider(double to);

  GLFWwindow* const window_;
  ViewerState& state_;
  Overlay& overlay_;
  const std::vector<Action> actions_;
  Input input_;
  Sprint sprint_;
  std::optional<std::pair<double, double>> lastCursor_;
  std::set<int> tapped_;  // keys that went down since the last frame
  std::array<bool, 15> padButtons_{};
  bool dragging_ = false;
};

}  // namespace ridgecast::viewer
