#pragma once
// Plays a recording into a session for onlookers: its members appear and fly as recorded, and the ground changes when it did.
//
// The session's clock is the recording's: at time t, everything up to t has happened. So the clock's owner pauses it (stepped), changes its
// speed (scaled) and sets its time; it stops at the recording's end. Time never runs backwards for an onlooker: an earlier time replays the
// recording from there in a successor of the session (Directory::replace), to which the members are sent. Onlookers have numbers and
// cameras of their own. Meshes are not recomputed: the members' poses are those of their iterations.

#include <functional>
#include <memory>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/directory/directory.h"
#include "server/recording/records.h"
#include "server/session/session.h"

namespace ridgecast::playback {

class Playback {
 public:
  using SendAway = std::function<void(const session::Session&)>;  // the members of this session, which has a successor

  // Before anybody can enter: reads the recordings (recording::openRecords) once, which may take seconds, and sets the clock. `session`: a
  // new one of their world, in `directory`, where nobody else makes edits; onlookers get the numbers after those of the recordings. Starts
  // at `from`, in seconds of the first. The arguments must outlive this. Error: one sentence: the recordings cannot be read.
  static Outcome<std::unique_ptr<Playback>> begin(const std::vector<recording::Parts>& recordings, directory::Directory& directory,
                                                  std::shared_ptr<session::Session> session, double from);
  ~Playback();
  void start(SendAway sendAway);  // plays from now on; once

 private:
  struct State;
  explicit Playback(std::unique_ptr<State> state);
  const std::unique_ptr<State> state_;
};

}  // namespace ridgecast::playback
