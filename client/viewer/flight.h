#pragma once
// One world in the window: the user's actions, the server's messages, the pictures. Ends when the window closes or another world is
// connected. Internal to the room. Main thread only.

#include <array>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "client/render/difference_pass.h"
#include "client/render/height_texture.h"
#include "client/render/local_terrain.h"
#include "client/render/renderer.h"
#include "client/scene/scene.h"
#include "client/viewer/arrival.h"
#include "client/viewer/controls.h"
#include "client/viewer/leaf_colours.h"
#include "client/viewer/overlay.h"
#include "client/viewer/panes.h"
#include "client/viewer/path_recorder.h"
#include "client/viewer/viewer.h"
#include "client/viewer/window.h"
#include "common/camera/path.h"

namespace ridgecast::viewer {

// What draws the world. Errors: a shader that the driver does not compile.
struct Passes {
  render::MeshPass mesh, before;
  render::MorphPass morph;
  render::StructurePass structure;
  render::CorrectionPass correction;
  render::MarchPass march;
  render::ShadePass shade;
  render::DifferencePass difference;
  static Outcome<Passes> create(const render::TerrainText& text);
};

class Flight {
 public:
  // Kept when another world is entered.
  struct Kept {
    Shown shown;
    bool started = false;
  };

  Flight(const ViewOptions& options, Window& window, Link link, render::Drawing drawing, Passes passes, Kept kept);
  ~Flight();
  Flight(const Flight&) = delete;
  Flight& operator=(const Flight&) = delete;

  struct Ending {
    int code = 0;
    std::optional<Link> next;  // another world
    camera::Pose pose;         // of the camera
    double aboveGround = 0;
    Kept kept{};
  };
  Ending run(std::chrono::steady_clock::time_point began);

 private:
  using Clock = std::chrono::steady_clock;
  static Flight& self(GLFWwindow* w);

  camera::Pose startPose() const;
  std::optional<double> ground(lattice::Point p) const;
  bool exchangeHeights();

  // flight_input.cpp: the user's actions
  void listen();  // to the window's events
  void freeMouse(bool free);
  void onKey(int key, bool typed);  // goes down; `typed`: in the panel
  void onEscape();
  void onMove(double x, double y);
  void onButton(int button, int action);
  void onScroll(double notches);
  void onPad(double seconds);
  bool held(int key) const;
  bool onPanel() const;                                                  // whether the mouse is there
  bool typing() const { return shown_.panel && overlay_->takesKeys(); }  // keys go to the panel
  void fly(double seconds);
  void follow();
  void nextMode();
  void toggleFrozen();
  void togglePath();
  void toggleRecord();
  void openPanel(Focus focus);
  void hint(std::string text);
  void moveDivider(double to);
  double windowWidth() const;
  void grant(const Wishes& wishes);
  void jump();
  void enterWorld();
  static std::filesystem::path freeName(const std::string& ending);

  // flight_server.cpp: the server's messages
  void converse();
  void take(const replica::Update& update);
  void sendPose();
  void lookForMembers();
  void lookForWorld();
  void giveUpWorld();
  void changeSettings();
  void showSettings();
  void wantCandidates(bool want);
  double candidateUnit() const;  // pixels: the error at which a candidate becomes a vertex, for metrics in pixels; otherwise 1

  // flight.cpp: pictures
  camera::Projection projection() const;
  render::View currentView();
  Outcome<void> draw(bool last);
  void restructure();
  void present(const render::View& view, bool last);
  void tellFigures();
  void project(const camera::Camera& camera);
  void screenshot(int width, int height, const std::filesystem::path& file);

  const ViewOptions& options_;
  Window& window_;
  GLFWwindow* const handle_;
  Link link_;
  std::shared_ptr<const terrain::Terrain> terrain_;  // null: not known here
  std::shared_ptr<scene::HeightWindow> heights_;     // of a height map, the same terrain; otherwise null
  std::optional<render::HeightTexture> texture_;
  std::uint64_t reconnections_ = 0;
  const scene::Scene& scene_;
  render::ShadePass shade_;
  MeshPane mesh_;
  MarchPane march_;
  render::DifferencePass difference_;
  Controls controls_;
  Sprint sprint_;
  std::optional<PathRecorder> recorder_;
  std::optional<camera::Path> path_;
  Clock::time_point pathBegan_{};
  bool wantsScreenshot_ = false;
  wire::Settings shownSettings_;
  std::optional<Overlay> overlay_;
  Shown shown_;
  Input input_;
  LeafAges ages_;
  Building building_;
  std::optional<connection::Roster> others_;
  std::uint64_t othersSeen_ = 0;
  std::optional<camera::Camera> frozen_;
  std::optional<Arrival> nextWorld_;
  std::optional<Link> arrived_;

  std::optional<std::pair<double, double>> lastCursor_;
  std::set<int> tapped_;  // keys that went down since the last frame
  std::array<bool, 15> padButtons_{};
  bool dragging_ = false, changed_ = true, idle_ = false, lost_ = false, otherWorld_ = false, meshStale_ = false, marchStale_ = false,
       smoothSet_ = true;
  std::optional<camera::Camera> sentCamera_, drawnCamera_;
  std::shared_ptr<const std::vector<wire::Candidate>> candidates_;  // the last received; null: not requested
  std::map<std::uint64_t, Clock::time_point> sent_;                 // pose sequence -> when; at most 256
  Clock::time_point sentAt_{}, presentedAt_{}, countedSince_ = Clock::now(), hintedAt_{}, restructuredAt_{};
  std::uint64_t sceneVersion_ = 0, bytesCounted_ = 0;
  int framesCounted_ = 0, iterationsCounted_ = 0;
  std::optional<lattice::Point> boundsAt_;
  render::HeightBounds bounds_;
};

}  // namespace ridgecast::viewer
