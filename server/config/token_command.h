#pragma once
// ridgecast-server token: issues a token. Secrets come from files, never from the command line; the token goes to standard output.

namespace ridgecast::config {

// argv[0] is "token". The exit status: 0, or 2 after one sentence on standard error.
int runTokenCommand(int argc, const char* const* argv);

}  // namespace ridgecast::config
