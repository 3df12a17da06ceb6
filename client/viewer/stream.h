#pragma once
// The window's half of the conversation with the server: applies what arrives, sends the camera, changes settings, opens another world.
// Main thread only.

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "client/viewer/arrival.h"
#include "client/viewer/leaf_colours.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

class Stream {
 public:
  using Candidates = std::shared_ptr<const std::vector<wire::Candidate>>;

  Stream(Link link, ViewerState& state);
  replica::Client& client() const { return *link_.client; }
  bool lost() const { return lost_; }
  std::uint64_t sceneVersion() const { return sceneVersion_; }  // tells scenes apart
  const LeafAges& ages() const { return ages_; }
  const Candidates& candidates() const { return candidates_; }  // the last received; null: not requested
  // Null: not heard of any.
  const connection::Roster* others() const { return others_ ? &*others_ : nullptr; }

  // Once a frame. Sends the camera if it has changed.
  void exchange(const camera::Camera& camera);
  // Completes statistics over the last `seconds`.
  void measure(double seconds);
  void requestCandidates(bool want);
  void requestSettings();  // the panel's

  // Opens the world whose name is in the panel, unless one is being opened.
  void enterWorld();
  bool entering() const { return next_.has_value(); }
  void giveUpWorld();
  std::optional<Link> enteredWorld();  // once it is there

 private:
  void watchConnection();
  void accept(const replica::Update& update);
  void sendPose(const camera::Camera& camera);
  void showSettings();

  Link link_;
  ViewerState& state_;
  std::optional<Arrival> next_;
  bool lost_ = false, otherWorld_ = false;
  wire::Settings shownSettings_;
  std::optional<connection::Roster> others_;
  std::uint64_t othersSeen_ = 0;
  LeafAges ages_;
  Candidates candidates_;
  std::optional<camera::Camera> sentCamera_;
  std::chrono::steady_clock::time_point sentAt_{};
  std::map<std::uint64_t, std::chrono::steady_clock::time_point> sent_;  // pose sequence -> when; at most 256
  std::uint64_t sceneVersion_ = 0, versionCounted_ = 0, bytesCounted_ = 0;
};

}  // namespace ridgecast::viewer
