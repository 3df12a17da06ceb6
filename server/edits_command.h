#pragma once
// ridgecast-server edits: looks after the log of a session's edits (server/edit_log) while no server has it open.
//
//   list FILE                      a table for people
//   export FILE                    to standard output, a line of JSON an edit: {"number", "key", "author", "time", "edit": {...}}; time in
//                                  microseconds since 1970, edit as in common/edits/json.h
//   import FILE [FROM] [settings]  a new log from such lines, of FROM or standard input, on the terrain that the settings name. Only "edit"
//                                  is required; numbers, where given, must follow each other from 1
//   compact FILE [settings]        what the edits made becomes the ground that later ones are made on; they cannot be undone any more
//   verify FILE [settings]         makes the ground again from the edits, and says what differs from the cached tiles; exit status 1
//   backup FILE TO                 a copy in one piece; of a log that a server has open, ask that server
//
// compact and verify need the settings only where the terrain's name in the log does not say which it is: --terrain-dir, --terrain FILE.

namespace ridgecast {

// argv[0] is "edits". The exit status: 0; 1 after a failure, 2 after bad input, with one sentence on standard error.
int runEditsCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace ridgecast
