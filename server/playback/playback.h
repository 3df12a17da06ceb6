#pragma once
// Plays a recording into a session, for onlookers: its members are there and fly as they did, and the ground changes when it did.
//
// The session's clock is the recording's: at its time t, what happened up to t has happened. So who owns the clock pauses it (stepped),
// changes its speed (scaled) and sets its time; at the recording's end it stands. No onlooker sees time go back: to an earlier time the
// recording is played again from there, in a successor of the session (Directory::replace), and its members are sent there. Onlookers have
// numbers and cameras of their own. Meshes are not repeated for this: the members' poses are those of their iterations.

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/session/session.h"

namespace ridgecast::playback {

class Playback {
 public:
  using SendAway = std::function<void(const session::Session&)>;  // the members of this session, which has a successor

  // Before anybody can enter: reads the recording once, which may take seconds, and sets the clock. `session`: of the recording's world, in
  // `directory`, new, in which nobody else makes edits; onlookers get the numbers after those of the recording. From `from` on, in seconds
  // of the recording. What is given must outlive this. Error: one sentence: the recording cannot be read.
  static Outcome<std::unique_ptr<Playback>> begin(const std::vector<std::filesystem::path>& parts, session::Directory& directory,
                                                  std::shared_ptr<session::Session> session, double from);
  ~Playback();
  void start(SendAway sendAway);  // plays from now on; once

 private:
  struct State;
  explicit Playback(std::unique_ptr<State> state);
  const std::unique_ptr<State> state_;
};

}  // namespace ridgecast::playback
