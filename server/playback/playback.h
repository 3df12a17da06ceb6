#pragma once
// Plays a recording into a session, for onlookers: its members are there and fly as they did, and the ground changes when it did.
//
// The session's clock is the recording's: at its time t, what happened up to `from` + t has happened. So who owns the clock pauses it
// (stepped), changes its speed (scaled) and skips ahead (a step); time does not go back. Onlookers have numbers and cameras of their own.
// Meshes are not repeated for this: the members' poses are those of their iterations.

#include <filesystem>
#include <memory>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/session/session.h"

namespace ridgecast::playback {

class Playback {
 public:
  // `session`: of the recording's world, new, in which nobody else makes edits; its directory gives onlookers the numbers after those of
  // the recording. Error: one sentence: the recording cannot be read.
  static Outcome<std::unique_ptr<Playback>> begin(const std::vector<std::filesystem::path>& parts, session::Directory& directory,
                                                  std::shared_ptr<session::Session> session, double from);
  ~Playback();

 private:
  struct State;
  explicit Playback(std::unique_ptr<State> state);
  const std::unique_ptr<State> state_;
};

}  // namespace ridgecast::playback
