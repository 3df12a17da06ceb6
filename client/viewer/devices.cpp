#include "client/viewer/devices.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>
#include <cmath>

#include "common/keys/keys.h"
#include "common/outcome/contract.h"

namespace ridgecast::viewer {
namespace {

constexpr double kStill = 6;    // screen coordinates that a click may move
constexpr double kTwice = 0.5;  // seconds between two clicks that are one

Devices& of(GLFWwindow* w) { return *static_cast<Devices*>(glfwGetWindowUserPointer(w)); }

}  // namespace

Devices::Devices(GLFWwindow* window, ViewerState& state, Overlay& overlay, std::vector<Action> actions, BrushHands brush)
    : window_(window), state_(state), overlay_(overlay), actions_(std::move(actions)), brush_(std::move(brush)) {
  for (const Action& action : actions_)
    for (const keys::Row& row : keys::table())
      if (row.action == action.name)
        for (const std::string& stroke : keys::strokesOf(row)) strokes_.emplace_back(strokeNamed(stroke), &action);
  glfwSetWindowUserPointer(window, this);
  glfwSetKeyCallback(window, [](GLFWwindow* w, int key, int, int action, int with) {
    if (action != GLFW_REPEAT) of(w).onKey(key, action == GLFW_PRESS, (with & GLFW_MOD_CONTROL) != 0);
    if (action != GLFW_RELEASE) of(w).onWidth(key);
  });
  glfwSetCharCallback(window, [](GLFWwindow* w, unsigned c) { of(w).overlay_.hear({Event::Kind::kText, static_cast<int>(c)}); });
  glfwSetScrollCallback(window, [](GLFWwindow* w, double x, double notches) {
    of(w).state_.changed = true;
    if (!of(w).onOverlay() && of(w).state_.edit.on)
      of(w).brush_.widen(notches);
    else if (!of(w).onOverlay())
      of(w).input_.wheel += notches;
    of(w).overlay_.hear({Event::Kind::kWheel, 0, false, x, notches});
  });
  glfwSetCursorPosCallback(window, [](GLFWwindow* w, double x, double y) { of(w).onMove(x, y); });
  glfwSetMouseButtonCallback(window, [](GLFWwindow* w, int button, int action, int) { of(w).onButton(button, action == GLFW_PRESS); });
  glfwSetWindowFocusCallback(window, [](GLFWwindow* w, int focused) { of(w).overlay_.focus(focused == GLFW_TRUE); });
}

bool Devices::Stroke::types() const { return (key < 256 || key == GLFW_KEY_ENTER) && !control; }

// "X", "F12", "Esc", "Enter", "Ctrl+Q".
Devices::Stroke Devices::strokeNamed(const std::string& name) {
  if (name.starts_with("Ctrl+")) return {strokeNamed(name.substr(5)).key, true};
  if (name == "Esc") return {GLFW_KEY_ESCAPE};
  if (name == "Enter") return {GLFW_KEY_ENTER};
  if (name.size() > 1 && name.front() == 'F') return {GLFW_KEY_F1 - 1 + std::stoi(name.substr(1))};
  expects(name.size() == 1, "a key that is typed has one letter");
  return {name.front()};  // GLFW's numbers of letters and digits are those of ASCII
}

Devices::~Devices() {
  glfwSetWindowUserPointer(window_, nullptr);
  glfwSetKeyCallback(window_, nullptr);
  glfwSetCharCallback(window_, nullptr);
  glfwSetWindowFocusCallback(window_, nullptr);
  glfwSetScrollCallback(window_, nullptr);
  glfwSetCursorPosCallback(window_, nullptr);
  glfwSetMouseButtonCallback(window_, nullptr);
}

void Devices::freeMouse(bool free) {
  state_.mouseFree = free;
  glfwSetInputMode(window_, GLFW_CURSOR, free ? GLFW_CURSOR_NORMAL : GLFW_CURSOR_DISABLED);
  lastCursor_.reset();
}

void Devices::onKey(int key, bool down, bool control) {
  const bool typed = typing();  // according to the events seen so far
  overlay_.hear({Event::Kind::kKey, key, down});
  if (!down) return;
  state_.changed = true;
  if (!typed && !control) {
    tapped_.insert(key);
    input_.wheel += 2 * ((key == GLFW_KEY_EQUAL || key == GLFW_KEY_KP_ADD) - (key == GLFW_KEY_MINUS || key == GLFW_KEY_KP_SUBTRACT));
  }
  for (const auto& [stroke, action] : strokes_)
    if (stroke.key == key && stroke.control == control && !(typed && stroke.types())) action->perform();
}

void Devices::onWidth(int key) {
  if (const int way = (key == GLFW_KEY_RIGHT_BRACKET) - (key == GLFW_KEY_LEFT_BRACKET); way != 0 && state_.edit.on && !typing())
    brush_.widen(way);
}

double Devices::width() const {
  int width = 0, height = 0;
  glfwGetWindowSize(window_, &width, &height);
  return std::max(width, 1);
}
double Devices::height() const {
  int width = 0, height = 0;
  glfwGetWindowSize(window_, &width, &height);
  return std::max(height, 1);
}

void Devices::moveDivider(double to) {
  state_.divider = std::clamp(to, 0.02, 0.98);
  state_.changed = true;
}

bool Devices::onOverlay() const {
  double x = 0, y = 0;
  glfwGetCursorPos(window_, &x, &y);
  return state_.mouseFree && overlay_.takesMouse(x, y);
}

void Devices::onMove(double x, double y) {
  if (state_.mouseFree && (state_.panel.open() || state_.edit.on || state_.clock.on)) state_.changed = true;
  if (dragging_) moveDivider(x / width());
  turning_ |= pressed_ && !pressed_->isNear(x, y);
  if ((!state_.mouseFree || turning_) && lastCursor_) {
    input_.turnX += x - lastCursor_->first;
    input_.turnY += y - lastCursor_->second;
  }
  lastCursor_ = {x, y};
  overlay_.hear({Event::Kind::kMove, 0, false, x, y});
}

void Devices::onButton(int button, bool down) {
  state_.changed = true;
  if (button == GLFW_MOUSE_BUTTON_LEFT) {
    double x = 0, y = 0;
    glfwGetCursorPos(window_, &x, &y);
    down ? press(x, y) : release(x, y);
  }
  overlay_.hear({Event::Kind::kButton, button, down});
}

void Devices::press(double x, double y) {
  if (!state_.mouseFree || onOverlay()) return;
  dragging_ = state_.mode == Mode::kSplit && std::abs(x - state_.divider * width()) < 10;
  if (dragging_) return;
  if (state_.edit.on)
    pressed_ = {x, y};
  else
    freeMouse(false);
}

void Devices::release(double x, double y) {
  dragging_ = false;
  const bool clicks = pressed_ && !std::exchange(turning_, false) && pressed_->isNear(x, y) && state_.edit.on;
  pressed_.reset();
  if (!clicks) return;
  const Click click{x, y, nowInSeconds()};
  const bool twice = clicked_ && clicked_->isNear(x, y) && click.at - clicked_->at < kTwice;
  clicked_ = twice ? std::nullopt : std::optional(click);
  brush_.click(x / width(), y / height());
  if (twice) brush_.clickTwice();
}

bool Devices::Click::isNear(double otherX, double otherY) const { return std::hypot(x - otherX, y - otherY) <= kStill; }

std::optional<std::pair<double, double>> Devices::pointer() const {
  double x = 0, y = 0;
  glfwGetCursorPos(window_, &x, &y);
  if (!state_.mouseFree || !glfwGetWindowAttrib(window_, GLFW_HOVERED) || overlay_.takesMouse(x, y)) return std::nullopt;
  return std::pair(x / width(), y / height());
}

void Devices::readPad(double seconds) {
  GLFWgamepadstate pad;
  int id = GLFW_JOYSTICK_1;  // the first one found
  while (id <= GLFW_JOYSTICK_LAST && !(glfwJoystickIsGamepad(id) && glfwGetGamepadState(id, &pad))) ++id;
  if (id > GLFW_JOYSTICK_LAST) return;
  GamepadAxes axes;
  std::copy(std::begin(pad.axes), std::end(pad.axes), axes.begin());
  const auto down = [&pad](int button) { return pad.buttons[button] == GLFW_PRESS; };
  addGamepad(input_, axes, down(GLFW_GAMEPAD_BUTTON_A), down(GLFW_GAMEPAD_BUTTON_LEFT_BUMPER), down(GLFW_GAMEPAD_BUTTON_RIGHT_BUMPER),
             seconds);
  for (const Action& action : actions_) {
    if (action.button < 0) continue;
    const bool was = std::exchange(padButtons_[static_cast<std::size_t>(action.button)], down(action.button));
    if (!down(action.button) || was) continue;
    state_.changed = true;
    action.perform();
  }
}

// Or was held: a key pressed and released while a frame is drawn counts for that frame.
bool Devices::held(int key) const { return glfwGetKey(window_, key) == GLFW_PRESS || tapped_.contains(key); }

Input Devices::read(double seconds) {
  bool shift = false;
  if (!typing() && glfwGetKey(window_, GLFW_KEY_LEFT_CONTROL) != GLFW_PRESS && glfwGetKey(window_, GLFW_KEY_RIGHT_CONTROL) != GLFW_PRESS) {
    input_.forward += held(GLFW_KEY_W) - held(GLFW_KEY_S);
    input_.right += held(GLFW_KEY_D) - held(GLFW_KEY_A);
    input_.up += (held(GLFW_KEY_E) || held(GLFW_KEY_SPACE)) - held(GLFW_KEY_Q);
    input_.lookRight += held(GLFW_KEY_RIGHT) - held(GLFW_KEY_LEFT);
    input_.lookUp += held(GLFW_KEY_UP) - held(GLFW_KEY_DOWN);
    if (const int way = held(GLFW_KEY_PERIOD) - held(GLFW_KEY_COMMA)) moveDivider(state_.divider + way * 0.5 * seconds);
    shift = held(GLFW_KEY_LEFT_SHIFT) || held(GLFW_KEY_RIGHT_SHIFT);
  }
  readPad(seconds);
  const bool sprints = sprint_.update(shift, input_.moves(), nowInSeconds());
  if (std::exchange(state_.motion.sprinting, sprints) != sprints || input_.wheel != 0) state_.changed = true;
  input_.sprint |= sprints;
  tapped_.clear();
  return std::exchange(input_, {});
}

}  // namespace ridgecast::viewer
