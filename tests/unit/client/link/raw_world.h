#pragma once
// The world that a raw server greets its client with.

#include "common/wire/messages.h"
#include "tests/unit/client/link/raw_server.h"

namespace ridgecast::test {

inline wire::World rawWorld() {
  wire::World world;
  world.serverName = "raw";
  world.session = "default";
  world.terrainName = "alpine";
  world.horizon = 2000;
  world.settings = {wire::Metric::kPixels, 1, 1000};
  world.window = 3;
  return world;
}

}  // namespace ridgecast::test
