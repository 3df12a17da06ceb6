#include "common/edits/square.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace ridgecast::edits {
namespace {

constexpr std::int64_t kTiles = kSquareSide / kTileSide;  // a side

template <class Do>
void forEachTileIn(SquareAddress address, const Do& act) {
  for (std::int64_t j = 0; j < kTiles; ++j)
    for (std::int64_t i = 0; i < kTiles; ++i)
      act(TileAddress{address.i * kTiles + i, address.j * kTiles + j}, i * kTileSide, j * kTileSide);
}

bool isZero(const terrain::Tile& values) {
  return std::ranges::all_of(values, [](std::int32_t v) { return v == 0; });
}

// Posts from a square to the one that holds a place, along one axis.
double gap(std::int64_t from, std::int64_t to) { return static_cast<double>(std::max<std::int64_t>(std::abs(from - to) - 1, 0)); }

}  // namespace

Square squareOf(const Layer& layer, SquareAddress address) {
  Square out;
  forEachTileIn(address, [&](TileAddress at, std::int64_t x, std::int64_t z) {
    const Tile* const tile = layer.tile(at);
    if (!tile) return;
    const TilePosts posts = tile->posts();
    for (std::int64_t row = 0; row < kTileSide; ++row) {
      const auto from = static_cast<std::size_t>(row * kTileSide), to = static_cast<std::size_t>((z + row) * kSquareSide + x);
      std::copy_n(&posts.rise[from], kTileSide, &out.rises[to]);
      std::copy_n(&posts.material[from], kTileSide, &out.materials[to]);
    }
  });
  return out;
}

std::shared_ptr<const Layer> withSquare(const Layer& layer, SquareAddress address, const Square* square) {
  std::vector<Layer::Change> changes;
  forEachTileIn(address, [&](TileAddress at, std::int64_t x, std::int64_t z) {
    TilePosts posts;
    for (std::int64_t row = 0; square && row < kTileSide; ++row) {
      const auto from = static_cast<std::size_t>((z + row) * kSquareSide + x), to = static_cast<std::size_t>(row * kTileSide);
      std::copy_n(&square->rises[from], kTileSide, &posts.rise[to]);
      for (std::size_t k = 0; k < kTileSide; ++k) posts.material[to + k] = static_cast<std::uint8_t>(square->materials[from + k]);
    }
    changes.push_back({at, posts == TilePosts() ? nullptr : std::make_shared<const Tile>(posts)});
  });
  // Tiles beside it that are there for its neighbours' sake alone: the layer puts back those that still are.
  const TileAddress first{address.i * kTiles - 1, address.j * kTiles - 1}, last{first.i + kTiles + 1, first.j + kTiles + 1};
  for (std::int64_t j = first.j; j <= last.j; ++j)
    for (std::int64_t i = first.i; i <= last.i; i += j == first.j || j == last.j ? 1 : kTiles + 1)
      if (const Tile* const beside = layer.tile({i, j}); beside && beside->isZero()) changes.push_back({{i, j}, nullptr});
  std::ranges::sort(changes, {}, &Layer::Change::address);
  return layer.with(changes);
}

std::vector<SquareAddress> squaresAround(const Layer& layer, lattice::Point centre, double radius, std::size_t most) {
  const SquareAddress middle = squareOf(centre);
  const auto reach = static_cast<std::int64_t>(std::ceil(radius * lattice::kStepsPerMetre / (lattice::Step{1} << kSquareStepBits))) + 1;
  const SquareAddress least{middle.i - reach, middle.j - reach}, greatest{middle.i + reach, middle.j + reach};
  std::set<SquareAddress> found;
  layer.forEachTile({least.i * kSquareSide, least.j * kSquareSide, (greatest.i + 1) * kSquareSide, (greatest.j + 1) * kSquareSide},
                    [&](TileAddress at, const Tile& tile) {
                      const SquareAddress square{at.i >> (terrain::kTileBits - kTileBits), at.j >> (terrain::kTileBits - kTileBits)};
                      if (!found.contains(square) && !tile.isZero()) found.insert(square);
                    });
  std::vector<std::pair<double, SquareAddress>> near;
  for (const SquareAddress a : found) {
    const double away = std::hypot(gap(a.i, middle.i), gap(a.j, middle.j)) * (kSquareSide * kPostSteps / lattice::kStepsPerMetre);
    if (away <= radius) near.emplace_back(away, a);
  }
  std::ranges::sort(near);
  if (near.size() > most) near.resize(most);
  std::vector<SquareAddress> out;
  for (const auto& [away, a] : near) out.push_back(a);
  return out;
}

SquareBytes encode(const Square& square) {
  const auto bytes = [](const terrain::Tile& values) { return isZero(values) ? std::vector<std::uint8_t>() : terrain::encodeTile(values); };
  return {bytes(square.rises), bytes(square.materials)};
}

Outcome<std::optional<Square>> decodeSquare(std::span<const std::uint8_t> rises, std::span<const std::uint8_t> materials) {
  std::optional<Square> out;
  if (rises.empty() && materials.empty()) return out;
  out.emplace();
  const auto read = [](std::span<const std::uint8_t> bytes, terrain::Tile& to, std::int32_t least, std::int32_t most) -> Outcome<void> {
    if (bytes.empty()) return {};
    auto decoded = terrain::decodeTile(bytes);
    if (!decoded) return decoded.error();
    if (std::ranges::any_of(*decoded, [&](std::int32_t v) { return v < least || v > most; }))
      return Error{"a square of edited ground has a rise beyond 4,096 m or a material that is not known"};
    to = *decoded;
    return {};
  };
  if (auto done = read(rises, out->rises, -kMaxRise, kMaxRise); !done) return done.error();
  if (auto done = read(materials, out->materials, 0, static_cast<std::int32_t>(kMaterials)); !done) return done.error();
  return out;
}

}  // namespace ridgecast::edits
