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

// What the mouse does while the user edits the ground (EditMode::on).
struct BrushHands {
  std::function<void(double x, double y)> click;  // shares of the window, from the top left
  std::function<void()> clickTwice;               // after the second click at one place, soon after the first
  std::function<void(double notches)> widen;      // also by keys
};

class Devices {
 public:
  // Listens to the window as long as it lives. Passes every event on to the overlay. Performs actions, by the keys of
  // common/keys, and `brush` at once: within glfwPollEvents() or read(). Drags the divider.
  Devices(GLFWwindow* window, ViewerState& state, Overlay& overlay, std::vector<Action> actions, BrushHands brush);
  ~Devices();
  Devices(const Devices&) = delete;

  // What moves the camera in this frame of `seconds`.
  Input read(double seconds);
  void freeMouse(bool free);
  // Where the mouse is over the picture, in shares of the window; nothing: it is elsewhere, or on what lies over the picture.
  std::optional<std::pair<double, double>> pointer() const;

 private:
  void onKey(int key, bool down, bool control);
  void onMove(double x, double y);
  void onButton(int button, bool down);
  void press(double x, double y);
  void release(double x, double y);
  void onWidth(int key);
  void readPad(double seconds);
  bool held(int key) const;
  bool onOverlay() const;                                                      // whether the mouse is on what scrolls or is clicked
  bool typing() const { return state_.panel.open() && overlay_.takesKeys(); }  // keys go to the panel
  double width() const;                                                        // screen coordinates, as the mouse's
  double height() const;
  void moveDivider(double to);

  GLFWwindow* const window_;
  ViewerState& state_;
  Overlay& overlay_;
  struct Stroke {
    int key = 0;  // GLFW's number
    bool control = false;
    bool types() const;  // into the panel, if that has the keys
  };
  static Stroke strokeNamed(const std::string& name);
  const std::vector<Action> actions_;
  const BrushHands brush_;
  std::vector<std::pair<Stroke, const Action*>> strokes_;
  Input input_;
  Sprint sprint_;
  std::optional<std::pair<double, double>> lastCursor_;
  std::set<int> tapped_;  // keys that went down since the last frame
  std::array<bool, 15> padButtons_{};
  bool dragging_ = false;
  struct Click {
    double x = 0, y = 0, at = 0;  // screen coordinates, seconds
    bool isNear(double otherX, double otherY) const;
  };
  std::optional<Click> pressed_, clicked_;  // with the brush: down now, until it moves; the last
  bool turning_ = false;                    // the mouse moved on since then, and looks around
};

}  // namespace ridgecast::viewer
