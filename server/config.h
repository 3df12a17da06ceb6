#pragma once
// The server's command line.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "common/outcome/outcome.h"
#include "server/net/server.h"
#include "server/session/session.h"
#include "server/terrain/catalogue.h"

namespace ridgecast::config {

struct Config {
  net::Settings net;
  session::Limits limits;
  user_terrain::Request terrain;   // of the default session, with its seed
  unsigned threads = 0;            // 0: as many as the hardware has
  std::filesystem::path portFile;  // empty: none
  bool quiet = false;              // only warnings and errors
};

// What the command line asks for. Either `config`, or the process is to end now with `status`, its text printed already:
// 0 after --help, --version and --list-terrains, 2 after an error, which is one sentence on stderr.
struct Parsed {
  std::optional<Config> config;
  int status = 0;
};
Parsed parse(int argc, const char* const* argv);

}  // namespace ridgecast::config
