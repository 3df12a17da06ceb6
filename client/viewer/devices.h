#pragma once
// Keyboard, mouse and gamepad: what is held or moves becomes Input, what goes down becomes actions. Main thread only.

#include <array>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "client/viewer/controls.h"
#include "client/viewer/overlay.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

struct Action {
  static constexpr int kNone = -2;
  std::string name;  // in common/keys, which has its keys; empty: of a gamepad alone
  std::function<void()> perform;
  int button = kNone;  // of a gamepad, GLFW's number
};

class Devices {
 public:
  // Listens to the window as long as it lives. Passes every event on to the overlay. Performs actions, by the keys of
  // common/keys, at once: within glfwPollEvents() or read(). Drags the divider.
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
  bool onOverlay() const;                                                      // whether the mouse is on what scrolls or is clicked
  bool typing() const { return state_.panel.open() && overlay_.takesKeys(); }  // keys go to the panel
  double width() const;                                                        // screen coordinates, as the mouse's
  void moveDivider(double to);

  GLFWwindow* const window_;
  ViewerState& state_;
  Overlay& overlay_;
  struct Stroke {
    int key = 0;  // GLFW's number
    bool control = false;
    bool types() const { return key < 256 && !control; }  // into the panel, if that has the keys
  };
  static Stroke strokeNamed(const std::string& name);
  const std::vector<Action> actions_;
  std::vector<std::pair<Stroke, const Action*>> strokes_;
  Input input_;
  Sprint sprint_;
  std::optional<std::pair<double, double>> lastCursor_;
  std::set<int> tapped_;  // keys that went down since the last frame
  std::array<bool, 15> padButtons_{};
  bool dragging_ = false;
};

}  // namespace ridgecast::viewer
