#pragma once
// ridgecast-server check FILE [settings]: tries a terrain file or a height map as a server would that is started with it, and says what it
// is: how high, how fast, its parameters, and what it is made of. It listens nowhere.

namespace ridgecast {

// argv[0] is "check". The exit status: 0; 2 if a server would refuse it, with what is wrong on standard error.
int runCheckCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace ridgecast
