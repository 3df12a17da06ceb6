#pragma once
// One world in the window: wires devices, stream, pictures and overlay. Ends when the window closes or another world is connected. Internal
// to the room. Main thread only.

#include <filesystem>
#include <optional>

#include "client/viewer/compiling.h"
#include "client/viewer/devices.h"
#include "client/viewer/editor.h"
#include "client/viewer/ground.h"
#include "client/viewer/path_recorder.h"
#include "client/viewer/pictures.h"
#include "client/viewer/stream.h"
#include "client/viewer/viewer.h"
#include "client/viewer/window.h"

namespace ridgecast::viewer {

// Where one begins to fly, and how fast.
struct Start {
  lattice::Point at;
  double altitude = 0, yaw = 0, pitch = 0;  // metres above the ground there; degrees
  double speed = 0;                         // metres a second
};

// The path that the window follows, and the one that it records.
class PathFlight {
 public:
  PathFlight(std::optional<camera::Path> path, Stream& stream, ViewerState& state);
  void toggleFollowing();
  void toggleRecording();
  void record(const camera::Pose& pose);
  std::optional<std::size_t> keyframes() const { return recorder_ ? std::optional(recorder_->keyframes()) : std::nullopt; }
  // Until its end or until the user steers.
  void follow(const Input& input, Controls& controls, const Ground& ground);

 private:
  Stream& stream_;
  ViewerState& state_;
  std::optional<PathRecorder> recorder_;
  std::optional<camera::Path> path_;
  std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
};

// When frames are presented.
class Frames {
 public:
  double sincePresented() const { return secondsSince(presentedAt_); }
  void present(Plots& plots);
  // Twice a second: the seconds since it was last returned; sets how many frames there were in each.
  std::optional<double> count(Drawn& drawn);

 private:
  std::chrono::steady_clock::time_point presentedAt_{}, countedSince_ = std::chrono::steady_clock::now();
  int count_ = 0;
};

class WorldWindow {
 public:
  // `compiling`: until it is done, `drawing` and `passes` are neutral ones; then the window draws with the terrain. Null: they are final.
  WorldWindow(const ViewOptions& options, const Start& start, Window& window, Link link, const render::Drawing& drawing, Passes passes,
              ViewerState& state, const Compiling* compiling);

  struct Ending {
    int code = 0;
    std::optional<Link> next;  // another world
    std::string where;         // the session left: "host:port/session"
    Start place;               // where the camera was
  };
  Ending run(std::chrono::steady_clock::time_point began);

 private:
  using Clock = std::chrono::steady_clock;

  std::vector<Action> actions();
  BrushHands brushHands();
  void show(Mode mode);
  void toggleEditing();
  void goBack();
  void quit();
  void toggleWalking();
  void toggleCorrected();
  void toggleFrozen();
  void openPanel(Dialog dialog);
  void grant(const Requests& requests);
  void jump();
  void flyTo(std::uint64_t member);
  void copyLink();

  void placeAboveGround();
  Outcome<void> watchCompiling();
  void fly(double seconds);
  camera::Camera camera() const;
  Start place() const;
  double aboveGround() const;

  Outcome<void> draw(bool last);
  void present(const camera::Camera& camera, bool last);
  void measure();
  void outline(const camera::Camera& camera);
  void screenshot(const camera::Projection& size, const std::filesystem::path& file) const;

  const ViewOptions& options_;
  Window& window_;
  ViewerState& state_;
  Stream stream_;
  Ground ground_;
  std::optional<Pictures> pictures_;  // never empty
  Overlay overlay_;
  Editor editor_;
  Devices devices_;
  Controls controls_;
  const Start start_;
  std::optional<camera::Pose> placed_;  // there, while the height of the ground is not known
  const Compiling* compiling_;
  bool canMarch_;
  Mode wanted_;  // what the user wants to see, once there is a ray march
  PathFlight path_;
  Frames frames_;
  bool wantsScreenshot_ = false, idle_ = false;
};

}  // namespace ridgecast::viewer
