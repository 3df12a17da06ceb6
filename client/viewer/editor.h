#pragma once
// The window's edit mode: a brush on the ground below the mouse (in the middle of the picture if the mouse is elsewhere), and its requests
// and responses. What the brush does is in core/hands. Main thread only.

#include <cstdint>
#include <future>
#include <optional>
#include <stop_token>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "client/core/hands/editing.h"
#include "client/link/client.h"
#include "client/link/download.h"
#include "client/viewer/panel.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

class Editor {
 public:
  // A place in the window, in shares of its width and height from the top left.
  using Pointer = std::pair<double, double>;

  Editor(link::Client& client, const core::Url& url, ViewerState& state);
  ~Editor();  // gives up what it asks the server for
  Editor(const Editor&) = delete;

  // Begins or ends it, or says why there is no editing. With a token, first asks the server whether it may edit.
  void toggle();
  void end();

  // Do nothing outside the edit mode.
  void click(const camera::Camera& camera, Pointer at);
  void endRoad();
  void undo();
  void widen(double notches);
  void grant(const EditRequests& requests, const camera::Camera& camera);

  // Once a frame: hears answers, and lays the brush. `sceneVersion` tells scenes apart.
  void update(const camera::Camera& camera, std::optional<Pointer> pointer, std::uint64_t sceneVersion);

 private:
  struct Sent {
    std::uint64_t id = 0, connection = 0;  // of Editing; reconnections() then
    std::future<Outcome<wire::EditAnswer>> answer;
  };
  void send(const wire::Edit& edit);
  void say(const std::string& sentence);
  void begin();
  void hear();
  void show();
  std::optional<lattice::Vertex> groundBelow(const camera::Camera& camera, Pointer at) const;
  void lay(const camera::Camera& camera, const std::optional<lattice::Vertex>& at);

  link::Client& client_;
  const core::Url url_;
  ViewerState& state_;
  core::Editing editing_;
  std::stop_source stop_;
  std::future<Outcome<link::HttpAnswer>> right_;  // while it is asked for
  std::vector<Sent> sent_;                        // at most core::Editing::kMaxOpen of each of its times
  std::uint64_t connection_ = 0;                  // reconnections() that editing_ knows of
  using Laid = std::tuple<camera::Camera, Pointer, lattice::Step, core::Tool, std::size_t, std::uint64_t>;
  std::optional<Laid> laid_;  // what the brush in the state was made for
};

}  // namespace ridgecast::viewer
