#pragma once
// ridgecast-server edits: manages the log of a session's edits (server/edit_log) while no server has its session; --help says how.

namespace ridgecast {

// argv[0] is "edits". The exit status: 0; 1 after a failure, 2 after bad input, with one sentence on standard error.
int runEditsCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace ridgecast
