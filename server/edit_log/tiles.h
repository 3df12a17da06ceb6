#pragma once
// A tile of a layer as bytes, without loss: 256 rises, then 256 materials, along x first. Each is the zigzag varint of its difference from
// a guess: for rises left + above - above left (0 outside the tile; the left one in the first row, the one above in the first column), for
// materials the one before. A run of n >= 1 zeros is 0 followed by the varint n - 1.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/edits/layer.h"

namespace ridgecast::edit_log {

void encodeTile(const edits::TilePosts& tile, std::vector<std::uint8_t>& out);  // replaces what was there
// Null: these are not the bytes of a tile.
std::shared_ptr<const edits::Tile> decodeTile(std::span<const std::uint8_t> bytes);

std::uint64_t hashOfBytes(std::span<const std::uint8_t> bytes, std::uint64_t start);
// Of a tile at its place. The sum of all tiles' tells whether a layer is whole.
std::uint64_t hashOf(edits::TileAddress address, std::span<const std::uint8_t> bytes);

}  // namespace ridgecast::edit_log
