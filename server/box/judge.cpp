#include "server/box/judge.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

namespace ridgecast::box {

using triangulation::Point2;

namespace {

constexpr float kTrust = 0.05f;        // of the error: more slack than this asks for finer samples, less counts as error
constexpr std::int64_t kGlance = 400;  // samples, about, at most
// Of a spacing. Less than any distance between a side and a sample beside it, more than the rounding of where a side crosses a line.
constexpr double kHair = 0x1p-44;
constexpr float kNear = 4e-6f;  // of a spacing: what floats do not tell apart in a tile

}  // namespace

// Where the triangle begins and ends on the parallel lines of a grid, in spacings from the grid's corner. A side's function, positive
// inside, is a whole number below 2^53 at the grid's points, so only the last multiplication and kHair decide what lies on it.
struct Judge::Lines {
  std::array<double, 3> at, by, per;  // the sides' functions on line 0; a line on, so much more; spacings for each of their units
  std::array<double, 3> from, to;     // 0, or without end where the side is no lower or no upper end

  struct Part {
    float from, to;
  };
  static constexpr Part kNone{1e30f, -1e30f};
  std::pair<double, double> on(std::int32_t line) const {
    double first = -1e30, last = 1e30;
    for (std::size_t k = 0; k < 3; ++k) {
      const double where = (at[k] + by[k] * line) * per[k];
      first = std::max(first, where + from[k]);
      last = std::min(last, where + to[k]);
    }
    return {first, last};
  }
  Part near(std::int32_t line) const {
    const auto [first, last] = on(line);
    return {static_cast<float>(first), static_cast<float>(last)};
  }
};

// The triangle, from its smallest corner on, so that nothing depends on how it came about.
struct Judge::Shape {
  std::array<Point2, 3> corner;
  std::array<std::int64_t, 3> dx, dz;          // of the edges, from corner k to the next
  std::array<double, 3> perX = {}, perZ = {};  // 1 / dx, 1 / dz; 0 where there is none
  Point2 low, high;
  std::array<double, 3> height;  // of the corners, metres
  double gx, gz;                 // the plane: metres a unit

  explicit Shape(const Corners& v) {
    std::size_t first = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (triangulation::smaller(v[k].at, v[first].at)) first = k;
    for (std::size_t k = 0; k < 3; ++k) {
      corner[k] = v[(first + k) % 3].at;
      height[k] = v[(first + k) % 3].y * lattice::kMetresPerStep;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      dx[k] = std::int64_t{corner[(k + 1) % 3].x} - corner[k].x;
      dz[k] = std::int64_t{corner[(k + 1) % 3].z} - corner[k].z;
      if (dx[k] != 0) perX[k] = 1 / static_cast<double>(dx[k]);
      if (dz[k] != 0) perZ[k] = 1 / static_cast<double>(dz[k]);
    }
    low = {std::min({corner[0].x, corner[1].x, corner[2].x}), std::min({corner[0].z, corner[1].z, corner[2].z})};
    high = {std::max({corner[0].x, corner[1].x, corner[2].x}), std::max({corner[0].z, corner[1].z, corner[2].z})};
    const double area = static_cast<double>(twiceArea()), up = height[1] - height[0], over = height[2] - height[0];
    gx = (static_cast<double>(dz[0]) * over + static_cast<double>(dz[2]) * up) / area;
    gz = -(static_cast<double>(dx[0]) * over + static_cast<double>(dx[2]) * up) / area;
  }
  std::int64_t twiceArea() const { return triangulation::orientation(corner[0], corner[1], corner[2]); }
  double at(double x, double z) const { return height[0] + gx * (x - corner[0].x) + gz * (z - corner[0].z); }
  bool holds(Point2 p) const {
    return triangulation::holds(corner[0], corner[1], corner[2], p) && p != corner[0] && p != corner[1] && p != corner[2];
  }
  // Side k's function: positive on the triangle's side of it.
  std::int64_t inside(std::size_t k, std::int32_t x, std::int32_t z) const {
    return dz[k] * (std::int64_t{x} - corner[k].x) - dx[k] * (std::int64_t{z} - corner[k].z);
  }
  // Whether the triangle has no part strictly inside low..high, by its sides.
  bool misses(Point2 from, Point2 to) const {
    for (std::size_t k = 0; k < 3; ++k)
      if (inside(k, dz[k] > 0 ? to.x : from.x, dx[k] > 0 ? from.z : to.z) <= 0) return true;
    return false;
  }
  // Of a grid with points so many units apart, a power of two, along x (z = its corner's and further) or along z.
  Lines lines(Point2 grid, double spacing, bool alongX) const {
    Lines lines;
    const double share = 1 / spacing;
    for (std::size_t k = 0; k < 3; ++k) {
      const double along = alongX ? static_cast<double>(dz[k]) : -static_cast<double>(dx[k]);
      lines.at[k] = static_cast<double>(inside(k, grid.x, grid.z));
      lines.by[k] = (alongX ? -static_cast<double>(dx[k]) : static_cast<double>(dz[k])) * spacing;
      lines.per[k] = (alongX ? -perZ[k] : perX[k]) * share;
      lines.from[k] = along > 0 ? 0 : -1e30;
      lines.to[k] = along < 0 ? 0 : 1e30;
    }
    return lines;
  }
  // Along an edge, a bilinear cell is a parabola: beyond its ends in the cell by at most this times the cell's twist.
  float bulge(double spacing) const {
    const double share = 1 / (spacing * spacing);
    double most = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto x = static_cast<double>(dx[k]), z = static_cast<double>(dz[k]);
      most = std::max(most, std::min({std::abs(x * perZ[k]), std::abs(z * perX[k]), std::abs(x * z) * share}));
    }
    return static_cast<float>(most / 4);
  }
};

struct Judge::Search {
  int bits = 0;                            // of a glance: units between samples, as a power of two, at least
  std::vector<Open>* tooCoarse = nullptr;  // null: it is over once something fails
  float worst = 0, passed = 0;             // metres; with slack, what lies between samples that pass
  Point2 at = {};                          // where the worst is, or beside it
  bool admissible = false;

  bool over(float error) const { return worst > error && !tooCoarse; }
  Worst found() const { return {std::max(worst, passed), at.x, at.z, admissible}; }
};

Worst Judge::glance(const Corners& corners) const {
  const Shape shape(corners);
  const auto cells = static_cast<std::uint64_t>(shape.twiceArea() / (2 * kGlance));
  Search search{.bits = static_cast<int>(std::bit_width(cells) + 1) / 2};
  samples_.forEach(shape.low, shape.high, [&](std::size_t tile) { skim(samples_[tile], shape, search); });
  return search.found();
}

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

namespace {

// Whole numbers of a place in a grid, which is above -1.
std::int32_t floorOf(double at) { return static_cast<std::int32_t>(at + 1) - 1; }
std::int32_t firstFrom(double at) { return floorOf(at - kHair) + 1; }
std::int32_t lastTo(double at) { return floorOf(at + kHair); }

}  // namespace

// At some of the tile's samples. Its last ones, unless all are looked at, are the next tile's first.
void Judge::skim(const Tile& tile, const Shape& shape, Search& search) const {
  const int strideBits = std::clamp(search.bits - tile.bits, 0, tile.cellBits), bits = tile.bits + strideBits, stride = 1 << strideBits;
  const std::int32_t last = ((tile.cells() + 1) >> strideBits) - 1;
  const auto first = [&](std::int32_t from, std::int32_t corner) { return from <= corner ? 0 : (from - corner + (1 << bits) - 1) >> bits; };
  const auto final = [&](std::int32_t to, std::int32_t corner) { return std::min(last, (to - corner) >> bits); };
  // In strides.
  const std::int32_t top = first(std::max(shape.low.z, low_.z + 1), tile.corner.z),
                     bottom = final(std::min(shape.high.z, high_.z - 1), tile.corner.z),
                     left = first(std::max(shape.low.x, low_.x + 1), tile.corner.x),
                     right = final(std::min(shape.high.x, high_.x - 1), tile.corner.x);
  if (top > bottom || left > right) return;
  const double spacing = stride * tile.spacing();
  const Lines lines = shape.lines(tile.corner, spacing, true);
  const auto slope = static_cast<float>(shape.gx * spacing);
  for (std::int32_t j = top; j <= bottom; ++j) {
    const auto [begin, end] = lines.on(j);
    const std::int32_t from = firstFrom(std::max<double>(begin, left)), to = lastTo(std::min<double>(end, right));
    if (from > to) continue;
    const std::int32_t z = tile.corner.z + (j << bits);
    const auto base = static_cast<float>(shape.at(tile.corner.x + (from << bits), z));
    const float* const height = &tile.height[tile.index(from << strideBits, j << strideBits)];
    std::int32_t worst = -1;
    for (std::int32_t n = 0; n <= to - from; ++n) {
      const float off = std::abs(height[n * stride] - (base + static_cast<float>(n) * slope));
      if (off > search.worst) {
        search.worst = off;
        worst = n;
      }
    }
    if (worst < 0) continue;
    search.at = {tile.corner.x + ((from + worst) << bits), z};
    search.admissible = shape.holds(search.at);
  }
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
