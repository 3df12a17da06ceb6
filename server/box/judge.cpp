#include "server/box/judge.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "server/box/shape.h"

namespace ridgecast::box {

using triangulation::Point2;

namespace {

constexpr float kTrust = 0.05f;  // of the error: more slack than this asks for finer samples, less counts as error
constexpr float kNear = 4e-6f;   // of a spacing: what floats do not tell apart in a tile

}  // namespace

struct Judge::Search {
  std::vector<Open>* tooCoarse = nullptr;  // null: it is over once something fails
  float worst = 0, passed = 0;             // metres; with slack, what lies between samples that pass
  Point2 at = {};                          // where the worst is, or beside it
  bool admissible = false;

  bool over(float error) const { return worst > error && !tooCoarse; }
  Worst found() const { return {std::max(worst, passed), at.x, at.z, admissible}; }
};

Worst Judge::verdict(const Corners& corners, std::vector<Open>& tooCoarse) const {
  const Shape shape(corners);
  Search search{.tooCoarse = &tooCoarse};
  samples_.forEach(shape.low, shape.high, [&](std::size_t tile) { look(tile, {shape.low, shape.high}, shape, search); });
  return search.found();
}

Worst Judge::verdict(const Corners& corners, const Open& open, std::vector<Open>& tooCoarse) const {
  const Shape shape(corners);
  Search search{.tooCoarse = &tooCoarse};
  look(static_cast<std::size_t>(samples_[open.block.tile].finer[open.block.block]), open.area, shape, search);
  return search.found();
}

std::optional<Worst> Judge::passes(const Corners& corners) const {
  const Shape shape(corners);
  Search search;
  samples_.forEach(shape.low, shape.high, [&](std::size_t tile) { look(tile, {shape.low, shape.high}, shape, search); });
  return search.worst > error_ ? std::nullopt : std::optional(search.found());
}

// A point of the lattice beside a place on an edge that lies in the triangle, where a vertex may stand.
std::optional<Point2> Judge::beside(const Shape& shape, double x, double z) const {
  for (int k = 0; k < 4; ++k) {
    const Point2 p{static_cast<std::int32_t>(std::floor(x)) + (k & 1), static_cast<std::int32_t>(std::floor(z)) + (k >> 1)};
    if (shape.holds(p) && p.x > low_.x && p.x < high_.x && p.z > low_.z && p.z < high_.z) return p;
  }
  return {};
}

// A tile's cells around a triangle.
struct Judge::Around {
  static constexpr std::size_t kLines = (1 << Samples::kCellBits) + 1;

  const Tile& tile;
  std::int32_t i0, j0, i1, j1;                  // cells
  float bulge = 0;                              // as of Shape
  std::array<float, 3> u, v;                    // the corners, in spacings
  std::array<Lines::Part, kLines> row, column;  // of the triangle, on the lines from j0 and i0 on
  std::array<float, kLines * kLines> off;       // of the samples from the triangle's plane, metres, along x first
  std::uint64_t asked = 0;                      // blocks that must be finer
  Point2 low, high;                             // cells that ask for that

  Around(const Tile& of, const Area& area)
      : tile(of),
        i0(std::max((area.low.x - of.corner.x) >> of.bits, 0)),
        j0(std::max((area.low.z - of.corner.z) >> of.bits, 0)),
        i1(std::min((area.high.x - 1 - of.corner.x) >> of.bits, of.cells() - 1)),
        j1(std::min((area.high.z - 1 - of.corner.z) >> of.bits, of.cells() - 1)) {}
  bool empty(const Shape& shape) const { return i0 > i1 || j0 > j1 || shape.misses(point(i0, j0), point(i1 + 1, j1 + 1)); }
  std::int32_t width() const { return i1 - i0 + 2; }
  std::size_t index(std::int32_t i, std::int32_t j) const { return static_cast<std::size_t>((j - j0) * width() + i - i0); }
  Point2 point(std::int32_t i, std::int32_t j) const { return {tile.corner.x + (i << tile.bits), tile.corner.z + (j << tile.bits)}; }
  // Fills `off`: the greatest.
  float measure(const Shape& shape) {
    const auto slope = static_cast<float>(shape.gx * tile.spacing());
    float most = 0;
    for (std::int32_t j = j0; j <= j1 + 1; ++j) {
      const Point2 first = point(i0, j);
      const double exact = shape.at(first.x, first.z);
      const auto base = static_cast<float>(exact), rest = static_cast<float>(exact - base);
      const float* const height = &tile.height[tile.index(i0, j)];
      float* const to = &off[index(i0, j)];
      for (std::int32_t n = 0; n < width(); ++n) {
        to[n] = height[n] - base - (rest + static_cast<float>(n) * slope);
        most = std::max(most, std::abs(to[n]));
      }
    }
    return most;
  }
  // Fills the others.
  void cross(const Shape& shape) {
    bulge = shape.bulge(tile.spacing());
    const Lines along = shape.lines(tile.corner, tile.spacing(), true), across = shape.lines(tile.corner, tile.spacing(), false);
    for (std::size_t k = 0; k < 3; ++k) {
      u[k] = static_cast<float>((shape.corner[k].x - tile.corner.x) / tile.spacing());
      v[k] = static_cast<float>((shape.corner[k].z - tile.corner.z) / tile.spacing());
    }
    for (std::int32_t j = j0; j <= j1 + 1; ++j) {
      const std::int32_t z = point(i0, j).z;
      row[static_cast<std::size_t>(j - j0)] = z < shape.low.z || z > shape.high.z ? Lines::kNone : along.near(j);
    }
    for (std::int32_t i = i0; i <= i1 + 1; ++i) {
      const std::int32_t x = point(i, j0).x;
      column[static_cast<std::size_t>(i - i0)] = x < shape.low.x || x > shape.high.x ? Lines::kNone : across.near(i);
    }
  }
  // Cells of row j that the triangle meets, in spacings.
  Lines::Part met(std::int32_t j) const {
    const auto &above = row[static_cast<std::size_t>(j - j0)], &below = row[static_cast<std::size_t>(j - j0) + 1];
    Lines::Part part{std::min(above.from, below.from), std::max(above.to, below.to)};
    for (std::size_t k = 0; k < 3; ++k)
      if (v[k] >= static_cast<float>(j) && v[k] <= static_cast<float>(j + 1)) part = {std::min(part.from, u[k]), std::max(part.to, u[k])};
    return {std::max(part.from, static_cast<float>(i0)), std::min(part.to, static_cast<float>(i1 + 1))};
  }
  template <class F>
  void forEachPlace(std::int32_t i, std::int32_t j, F&& f) const;
  void ask(std::int32_t i, std::int32_t j) {
    low = asked == 0 ? Point2{i, j} : Point2{std::min(low.x, i), std::min(low.z, j)};
    high = asked == 0 ? Point2{i, j} : Point2{std::max(high.x, i), std::max(high.z, j)};
    asked |= std::uint64_t{1} << tile.block(i >> Tile::kBlockBits, j >> Tile::kBlockBits);
  }
  // The triangle's part in cells that asked.
  Area open(const Shape& shape) const {
    const Point2 from = point(low.x, low.z), to = point(high.x + 1, high.z + 1);
    return {{std::max(from.x, shape.low.x), std::max(from.z, shape.low.z)}, {std::min(to.x, shape.high.x), std::min(to.z, shape.high.z)}};
  }
};

void Judge::look(std::size_t number, const Area& area, const Shape& shape, Search& search) const {
  if (search.over(error_)) return;
  Around around(samples_[number], area);
  const Tile& tile = around.tile;
  if (around.empty(shape)) return;
  if (const float most = around.measure(shape) + tile.most; most <= error_) {
    search.passed = std::max(search.passed, most);
    return;
  }
  around.cross(shape);
  for (std::int32_t j = around.j0; j <= around.j1; ++j) {
    const auto [from, to] = around.met(j);
    if (from > to) continue;
    const std::int32_t last = std::min(static_cast<std::int32_t>(to - kNear), around.i1);
    for (auto i = static_cast<std::int32_t>(from + kNear); i <= last && !search.over(error_); ++i) cell(around, i, j, shape, search);
  }
  if (search.worst > error_ && search.admissible) return;  // whatever finer samples say
  const Area open = around.open(shape);
  for (; around.asked != 0; around.asked &= around.asked - 1) {
    const auto block = static_cast<std::size_t>(std::countr_zero(around.asked));
    if (!tile.finer.empty() && tile.finer[block] >= 0)
      look(static_cast<std::size_t>(tile.finer[block]), open, shape, search);
    else if (search.tooCoarse)
      search.tooCoarse->push_back({{number, block}, open});
    else
      search.worst = std::numeric_limits<float>::infinity();
  }
}

// f(u, v, off) at the corners of the triangle's part of a cell, in spacings from the cell's corner. Instead of those that it does not have,
// `off` is not a number, which is neither greater nor smaller: a branch here is never foreseen.
template <class F>
void Judge::Around::forEachPlace(std::int32_t i, std::int32_t j, F&& f) const {
  constexpr float none = std::numeric_limits<float>::quiet_NaN();
  const float *const here = &off[index(i, j)], *const next = here + width();
  const float across = here[1] - here[0], down = next[0] - here[0], twist = next[1] - next[0] - across;
  const auto left = static_cast<float>(i), top = static_cast<float>(j);
  for (std::size_t k = 0; k < 2; ++k) {
    const auto at = static_cast<float>(k);
    const Lines::Part& line = row[static_cast<std::size_t>(j - j0) + k];
    const float from = std::max(line.from - left, 0.0f), to = std::min(line.to - left, 1.0f),
                base = from <= to ? here[0] + at * down : none;
    f(from, at, base + from * (across + at * twist));
    f(to, at, base + to * (across + at * twist));
  }
  for (std::size_t k = 0; k < 2; ++k) {
    const auto at = static_cast<float>(k);
    const Lines::Part& line = column[static_cast<std::size_t>(i - i0) + k];
    const float from = std::max(line.from - top, 0.0f), to = std::min(line.to - top, 1.0f),
                base = from <= to ? here[0] + at * across : none;
    f(at, from, base + from * (down + at * twist));
    f(at, to, base + to * (down + at * twist));
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const float x = u[k] - left, z = v[k] - top;
    const bool in = (x >= 0) & (x <= 1) & (z >= 0) & (z <= 1);
    f(x, z, (in ? here[0] : none) + x * across + z * (down + x * twist));
  }
}

// Between the grid's lines and within them, the difference of a bilinear surface and a plane is greatest at the corners of the triangle's
// part, but for the bulge along its edges.
void Judge::cell(Around& around, std::int32_t i, std::int32_t j, const Shape& shape, Search& search) const {
  const Tile& tile = around.tile;
  const float *const here = &around.off[around.index(i, j)], *const next = here + around.width();
  const Slack slack = tile.slackOf(i, j);
  float highest = std::max(std::max(here[0], here[1]), std::max(next[0], next[1])),
        lowest = std::min(std::min(here[0], here[1]), std::min(next[0], next[1]));
  if (const float all = std::max(highest + slack.above, slack.below - lowest); all <= error_) {
    search.passed = std::max(search.passed, all);
    return;
  }
  // Only the triangle's part.
  std::swap(highest, lowest);
  around.forEachPlace(i, j, [&](float, float, float off) {
    highest = std::max(highest, off);
    lowest = std::min(lowest, off);
  });
  const bool up = highest + slack.above >= slack.below - lowest;
  const float hidden = (up ? slack.above : slack.below) + around.bulge * std::abs(next[1] - next[0] - here[1] + here[0]),
              off = up ? highest : -lowest, most = off + hidden;
  if (most <= error_) {
    search.passed = std::max(search.passed, most);
    return;
  }
  const bool open = hidden > kTrust * error_ && tile.bits > 0;
  if (open && off <= error_) return around.ask(i, j);
  float u = 0, v = 0;
  around.forEachPlace(i, j, [&](float x, float z, float there) {
    if (there == (up ? off : -off)) u = x, v = z;
  });
  const float a = std::round(u), b = std::round(v);
  const bool sample = std::abs(u - a) < kNear && std::abs(v - b) < kNear;
  const bool sure = off - (sample ? 0 : up ? slack.below : slack.above) > error_;
  if (open && !sure) return around.ask(i, j);
  if (most <= search.worst) return;
  const Point2 at = around.point(i + static_cast<std::int32_t>(a), j + static_cast<std::int32_t>(b)), corner = around.point(i, j);
  const bool inside = sample && at.x > low_.x && at.x < high_.x && at.z > low_.z && at.z < high_.z && shape.holds(at);
  const auto mended = inside ? at : beside(shape, corner.x + u * tile.spacing(), corner.z + v * tile.spacing());
  // Along a side of the box there is no room for a vertex, and between points of the lattice no ground to be off; the points on it keep
  // the error by themselves.
  if (!mended && (shape.high.x <= low_.x + 1 || shape.low.x >= high_.x - 1 || shape.high.z <= low_.z + 1 || shape.low.z >= high_.z - 1))
    return;
  search.worst = most;
  search.at = mended.value_or(shape.corner[0]);
  search.admissible = mended.has_value();
}

}  // namespace ridgecast::box
