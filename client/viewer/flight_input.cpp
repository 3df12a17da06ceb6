// The user's actions: keys, mouse, gamepad, panel.
#include <cstdio>
#include <cstdlib>

#include "client/viewer/coordinates.h"
#include "client/viewer/flight.h"
#include "client/viewer/gamepad.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace ridgecast::viewer {
namespace {

double nowInSeconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

}  // namespace

Flight& Flight::self(GLFWwindow* w) { return *static_cast<Flight*>(glfwGetWindowUserPointer(w)); }

void Flight::listen() {
  glfwSetWindowUserPointer(handle_, this);
  glfwSetKeyCallback(handle_, [](GLFWwindow* w, int key, int, int action, int) {
    if (action == GLFW_REPEAT) return;
    const bool typed = self(w).typing();  // according to the events seen so far
    self(w).overlay_->hear({Event::Kind::kKey, key, action == GLFW_PRESS});
    if (action == GLFW_PRESS) self(w).onKey(key, typed);
  });
  glfwSetCharCallback(handle_, [](GLFWwindow* w, unsigned c) { self(w).overlay_->hear({Event::Kind::kText, static_cast<int>(c)}); });
  glfwSetScrollCallback(handle_, [](GLFWwindow* w, double x, double notches) {
    self(w).onScroll(notches);
    self(w).overlay_->hear({Event::Kind::kWheel, 0, false, x, notches});
  });
  glfwSetCursorPosCallback(handle_, [](GLFWwindow* w, double x, double y) {
    self(w).onMove(x, y);
    self(w).overlay_->hear({Event::Kind::kMove, 0, false, x, y});
  });
  glfwSetMouseButtonCallback(handle_, [](GLFWwindow* w, int button, int action, int) {
    self(w).onButton(button, action);
    self(w).overlay_->hear({Event::Kind::kButton, button, action == GLFW_PRESS});
  });
  glfwSetWindowFocusCallback(handle_, [](GLFWwindow* w, int focused) { self(w).overlay_->focus(focused == GLFW_TRUE); });
}

void Flight::freeMouse(bool free) {
  shown_.mouseFree = free;
  glfwSetInputMode(handle_, GLFW_CURSOR, free ? GLFW_CURSOR_NORMAL : GLFW_CURSOR_DISABLED);
  lastCursor_.reset();
}

void Flight::hint(std::string text) {
  shown_.hint = std::move(text);
  hintedAt_ = Clock::now();
  changed_ = true;
}

void Flight::nextMode() {
  shown_.mode = shown_.mode == Mode::kSplit   ? Mode::kMesh
                : shown_.mode == Mode::kMesh  ? Mode::kMarch
                : shown_.mode == Mode::kMarch ? Mode::kDifference
                                              : Mode::kSplit;
  restructure();
}

void Flight::toggleFrozen() {
  if (frozen_)
    frozen_.reset();
  else
    frozen_ = camera::Camera{controls_.pose(), projection()};
  sentCamera_ = frozen_;
  hint(frozen_ ? "the server keeps to this camera: fly on and look at it from outside" : "the server follows again");
  restructure();
}

void Flight::togglePath() {
  if (!path_) return hint("no path yet: R records one, or give one by --path FILE.json");
  shown_.following = !shown_.following;
  pathBegan_ = Clock::now();
  changed_ = true;
}

// Unused names: ridgecast-1.json, ridgecast-2.json, ...
std::filesystem::path Flight::freeName(const std::string& ending) {
  for (int k = 1;; ++k) {
    std::filesystem::path file = "ridgecast-" + std::to_string(k) + ending;
    std::error_code ignored;
    if (!std::filesystem::exists(file, ignored)) return file;
  }
}

void Flight::toggleRecord() {
  if (!recorder_) {
    recorder_.emplace(link_.client->world().terrainName, link_.client->world().seed);
    return hint("recording");
  }
  const std::filesystem::path file = freeName(".json");
  const auto written = recorder_->write(file);
  const std::string said = written ? "the path flown is in " + file.string() + "; P follows it" : written.error().message;
  if (auto flown = camera::readPath(file); written && flown) path_ = std::move(*flown);
  std::fprintf(stderr, "%s\n", said.c_str());
  hint(said);
  recorder_.reset();
}

void Flight::openPanel(Focus focus) {
  freeMouse(true);
  shown_.panel = true;
  shown_.focus = focus;
  if (focus != Focus::kNone) overlay_->awaitTyping();
  if (!nextWorld_) shown_.problem.clear();
  std::snprintf(shown_.choices.x.data(), shown_.choices.x.size(), "%s", formatMetres(controls_.pose().x).c_str());
  std::snprintf(shown_.choices.z.data(), shown_.choices.z.size(), "%s", formatMetres(controls_.pose().z).c_str());
  std::snprintf(shown_.choices.altitude.data(), shown_.choices.altitude.size(), "%.0f",
                std::max(2.0, controls_.pose().y - ground({controls_.pose().x, controls_.pose().z}).value_or(0)));
  changed_ = true;
}

// Escape first ends what is waiting or open, then frees the mouse, then closes the window.
void Flight::onEscape() {
  if (nextWorld_)
    giveUpWorld();
  else if (shown_.panel)
    shown_.panel = false;
  else if (!shown_.mouseFree)
    freeMouse(true);
  else if (shown_.help)
    shown_.help = false;
  else
    glfwSetWindowShouldClose(handle_, GLFW_TRUE);
}

void Flight::onKey(int key, bool typed) {
  changed_ = true;
  switch (key) {  // those that the panel ignores
    case GLFW_KEY_ESCAPE:
      return onEscape();
    case GLFW_KEY_F1:
      shown_.help = !shown_.help;
      return;
    case GLFW_KEY_F2:
      return shown_.panel ? void(shown_.panel = false) : openPanel(Focus::kNone);
    case GLFW_KEY_F3:
      shown_.figures = !shown_.figures;
      return;
    case GLFW_KEY_F4:
      shown_.plots = !shown_.plots;
      return;
    case GLFW_KEY_F11:
      return window_.toggleFullScreen();
    case GLFW_KEY_F12:
      wantsScreenshot_ = true;
      return;
    default:
      break;
  }
  if (typed) return;
  tapped_.insert(key);
  const auto show = [this](Mode mode) {
    shown_.mode = mode;
    restructure();
  };
  switch (key) {
    case GLFW_KEY_1:
      return show(Mode::kMesh);
    case GLFW_KEY_2:
      return show(Mode::kMarch);
    case GLFW_KEY_3:
      return show(Mode::kSplit);
    case GLFW_KEY_4:
      return show(Mode::kDifference);
    case GLFW_KEY_F:
      shown_.wireframe = !shown_.wireframe;
      return restructure();
    case GLFW_KEY_B:
      shown_.borders = shown_.borders == Borders::kNone    ? Borders::kLevel
                       : shown_.borders == Borders::kLevel ? Borders::kAge
                                                           : Borders::kNone;
      return restructure();
    case GLFW_KEY_C:
      return toggleFrozen();
    case GLFW_KEY_K:
      return wantCandidates(!shown_.candidates);
    case GLFW_KEY_G:
      controls_.setWalking(!controls_.walking());
      return hint(controls_.walking() ? "walking" : "flying");
    case GLFW_KEY_N:
      shown_.choices.members = !shown_.choices.members;
      return;
    case GLFW_KEY_M:
      shown_.smooth = !shown_.smooth;
      return;
    case GLFW_KEY_T:
      shown_.corrected = !shown_.corrected;
      mesh_.setCorrected(shown_.corrected);
      changed_ = true;
      return hint(!terrain_          ? "this terrain's function is not known here"
                  : shown_.corrected ? "the mesh, corrected onto the true surface"
                                     : "the mesh as it is");
    case GLFW_KEY_J:
      return openPanel(Focus::kJump);
    case GLFW_KEY_L:
      return openPanel(Focus::kWorld);
    case GLFW_KEY_R:
      return toggleRecord();
    case GLFW_KEY_P:
      return togglePath();
    case GLFW_KEY_V:
      window_.setVsync(!window_.vsync());
      shown_.choices.vsync = window_.vsync();
      return hint(window_.vsync() ? "frames wait for the screen" : "frames do not wait for the screen");
    case GLFW_KEY_EQUAL:
    case GLFW_KEY_KP_ADD:
      input_.wheel += 2;
      return;
    case GLFW_KEY_MINUS:
    case GLFW_KEY_KP_SUBTRACT:
      input_.wheel -= 2;
      return;
    default:
      return;
  }
}

double Flight::windowWidth() const {
  int width = 0, height = 0;
  glfwGetWindowSize(handle_, &width, &height);
  return std::max(width, 1);
}

void Flight::moveDivider(double to) {
  shown_.divider = std::clamp(to, 0.02, 0.98);
  changed_ = true;
}

bool Flight::onPanel() const {
  double x = 0, y = 0;
  glfwGetCursorPos(handle_, &x, &y);
  return shown_.panel && shown_.mouseFree && overlay_->takesMouse(x, y);
}

void Flight::onScroll(double notches) {
  changed_ = true;
  if (!onPanel()) input_.wheel += notches;
}

void Flight::onMove(double x, double y) {
  if (shown_.mouseFree && shown_.panel) changed_ = true;
  if (dragging_) moveDivider(x / windowWidth());
  if (!shown_.mouseFree && lastCursor_) {
    input_.turnX += x - lastCursor_->first;
    input_.turnY += y - lastCursor_->second;
  }
  lastCursor_ = {x, y};
}

void Flight::onButton(int button, int action) {
  changed_ = true;
  if (button != GLFW_MOUSE_BUTTON_LEFT) return;
  if (action == GLFW_RELEASE) {
    dragging_ = false;
    return;
  }
  if (!shown_.mouseFree || onPanel()) return;
  double x = 0, y = 0;
  glfwGetCursorPos(handle_, &x, &y);
  if (shown_.mode == Mode::kSplit && std::abs(x - shown_.divider * windowWidth()) < 10)
    dragging_ = true;
  else
    freeMouse(false);
}

void Flight::onPad(double seconds) {
  GLFWgamepadstate state;
  for (int id = GLFW_JOYSTICK_1; id <= GLFW_JOYSTICK_LAST; ++id) {
    if (!glfwJoystickIsGamepad(id) || !glfwGetGamepadState(id, &state)) continue;
    GamepadAxes axes;
    std::copy(std::begin(state.axes), std::end(state.axes), axes.begin());
    const auto down = [&state](int button) { return state.buttons[button] == GLFW_PRESS; };
    addGamepad(input_, axes, down(GLFW_GAMEPAD_BUTTON_A), down(GLFW_GAMEPAD_BUTTON_LEFT_BUMPER), down(GLFW_GAMEPAD_BUTTON_RIGHT_BUMPER),
               seconds);
    const auto pressed = [&](int button) {
      const bool was = std::exchange(padButtons_[static_cast<std::size_t>(button)], down(button));
      return down(button) && !was;
    };
    static constexpr std::array<std::pair<int, int>, 5> kKeys = {{{GLFW_GAMEPAD_BUTTON_B, GLFW_KEY_G},
                                                                  {GLFW_GAMEPAD_BUTTON_Y, GLFW_KEY_F},
                                                                  {GLFW_GAMEPAD_BUTTON_START, GLFW_KEY_F1},
                                                                  {GLFW_GAMEPAD_BUTTON_BACK, GLFW_KEY_B},
                                                                  {GLFW_GAMEPAD_BUTTON_LEFT_THUMB, GLFW_KEY_C}}};
    for (const auto& [button, key] : kKeys)
      if (pressed(button)) onKey(key, typing());
    if (pressed(GLFW_GAMEPAD_BUTTON_X)) nextMode();
    return;  // the first one found
  }
}

// Or was held: a key pressed and released while a frame is drawn counts for that frame.
bool Flight::held(int key) const { return glfwGetKey(handle_, key) == GLFW_PRESS || tapped_.contains(key); }

// Along the path, until its end or until the user steers.
void Flight::follow() {
  const double t = std::chrono::duration<double>(Clock::now() - pathBegan_).count();
  const bool steers = input_.forward != 0 || input_.right != 0 || input_.up != 0;
  if (!steers) {
    const double at = std::min(t, path_->duration());
    controls_.place(camera::poseAt(*path_, at, [this](lattice::Point p) { return ground(p).value_or(0); }));
  }
  if (!steers && t <= path_->duration()) return;
  shown_.following = false;
  changed_ = true;
}

void Flight::fly(double seconds) {
  if (!typing()) {
    input_.forward += held(GLFW_KEY_W) - held(GLFW_KEY_S);
    input_.right += held(GLFW_KEY_D) - held(GLFW_KEY_A);
    input_.up +=
        (held(GLFW_KEY_E) || held(GLFW_KEY_SPACE)) - (held(GLFW_KEY_Q) || held(GLFW_KEY_LEFT_CONTROL) || held(GLFW_KEY_RIGHT_CONTROL));
    input_.lookRight += held(GLFW_KEY_RIGHT) - held(GLFW_KEY_LEFT);
    input_.lookUp += held(GLFW_KEY_UP) - held(GLFW_KEY_DOWN);
    if (const int way = held(GLFW_KEY_PERIOD) - held(GLFW_KEY_COMMA)) moveDivider(shown_.divider + way * 0.5 * seconds);
  }
  const bool shift = !typing() && (held(GLFW_KEY_LEFT_SHIFT) || held(GLFW_KEY_RIGHT_SHIFT));
  onPad(seconds);
  const bool moves = input_.forward != 0 || input_.right != 0 || input_.up != 0;
  const bool sprints = sprint_.update(shift, moves, nowInSeconds());
  if (sprints != shown_.sprinting) changed_ = true;
  shown_.sprinting = sprints;
  input_.sprint |= sprints;
  if (input_.wheel != 0) changed_ = true;
  controls_.setInvertY(shown_.choices.invertY);
  if (shown_.following) follow();
  controls_.step(input_, seconds, [this](lattice::Point p) { return ground(p); });
  input_ = {};
  tapped_.clear();
}

// ---- the panel ----

void Flight::grant(const Wishes& wishes) {
  if (wishes.vsync) window_.setVsync(shown_.choices.vsync);
  if (wishes.settings) changeSettings();
  if (wishes.jump) jump();
  if (wishes.world) enterWorld();
}

void Flight::jump() {
  const auto x = parseMetres(shown_.choices.x.data()), z = parseMetres(shown_.choices.z.data());
  char* end = nullptr;
  const double altitude = std::strtod(shown_.choices.altitude.data(), &end);
  shown_.problem = !x   ? x.error().message
                   : !z ? z.error().message
                   : end == shown_.choices.altitude.data() || *end || !(altitude >= 1 && altitude <= 30000)
                       ? "above ground: 1 to 30000 metres are wanted"
                       : "";
  changed_ = true;
  if (!shown_.problem.empty()) return;
  camera::Pose pose = controls_.pose();
  pose.x = *x;
  pose.z = *z;
  pose.remainderX = pose.remainderZ = 0;
  // While the ground is unknown, above all ground that there may be nearby; the true height arrives soon.
  pose.y = ground({pose.x, pose.z}).value_or(std::max(0.0, controls_.pose().y)) + altitude;
  controls_.place(pose);
  boundsAt_.reset();
  shown_.following = shown_.panel = false;
}

void Flight::enterWorld() {
  if (nextWorld_) return;
  const std::string terrain = shown_.choices.terrain.data(), seed = shown_.choices.seed.data();
  std::uint32_t number = 0;
  const auto parsed = std::from_chars(seed.data(), seed.data() + seed.size(), number);
  const bool plain = !terrain.empty() && std::all_of(terrain.begin(), terrain.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '.' || c == '_' || c == '-';
  });
  changed_ = true;
  if (!plain || terrain.size() > 40)
    return void(shown_.problem =
                    "'" + terrain.substr(0, 60) + "' is no terrain's name: letters, digits, . _ - are, at most 40, such as canyon");
  if (parsed.ec != std::errc() || parsed.ptr != seed.data() + seed.size())
    return void(shown_.problem = "'" + seed + "' is no seed: a whole number from 0 to 4294967295 is wanted");
  connection::Url url = link_.url;
  url.session = terrain + "-" + std::to_string(number);
  url.world = "terrain=" + terrain + "&seed=" + std::to_string(number);
  shown_.problem = "entering ...";
  nextWorld_.emplace(url, link_.settings);
}

}  // namespace ridgecast::viewer
