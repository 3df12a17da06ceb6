#pragma once
// How far a triangle is from the terrain, judged by samples in memory.
//
// In a cell the grid stands for a bilinear surface, off the terrain by at most `slack`. The difference between it and a triangle is
// greatest at a sample inside, or where the triangle's edge crosses a line of the grid, so those are looked at, with slack: whoever passes
// keeps the error everywhere. The sides of the box are looked at too, but hold no other points than those they were divided at, so that
// adjoining boxes share them.

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <type_traits>
#include <vector>

#include "common/triangulation/triangulation.h"
#include "server/box/samples.h"

namespace ridgecast::box {

struct Worst {        // without initialisers: most of an array of them is never touched
  float error;        // metres, with slack
  std::int32_t x, z;  // where a vertex mends it
  bool admissible;    // false: nowhere in the triangle
  triangulation::Point2 at() const { return {x, z}; }
};
static_assert(std::is_trivially_default_constructible_v<Worst>);

struct Corner {
  triangulation::Point2 at;
  std::int32_t y;  // steps
};
using Corners = std::array<Corner, 3>;  // counter-clockwise
inline Corner cornerOf(const triangulation::Triangulation& mesh, triangulation::VertexId v) {
  return {mesh.vertex(v).point(), mesh.vertex(v).y};
}

class Judge {
 public:
  // `error` in metres.
  Judge(const Samples& samples, triangulation::Point2 low, triangulation::Point2 high, float error)
      : samples_(samples), low_(low), high_(high), error_(error) {}

  // Some hundred samples at most, spread evenly, without slack: where to insert first.
  Worst glance(const Corners& corners) const;
  // All samples and crossings. `tooCoarse` receives the blocks that must be refined before it holds: then ask about each.
  Worst verdict(const Corners& corners, std::vector<Block>& tooCoarse) const;
  Worst verdict(const Corners& corners, const Block& refined, std::vector<Block>& tooCoarse) const;

 private:
  struct Shape;
  struct Search;
  void look(std::size_t tile, const Shape& shape, Search& search) const;
  void rows(const Tile& tile, const Shape& shape, int strideBits, Search& search) const;
  void crossings(const Tile& tile, const Shape& shape, Search& search) const;
  std::optional<triangulation::Point2> beside(const Shape& shape, double x, double z) const;

  const Samples& samples_;
  const triangulation::Point2 low_, high_;  // of the box
  const float error_;
};

}  // namespace ridgecast::box
