#pragma once
// How far a triangle is from the terrain, judged by samples in memory.
//
// Each cell of the grid stands for a bilinear surface, off the terrain by at most its slack. First the whole cell is checked: if its four
// corners pass, slack included, all of it passes. Otherwise only the triangle's part is checked, at its corners: samples inside, crossings
// of edges and grid lines, corners of the triangle. Where slack decides, finer samples are used, in those cells only. A triangle that
// passes keeps the error everywhere. The sides of the box are checked too, but have no points except those they were divided at, so that
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
  std::int32_t x, z;  // where a vertex would fix it
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

struct Area {  // low..high
  triangulation::Point2 low, high;
};
struct Open {  // whether the triangle's part in an area passes: undecided without finer samples of a block
  Block block;
  Area area;
};

struct Shape;

class Judge {
 public:
  // `error` in metres.
  Judge(const Samples& samples, triangulation::Point2 low, triangulation::Point2 high, float error)
      : samples_(samples), low_(low), high_(high), error_(error) {}

  // Evenly spread rows of samples, without slack: where to insert first.
  Worst glance(const Corners& corners) const;
  // Everywhere. `tooCoarse` receives what stays open until a block is refined: then ask about each. A triangle that fails already adds
  // nothing.
  Worst verdict(const Corners& corners, std::vector<Open>& tooCoarse) const;
  Worst verdict(const Corners& corners, const Open& refined, std::vector<Open>& tooCoarse) const;
  // The verdict, if the triangle passes with the existing samples.
  std::optional<Worst> passes(const Corners& corners) const;

 private:
  struct Search;
  struct Around;
  void look(std::size_t tile, const Area& area, const Shape& shape, Search& search) const;
  void cell(Around& around, std::int32_t i, std::int32_t j, const Shape& shape, Search& search) const;
  std::optional<triangulation::Point2> beside(const Shape& shape, double x, double z) const;

  const Samples& samples_;
  const triangulation::Point2 low_, high_;  // of the box
  const float error_;
};

}  // namespace ridgecast::box
