#include "server/tileset/tile.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "server/tileset/ramps.h"

namespace ridgecast::tileset {

using lattice::LeafAddress;
using lattice::Step;
using mesh::LeafMesh;
using mesh::LocalVertex;

namespace {

// The mesher begins with a grid of up to 64 samples for each triangle that there may be, refined where that proves too little. With so few
// they are 256 along a side: half the time of twice as many, for alpine and canyon. Tiles that need more triangles are meshed again.
constexpr std::uint32_t kUsualTriangles = 4095;
// A formula that needs more has a step; a height map has none, but may be rough.
constexpr std::uint32_t kMaxOfFormula = 4 * kUsualTriangles, kMax = 64 * kUsualTriangles;
constexpr double kRampShare = 0.1;  // of the error: for what ramps miss where there is no step

// The vertices of the sides, counter-clockwise seen from above.
std::vector<std::uint32_t> ringOf(const Tile& tile) {
  const lattice::Step west = tile.surface.address.x(), north = tile.surface.address.z();
  const auto x0 = static_cast<std::int32_t>(tile.low.x - west), x1 = static_cast<std::int32_t>(tile.high.x - west);
  const auto z0 = static_cast<std::int32_t>(tile.low.z - north), z1 = static_cast<std::int32_t>(tile.high.z - north);
  const auto& vertices = tile.surface.vertices;
  std::array<std::vector<std::uint32_t>, 4> sides;  // each without its last vertex, the next one's first
  for (std::uint32_t v = 0; v < vertices.size(); ++v) {
    const auto [x, z, y] = vertices[v];
    if (x == x0 && z != z1) sides[0].push_back(v);
    if (z == z1 && x != x1) sides[1].push_back(v);
    if (x == x1 && z != z0) sides[2].push_back(v);
    if (z == z0 && x != x0) sides[3].push_back(v);
  }
  std::vector<std::uint32_t> ring;
  for (std::size_t k = 0; k < 4; ++k) {  // canonical vertices ascend by x, then z
    if (k >= 2) std::ranges::reverse(sides[k]);
    ring.insert(ring.end(), sides[k].begin(), sides[k].end());
  }
  return ring;
}

LeafMesh skirtBelow(const Tile& tile, double error) {
  const auto steps = [](double metres) { return static_cast<std::int32_t>(metres * lattice::kStepsPerMetre); };
  const std::int32_t depth = steps(skirtOf(std::max(error, tile.error)));
  std::int32_t lowest = lattice::kMaxHeight;
  for (const LocalVertex& v : tile.surface.vertices) lowest = std::min(lowest, v.y);
  lowest -= steps(skirtOf(error));
  LeafMesh skirt{.address = tile.surface.address, .vertices = {}, .triangles = {}};
  const std::vector<std::uint32_t> ring = ringOf(tile);
  expects(ring.size() >= 4, "a tile has its four corners");
  for (const std::uint32_t v : ring) {
    const LocalVertex& top = tile.surface.vertices[v];
    skirt.vertices.push_back(top);
    skirt.vertices.push_back({top.x, top.z, std::max(top.y - depth, lowest)});
  }
  const auto count = static_cast<std::uint32_t>(skirt.vertices.size());
  for (std::uint32_t top = 0; top < count; top += 2) {
    const std::uint32_t next = (top + 2) % count;
    skirt.triangles.push_back({top, top + 1, next + 1});
    skirt.triangles.push_back({top, next + 1, next});
  }
  return skirt;
}

// The terrain with lengths divided by a power of two, heights too.
class Shrunk final : public terrain::Terrain {
 public:
  Shrunk(const terrain::Terrain& terrain, int bits) : terrain_(terrain), bits_(bits) {}
  std::string_view name() const override { return terrain_.name(); }
  std::string_view source() const override { return terrain_.source(); }
  std::uint32_t seed() const override { return terrain_.seed(); }
  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override {
    thread_local std::vector<Step> places;
    places.resize(2 * out.size());
    for (std::size_t k = 0; k < out.size(); ++k) {
      places[k] = x[k] << bits_;
      places[out.size() + k] = z[k] << bits_;
    }
    terrain_.heights(std::span(places).first(out.size()), std::span(places).last(out.size()), out);
    const float share = std::ldexp(1.0f, -bits_);
    for (float& height : out) height *= share;
  }

 private:
  const terrain::Terrain& terrain_;
  const int bits_;
};

// With few triangles, and with more where those do not do.
box::Result<box::BoxMesh> meshed(const terrain::Terrain& terrain, const box::Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool,
                                 const box::Watch& watch) {
  std::uint32_t most = std::min(kUsualTriangles, mostTriangles);
  auto made = box::meshBox(terrain, box, most, pool, watch);
  while (!made && made.error().kind == box::Problem::Kind::kTooMuch && most < mostTriangles) {
    most = mostTriangles / 4 > most ? 4 * most : mostTriangles;
    made = box::meshBox(terrain, box, most, pool, watch);
  }
  return made;
}

bool isEdited(const terrain::Terrain& terrain, LeafAddress square) {
  const terrain::Raster* const edits = terrain.edits();
  if (!edits) return false;
  const std::int64_t pitch = edits->shape().x.of(1);
  const std::int64_t posts = square.side() / pitch + 8;
  const auto [lowest, highest] = edits->range(square.x() / pitch - 4, square.z() / pitch - 4, posts, posts);
  return lowest != 0 || highest != 0;
}

// The vertices of a large tile need not lie between millimetres: a formula is meshed as if its tile were small, by steps of a
// thousandth of the error. Draco then takes a tenth of the time, and 17 bits.
box::Result<Tile> meshed(const terrain::Terrain& terrain, const Wanted& wanted, std::uint32_t mostTriangles, scheduling::Pool& pool,
                         const box::Watch& watch) {
  const int bits =
      terrain.raster() || isEdited(terrain, wanted.square) ? 0 : std::clamp(std::ilogb(wanted.box.error / 4), 0, wanted.square.level);
  const auto up = [bits](Step v) { return -(-v >> bits); };
  const box::Box small{{wanted.box.low.x >> bits, wanted.box.low.z >> bits},
                       {up(wanted.box.high.x), up(wanted.box.high.z)},
                       std::ldexp(wanted.box.error, -bits)};
  const auto made =
      bits == 0 ? meshed(terrain, small, mostTriangles, pool, watch) : meshed(Shrunk(terrain, bits), small, mostTriangles, pool, watch);
  if (!made) return made.error();
  std::vector<const LeafMesh*> leaves;
  for (const LeafMesh& leaf : made->leaves) leaves.push_back(&leaf);
  Tile out{.surface = mesh::gather({wanted.square.level - bits, wanted.square.i, wanted.square.j}, leaves),
           .skirt = {},
           .low = {made->low.x << bits, made->low.z << bits},
           .high = {made->high.x << bits, made->high.z << bits},
           .error = std::ldexp(made->error, bits),
           .proven = made->proven,
           .spacing = std::ldexp(made->spacing, bits),
           .samples = made->samples};
  out.surface.address = wanted.square;
  for (auto& [x, z, y] : out.surface.vertices) {
    x <<= bits;
    z <<= bits;
    y <<= bits;
  }
  return out;
}

}  // namespace

bool isTile(LeafAddress square) {
  if (square.level < 0 || square.level > kCoarsest) return false;
  const std::int64_t limit = lattice::kMaxPosition >> square.sideBits();
  return square.i >= -limit && square.i < limit && square.j >= -limit && square.j < limit;
}

lattice::Point frameOf(LeafAddress square) {
  const lattice::Step half = square.side() / 2;
  return {lattice::floorTo(square.x() + half, lattice::kCellBits), lattice::floorTo(square.z() + half, lattice::kCellBits)};
}

box::Result<Tile> meshTile(const terrain::Terrain& terrain, const Wanted& wanted, std::uint32_t mostTriangles, scheduling::Pool& pool,
                           const box::Watch& watch) {
  const auto [low, high] = std::pair(wanted.box.low, wanted.box.high);
  const Wanted all = whole(wanted.square);
  expects(isTile(wanted.square), "a tile is one of the lattice's squares");
  expects(all.box.low.x <= low.x && low.x < high.x && high.x <= all.box.high.x && all.box.low.z <= low.z && low.z < high.z &&
              high.z <= all.box.high.z,
          "a tile covers a part of its square");
  expects(wanted.box.error > 0, "a tile may be off");
  auto made = meshed(terrain, wanted, std::min(terrain.raster() ? kMax : kMaxOfFormula, mostTriangles), pool, watch);
  if (!made && made.error().kind == box::Problem::Kind::kTooMuch) {
    Ramps ramps(terrain, wanted.square);
    Wanted beside = wanted;
    beside.box.error *= 1 - kRampShare;
    do made = meshed(ramps, beside, std::min(kMax, mostTriangles), pool, watch);
    while (!made && made.error().kind == box::Problem::Kind::kTooMuch && ramps.widen());
    if (made) {
      made->ramp = ramps.width();
      made->error += ramps.apartFrom(made->low, made->high, kRampShare * wanted.box.error);
    }
  }
  if (made) made->skirt = skirtBelow(*made, wanted.box.error);
  return made;
}

}  // namespace ridgecast::tileset
