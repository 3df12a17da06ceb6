#pragma once
// The server's settings from command line, environment and settings file (layers.h).

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/user_terrain/catalogue.h"
#include "server/bus/redis.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "server/session/session.h"
#include "server/snapshot/question.h"

namespace ridgecast::config {

struct Config {
  std::vector<std::string> ignoredVariables;  // that look like settings and are Kubernetes' (layers.h)
  net::Settings net;
  session::Limits limits;
  snapshot::Limits snapshots;
  std::uint32_t cacheMemory = 64;  // MiB of made snapshots and tiles
  user_terrain::Request terrain;   // of the default session, with its seed
  std::filesystem::path state;     // of the sessions' edits; empty: not kept
  std::filesystem::path record;    // folder of recordings; empty: none are made
  std::uint64_t recordBytes = std::uint64_t{1} << 30;
  bus::Redis::Settings shared;      // the engine between the servers of these worlds; no URL: none
  bool watch = false;               // sessions follow their terrain files
  unsigned threads = 0;             // 0: as many as the hardware has
  std::filesystem::path portFile;   // empty: none
  bool endsWithInput = false;       // when the standard input ends
  std::filesystem::path webFolder;  // of the browser viewer; empty: the one beside the program, if any
  logging::Format logFormat = logging::Format::kText;
  logging::Level logLevel = logging::Level::kInfo;
};

// Either `config`, or the process must exit now with `status`, its text already printed: 0 after --help, --version, --list-terrains,
// --print-config and `token`; 2 after an error, one sentence on stderr.
struct Parsed {
  std::optional<Config> config;
  int status = 0;
};
Parsed parse(int argc, const char* const* argv, const char* const* environment);

}  // namespace ridgecast::config
