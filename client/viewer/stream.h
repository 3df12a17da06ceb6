#pragma once
// The window's half of the conversation with the server: opens a world, applies what arrives, sends the camera, changes settings. Main
// thread only.

#include <atomic>
#include <chrono>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "client/link/client.h"
#include "client/viewer/leaf_colours.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

// A connected world.
struct Link {
  core::Url url;
  wire::Settings settings;
  std::unique_ptr<link::Client> client;

  // `name`: what the others see.
  static Outcome<Link> open(const core::Url& url, const wire::Settings& settings, const std::string& name,
                            const link::Waiting& waiting = {});
};

// A connection being opened while the window stays responsive: the server may first have to compile the terrain. Main thread only.
class Arrival {
 public:
  Arrival(const core::Url& url, const wire::Settings& settings, const std::string& name);
  ~Arrival();  // gives up at once, except on the look-up of a host name
  Arrival(const Arrival&) = delete;

  // The connection, or why there is none; returned once.
  std::optional<Outcome<Link>> take();
  double seconds() const { return secondsSince(began_); }  // since it began
  bool prepares() const { return prepares_; }              // the server has reported that it is making the world
  // "waiting for 127.0.0.1:7070 to prepare the terrain, 12 s"
  std::string describe() const;

 private:
  const std::string where_;
  const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
  std::stop_source stop_;
  std::atomic<bool> prepares_ = false;
  std::future<Outcome<Link>> link_;
};

// The poses that were sent, at most 30 a second, and when.
class SentPoses {
 public:
  void send(link::Client& client, const camera::Camera& camera);  // if it has changed
  // Milliseconds since this pose was sent, which has been answered; nothing: it is too old, or was answered before.
  std::optional<double> answered(std::uint64_t sequence);

 private:
  std::optional<camera::Camera> camera_;
  std::chrono::steady_clock::time_point at_{};
  std::map<std::uint64_t, std::chrono::steady_clock::time_point> sent_;  // by sequence; at most 256
};

class Stream {
 public:
  using Candidates = std::shared_ptr<const std::vector<wire::Candidate>>;

  Stream(Link link, ViewerState& state);
  link::Client& client() const { return *link_.client; }
  const core::Url& url() const { return link_.url; }
  bool lost() const { return lost_; }
  std::uint64_t sceneVersion() const { return sceneVersion_; }  // tells scenes apart
  const LeafAges& ages() const { return ages_; }
  const Candidates& candidates() const { return candidates_; }  // the last received; null: not requested
  // Null: not heard of any.
  const core::Roster* others() const { return others_ ? &*others_ : nullptr; }

  // Once a frame. Sends the camera if it has changed.
  void exchange(const camera::Camera& camera);
  // Completes statistics over the last `seconds`.
  void measure(double seconds);
  void requestCandidates(bool want);
  void requestSettings();  // the panel's
  void requestWorlds();    // the server's sessions and terrains, for the panel

  // Takes the session's clock only for this request, so that everybody may drive it; says so if another member owns it.
  void setClock(const wire::SetClock& set);

  // Opens the world whose name is in the panel, unless one is being opened.
  void enterWorld();
  void enterSession(const std::string& name);  // one that the server has
  bool entering() const { return next_.has_value(); }
  void giveUpWorld();
  std::optional<Link> enteredWorld();  // once it is there

 private:
  void watchConnection();
  void accept(const link::Update& update);
  void followClock();
  void showClock(const core::SessionClock& clock);
  void showSettings();
  void showWorlds();

  Link link_;
  ViewerState& state_;
  std::optional<Arrival> next_;
  std::optional<WorldsQuestion> question_;
  bool lost_ = false, otherWorld_ = false;
  std::uint64_t reconnections_ = 0;
  std::chrono::steady_clock::time_point lostAt_{};
  std::string loss_;  // what the window says of it
  wire::Settings shownSettings_;
  std::optional<core::Roster> others_;
  std::uint64_t clockSeen_ = 0, step_ = 0;  // its version, its newest step
  std::string notice_;                      // the last of the clock's
  LeafAges ages_;
  Candidates candidates_;
  SentPoses poses_;
  std::uint64_t sceneVersion_ = 0, versionCounted_ = 0, bytesCounted_ = 0;
};

}  // namespace ridgecast::viewer
