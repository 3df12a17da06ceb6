#pragma once
// What the window shows and how: the user's actions and the server's messages change it, pictures and overlay read it. Values only.

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/core/hands/clock_bar.h"
#include "client/core/hands/editing.h"
#include "client/viewer/leaf_colours.h"
#include "client/viewer/project.h"
#include "client/viewer/worlds.h"

namespace ridgecast::viewer {

// By the steady clock.
inline double nowInSeconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }
inline double secondsSince(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

inline constexpr std::chrono::milliseconds kHintTime{2000}, kNoticeTime{12'000};  // own hints; the server's sentences

enum class Mode { kSplit, kMesh, kMarch, kDifference };
enum class Borders { kNone, kLevel, kAge };
enum class Dialog { kNone, kSettings, kWorlds, kPeople };

// The open dialog: what it shows and the user changes there.
struct Panel {
  Dialog dialog = Dialog::kNone;
  bool typed = false;   // it has just been opened to type into its first field
  int metric = 1;       // wire::Metric
  float threshold = 0;  // of the metric
  int triangles = 0;    // budget, thousands
  int kilobytes = 0;    // a second; 0: unlimited
  float textScale = 1;
  bool invertY = false, vsync = true, members = true;
  std::array<char, 32> x{}, z{}, altitude{};  // metres
  std::array<char, 130> terrain{};
  std::array<char, 16> seed{};
  std::array<char, 33> name{};  // the user's own, for the others
  struct Offer {
    Worlds worlds;
    std::string problem;  // why they are not there
    std::string here;     // the session that is shown
  } offer;                // of the server
  bool live = false;      // settings can be changed
  std::string granted;    // the settings as the server granted them
  std::string problem;    // what is wrong in the panel
  bool open() const { return dialog != Dialog::kNone; }
};

// Lines, colours and dots over the mesh.
struct Lines {
  bool wireframe = false, candidates = false;
  Borders borders = Borders::kNone;
  std::optional<camera::Camera> frozen;  // what the server keeps to
};

// Other members and the frozen camera, as they lie in the window.
struct Outlines {
  struct Member {
    std::uint64_t camera = 0;
    std::string text;  // name and distance
    Colour colour{};
    std::optional<double> away;  // metres; null: position unknown
    std::optional<Spot> at;      // in the window; null: not in sight
    std::vector<Segment> lines;
  };
  std::vector<Member> members;  // those that are named, the nearest first
  std::size_t others = 0;       // all in the session
  std::vector<Segment> frozen;
};

// The brush, while the user edits the ground, and the bar with its tools.
struct EditMode {
  bool on = false;
  core::Tool tool = core::Tool::kCrater;
  std::uint32_t material = 0;  // of edits::Operation
  std::string words;           // what the brush does
  bool mayUndo = false;
  std::vector<Segment> lines;  // on the ground: the outline, and a road that is being drawn
};

struct Motion {
  std::string x, z;  // metres
  double y = 0, aboveGround = 0, speed = 0;
  bool walking = false, following = false, sprinting = false;
  std::optional<std::size_t> keyframes;  // recorded; null: not recording
};

// The last values of a statistic, none below 0, for plots.
class History {
 public:
  static constexpr std::size_t kLength = 240;
  void add(double value) {
    values_[next_] = static_cast<float>(value);
    next_ = (next_ + 1) % kLength;
    count_ = std::min(count_ + 1, kLength);
  }
  std::size_t size() const { return count_; }
  // 0 is the oldest.
  float at(std::size_t k) const { return values_[(next_ + kLength - count_ + k) % kLength]; }
  float newest() const { return count_ ? at(count_ - 1) : 0; }
  float most() const { return *std::max_element(values_.begin(), values_.end()); }

 private:
  std::array<float, kLength> values_{};
  std::size_t next_ = 0, count_ = 0;
};

// Progress of a mesh being built: how much fewer insertions and removals there are than at the peak since it was last at rest. Never
// decreases before it rests.
class Building {
 public:
  void iterated(std::uint64_t changes, bool settled) {
    most_ = settled ? 0 : std::max(most_, changes);
    const double share = settled ? 1 : most_ == 0 ? 0 : 1 - static_cast<double>(changes) / static_cast<double>(most_);
    share_ = settled || atRest_ ? share : std::max(share_, share);
    atRest_ = settled;
  }
  double share() const { return share_; }

 private:
  std::uint64_t most_ = 0;
  double share_ = 0;
  bool atRest_ = true;
};

struct Plots {
  History frame, triangles, bytes, latency;  // ms, thousands, kB a second, ms
  std::array<History, 5> stages;             // ms of each iteration: select, generate, refine, triangulate, encode
};

struct Drawn {
  double framesPerSecond = 0, meshMs = 0, marchMs = 0, progress = 1;
  std::uint32_t coarseness = 1;  // side, in pixels, of the square that one ray of the march stands for
  bool corrected = false;        // the mesh that is shown
  bool atRest = false;           // nothing is drawn, because nothing changes
};

struct Statistics {
  std::string world;  // terrain, seed, server
  std::uint64_t triangles = 0, leaves = 0, iteration = 0, bytes = 0;
  double iterationsPerSecond = 0, latencyMs = 0, effectiveThreshold = 0;
  double knownReach = 0;  // metres to which a height map is known here; 0: all of it
  std::size_t candidates = 0;
  double candidateUnit = 1;  // pixels, see errorColour()
  bool settled = false, hashOk = true;
  Drawn drawn;
  Building building;
  Plots plots;
};

struct ViewerState {
  Mode mode = Mode::kSplit;
  double divider = 0.5;  // share of the window's width
  bool help = false, figures = true, plots = false, mouseFree = true, smooth = true, corrected = true;
  Lines lines;
  std::string message;  // empty: none; otherwise in the middle, until it changes
  std::string hint;     // empty: none; otherwise at the bottom, until hintEnds: what a key has just done
  std::chrono::steady_clock::time_point hintEnds{}, mayQuitUntil{};
  Motion motion;
  Statistics statistics;
  Outlines outlines;
  Panel panel;
  EditMode edit;
  core::ClockBar clock;
  bool changed = true;  // since the window was drawn

  double meshShare() const { return mode == Mode::kSplit ? divider : mode == Mode::kMesh ? 1 : 0; }  // of the width, from the left

  // Shows it as the hint.
  void tell(std::string text, std::chrono::milliseconds time = kHintTime) {
    hint = std::move(text);
    hintEnds = std::chrono::steady_clock::now() + time;
    changed = true;
  }
  // Forgets what belongs to one world.
  void leaveWorld() {
    message.clear();
    hint.clear();
    panel.problem.clear();
    panel.dialog = Dialog::kNone;
    lines.frozen.reset();
    motion = {};
    edit = {};
    clock = {};
    statistics = {};
    changed = true;
  }
};

}  // namespace ridgecast::viewer
