#pragma once
// ridgecast-server replay: repeats recordings (server/recording) and compares every mesh with the recorded one, plays one to onlookers, or
// writes its flights as paths; --help says how.

#include <functional>
#include <memory>

#include "common/outcome/outcome.h"
#include "server/config/config.h"
#include "server/directory/directory.h"
#include "server/session/session.h"

namespace ridgecast {

// Called once a server listens; lives as long as it serves. `sendAway`: the members of a session that has a successor.
using StartServing = std::function<void(const std::function<void(const session::Session&)>& sendAway)>;
// Called before it listens. Error: one sentence; then it does not serve.
using BeginServing = std::function<Outcome<StartServing>(directory::Directory& directory)>;
// Serves by these settings until a signal comes; the exit status.
using Serve = std::function<int(const config::Config& config, const BeginServing& begin)>;

// argv[0] is "replay". The exit status: 0 if all is equal; 1 after a difference or a failure; 2 after bad input, with one sentence on
// standard error.
int runReplayCommand(int argc, const char* const* argv, const char* const* environment, const Serve& serve);

}  // namespace ridgecast
