#pragma once
// Text and lines over the two pictures: statistics, plots, help, messages, the panel, the divider, other members, a frozen camera's edges.
// Uses Dear ImGui.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "client/viewer/event_queue.h"
#include "client/viewer/history.h"
#include "client/viewer/project.h"
#include "common/wire/messages.h"

struct GLFWwindow;

namespace ridgecast::viewer {

enum class Mode { kMesh, kMarch, kSplit, kDifference };
enum class Borders { kNone, kLevel, kAge };
enum class Focus { kNone, kJump, kWorld };  // of the panel, when it opens: the field to type in

// What the panel shows and the user changes there.
struct Choices {
  int metric = 1;       // wire::Metric
  float threshold = 0;  // of the metric
  int triangles = 0;    // budget, thousands
  int kilobytes = 0;    // a second; 0: unlimited
  float textScale = 1;
  bool invertY = false, vsync = true, members = true;
  std::array<char, 32> x{}, z{}, altitude{};  // metres
  std::array<char, 130> terrain{};
  std::array<char, 16> seed{};
};
// What the user requested in the panel since the last frame.
struct Wishes {
  bool settings = false, jump = false, world = false, vsync = false;
};

struct Marker {
  std::string name;
  Spot at;
  std::vector<Line> lines;
};

struct Plots {
  History frame, triangles, bytes, latency;  // ms, thousands, kB a second, ms
  std::array<History, 5> stages;             // ms of each iteration: select, generate, refine, triangulate, encode
};

struct Shown {
  Mode mode = Mode::kSplit;
  Borders borders = Borders::kNone;
  double divider = 0.5;  // share of the window's width
  bool help = false, figures = true, plots = false, panel = false, mouseFree = true;
  bool wireframe = false, frozen = false, walking = false, following = false, sprinting = false;
  std::string message;  // empty: none; otherwise in the middle, until it changes
  std::string hint;     // empty: none; otherwise at the bottom: what a key has just done

  std::string world;  // terrain, seed, server
  double framesPerSecond = 0, meshMs = 0, marchMs = 0, progress = 1;
  std::uint32_t coarseness = 1;  // side, in pixels, of the square that one ray of the march stands for
  std::uint64_t triangles = 0, leaves = 0, iteration = 0, bytes = 0;
  double iterationsPerSecond = 0, latencyMs = 0, effectiveThreshold = 0;
  double knownReach = 0;  // metres to which a height map is known here; 0: all of it
  bool smooth = true, corrected = false, recording = false, candidates = false;
  std::size_t candidateCount = 0;
  double candidateUnit = 1;   // pixels, see errorColour()
  std::size_t keyframes = 0;  // recorded
  bool settled = false, hashOk = true;
  double building = 0;  // 0..1
  std::string x, z;     // metres
  double y = 0, aboveGround = 0, speed = 0;

  std::size_t members = 0;  // other members
  std::vector<Marker> markers;
  std::vector<Line> frozenEdges;
  Plots history;

  Choices choices;
  bool live = false;           // settings can be changed
  std::string granted;         // the settings as the server granted them
  std::string problem;         // what is wrong in the panel
  Focus focus = Focus::kNone;  // the panel has just been opened to type there
};

class Overlay {
 public:
  Overlay(GLFWwindow* window, float textScale);  // the context must be current; textScale is relative to the window's own
  ~Overlay();
  Overlay(const Overlay&) = delete;
  Overlay& operator=(const Overlay&) = delete;
  Wishes draw(Shown& shown);  // into the window's framebuffer
  void drawMessageAlone(const std::string& text);

  // Input events from the window's callbacks. An open panel sees a frame's worth at a time.
  void hear(const Event& event) { events_.add(event); }
  void focus(bool focused);
  // The panel opens to be typed into, by a key that was just heard: later text is meant for it.
  void awaitTyping() { events_.holdFor(kFramesToFocus); }
  // Whether keys, or clicks at this place (screen coordinates), go to the panel, if it is open.
  bool takesKeys() const;
  bool takesMouse(double x, double y) const;

 private:
  static constexpr int kFramesToFocus = 2;  // until a field that requests keys gets them
  void begin(bool panel);
  GLFWwindow* const window_;
  float base_ = 1;
  EventQueue events_;
  std::array<bool, EventQueue::kButtons> buttons_{};
  double mouseX_ = 0, mouseY_ = 0;
  struct Area {
    double left = 0, top = 0, right = 0, bottom = 0;
  } panel_;  // as last drawn
};

}  // namespace ridgecast::viewer
