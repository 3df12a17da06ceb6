#pragma once
// What a world is made of, and how it is made.

#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::session {

// Terrain and parameters by name, as in `--terrain` and `--param`.
struct WorldSpec {
  std::string terrain;
  std::uint32_t seed = 1;
  std::vector<std::pair<std::string, double>> parameters;  // those that differ from the terrain's defaults; ascending by name
  wire::ClockMode clock = wire::ClockMode::kRealTime;      // how its clock begins: in real time or stepped, standing at 0
  friend bool operator==(const WorldSpec&, const WorldSpec&) = default;
};
// May take seconds if a terrain must be compiled; a requested stop ends that within milliseconds. Any thread. Error: one sentence for the
// user, or a stop.
using MakeTerrain = std::function<Outcome<std::shared_ptr<const terrain::Terrain>>(const WorldSpec&, const std::stop_token& stop)>;

}  // namespace ridgecast::session
