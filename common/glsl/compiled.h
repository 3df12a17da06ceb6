#pragma once
// A terrain file as a terrain: checked (check.h), translated (translate.h), compiled for this machine and cached (library.h), tried in its
// own process (probe.h) and loaded. After that every batch of heights is checked: NaN becomes 0, absurd values are clamped, loops end after
// kMaxSteps steps, and the first such place is reported.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "common/glsl/declaration.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"

namespace ridgecast::glsl {

struct Source {
  std::string name;  // of the terrain
  std::string file;  // for messages
  std::string text;
};

struct Build {
  std::filesystem::path cache;   // empty: the user's own, see Cache::open
  std::string variant;           // "baseline", "avx2", "avx512"; empty: the best for this machine
  std::filesystem::path prober;  // a program whose main() calls asProbe (probe.h) first; tries what was compiled
  bool colours = false;          // require colours in C++: a private terrain's travel with its vertices. Otherwise optional
};

// Called with what compiles but is no good ground, by load(), and once a terrain if a height turns out to be bad, on the
// thread that computed it.
using Complain = std::function<void(const std::string&)>;

// `parameters`: other values than the file's. Any thread. `stop` ends its child processes within milliseconds. Error: sentences for the
// user, with file and line if there is one, or a stop.
Outcome<std::shared_ptr<const terrain::Terrain>> load(Source source, const std::vector<Assignment>& parameters, std::uint32_t seed,
                                                      const Build& build, Complain complain, const std::stop_token& stop = {});

}  // namespace ridgecast::glsl
