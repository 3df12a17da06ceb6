#include "client/connection/inbox.h"

#include <iterator>
#include <utility>

namespace ridgecast::connection {

std::optional<std::string> Inbox::put(wire::ServerMessage& message, std::uint64_t size) {
  const auto now = std::chrono::steady_clock::now();
  if (auto* iteration = std::get_if<wire::Iteration>(&message)) {
    if (iterations.size() >= world.window) return "sent more than the " + std::to_string(world.window) + " iterations it may";
    iterations.push_back({.iteration = std::move(*iteration), .bytes = size});
  } else if (auto* come = std::get_if<wire::HeightTiles>(&message)) {
    if (come->tiles.size() > unanswered - tiles.size()) return "sent tiles of heights that were not asked for";
    std::move(come->tiles.begin(), come->tiles.end(), std::back_inserter(tiles));
  } else if (const auto* members = std::get_if<wire::Members>(&message)) {
    if (const auto applied = roster.apply(*members, now); !applied) return "sent what cannot be: " + applied.error().message;
  } else if (const auto* said = std::get_if<wire::Clock>(&message)) {
    clock.hear(*said, now);
  } else if (const auto* settings = std::get_if<wire::Granted>(&message)) {
    granted = settings->settings;
  }
  return std::nullopt;
}

std::optional<Received> Inbox::takeIteration() {
  if (iterations.empty()) return std::nullopt;
  Received received = std::move(iterations.front());
  iterations.pop_front();
  return received;
}

std::vector<wire::HeightTile> Inbox::takeTiles() {
  unanswered -= tiles.size();
  return std::exchange(tiles, {});
}

}  // namespace ridgecast::connection
