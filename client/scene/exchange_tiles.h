#pragma once
// Feeds a window of heights from a connection: connection::Connection, or what has its want() and takeTiles().

#include "client/scene/height_window.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::scene {

// Takes what has come and asks for what is missing; never blocks. Whether anything came. Error: the server sent no tile.
template <class Connection>
Outcome<bool> exchangeTiles(Connection& connection, HeightWindow& window) {
  const auto tiles = connection.takeTiles();
  for (const wire::HeightTile& tile : tiles)
    if (auto put = window.put(tile); !put) return put.error();
  if (auto wanted = window.take(); !wanted.empty()) connection.want({std::move(wanted)});
  return !tiles.empty();
}

}  // namespace ridgecast::scene
