#pragma once
// What has come from the server and is not taken yet, or holds until something newer comes. Internal to the room. Not thread-safe; no
// thread, socket or clock.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "client/connection/connection.h"

namespace ridgecast::connection {

struct Inbox {
  // A message after the world; `bytes` of it. What is wrong with it, if anything.
  std::optional<std::string> put(wire::ServerMessage& message, std::uint64_t bytes);
  std::optional<Received> takeIteration();
  std::vector<wire::HeightTile> takeTiles();

  wire::World world;
  wire::Settings granted;
  std::deque<Received> iterations;  // at most world.window
  std::size_t unanswered = 0;       // tiles that are wanted and not taken, those that came included
  std::vector<wire::HeightTile> tiles;
  Roster roster;
  SessionClock clock;
  std::uint64_t bytes = 0;
};

}  // namespace ridgecast::connection
