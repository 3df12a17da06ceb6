#pragma once
// Squares of 128 x 128 posts (64 m): what clients hold of a layer, to draw it and to stand on it.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/edits/layer.h"
#include "common/outcome/outcome.h"
#include "common/terrain/raster.h"

namespace ridgecast::edits {

inline constexpr std::int64_t kSquareSide = terrain::kTileSide;  // posts
inline constexpr int kSquareStepBits = kPostBits + terrain::kTileBits;

using SquareAddress = terrain::TileAddress;  // posts [i, i + 1) x 128 along x, j along z
inline SquareAddress squareOf(lattice::Point p) { return {p.x >> kSquareStepBits, p.z >> kSquareStepBits}; }
inline Posts postsOf(SquareAddress a) { return {a.i * kSquareSide, a.j * kSquareSide, (a.i + 1) * kSquareSide, (a.j + 1) * kSquareSide}; }

struct Square {
  terrain::Tile rises{}, materials{};  // along x first; materials 0..kMaterials
};
Square squareOf(const Layer& layer, SquareAddress address);
// The layer with this square in place of its own; null: without any posts there.
std::shared_ptr<const Layer> withSquare(const Layer& layer, SquareAddress address, const Square* square);

// Those within `radius` metres that have edits, the nearest first, at most `most`.
std::vector<SquareAddress> squaresAround(const Layer& layer, lattice::Point centre, double radius, std::size_t most);

// As bytes: terrain::encodeTile of both; none where all are 0.
struct SquareBytes {
  std::vector<std::uint8_t> rises, materials;
};
SquareBytes encode(const Square& square);
// Error: not the bytes of a square, or a rise or material out of range. Nothing: all are 0.
Outcome<std::optional<Square>> decodeSquare(std::span<const std::uint8_t> rises, std::span<const std::uint8_t> materials);

}  // namespace ridgecast::edits
