#include "server/box/judge.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "common/outcome/contract.h"
#include "server/box/cells.h"
#include "server/box/shape.h"

namespace ridgecast::box {

using triangulation::Point2;

namespace {

constexpr float kTrust = 0.05f;  // of the error: more slack than this asks for finer samples, less counts as error

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
  expects(samples_.finer(open.block) >= 0, "what is asked again was refined");
  const Shape shape(corners);
  Search search{.tooCoarse = &tooCoarse};
  look(static_cast<std::size_t>(samples_.finer(open.block)), open.area, shape, search);
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
  Cells cells;
  Parts columns;            // of the triangle, from line i0 on; crossed when the first cell needs them
  float bulge = -1;         // as of Shape, then too
  std::uint64_t asked = 0;  // blocks that must be finer
  Point2 low, high;         // cells that ask for that

  Around(const Tile& tile, const Area& area) {
    cells.tile = &tile;
    cells.i0 = std::max((area.low.x - tile.corner.x) >> tile.bits, 0);
    cells.j0 = std::max((area.low.z - tile.corner.z) >> tile.bits, 0);
    cells.i1 = std::min((area.high.x - 1 - tile.corner.x) >> tile.bits, tile.cells() - 1);
    cells.j1 = std::min((area.high.z - 1 - tile.corner.z) >> tile.bits, tile.cells() - 1);
  }
  const Tile& tile() const { return *cells.tile; }
  bool empty(const Shape& shape) const {
    return cells.i0 > cells.i1 || cells.j0 > cells.j1 || shape.misses(point(cells.i0, cells.j0), point(cells.i1 + 1, cells.j1 + 1));
  }
  Point2 point(std::int32_t i, std::int32_t j) const {
    return {tile().corner.x + (i << tile().bits), tile().corner.z + (j << tile().bits)};
  }
  // Lines of the tile between two places.
  static void cross(Parts& parts, const Shape& shape, const Tile& tile, bool alongX, std::int32_t first, std::int32_t last) {
    const std::int32_t corner = alongX ? tile.corner.z : tile.corner.x, low = alongX ? shape.low.z : shape.low.x,
                       high = alongX ? shape.high.z : shape.high.x;
    parts.cross(shape.lines(tile.corner, tile.spacing(), alongX), first, last - first + 1, -((corner - low) >> tile.bits),
                (high - corner) >> tile.bits);
  }
  void judge(const Shape& shape, float error) {
    const double spacing = tile().spacing();
    for (std::size_t k = 0; k < 3; ++k) {
      cells.u[k] = static_cast<float>((shape.corner[k].x - tile().corner.x) / spacing);
      cells.v[k] = static_cast<float>((shape.corner[k].z - tile().corner.z) / spacing);
    }
    const Point2 first = point(cells.i0, cells.j0);
    cells.base = shape.at(first.x, first.z);
    cells.down = shape.gz * spacing;
    cells.along = static_cast<float>(shape.gx * spacing);
    cross(cells.rows, shape, tile(), true, cells.j0, cells.j1 + 1);
    cells.judge(error);
  }
  // f(i, j) for the cells that did not pass at once, until it is false.
  template <class F>
  void forEachSuspicious(const Shape& shape, F&& f) {
    for (std::int32_t i = cells.i0; i <= cells.i1; ++i)
      for (std::uint32_t rows = cells.suspicious[static_cast<std::size_t>(i)]; rows != 0; rows &= rows - 1) {
        if (bulge < 0) {
          bulge = shape.bulge(tile().spacing());
          cross(columns, shape, tile(), false, cells.i0, cells.i1 + 1);
        }
        if (!f(i, cells.j0 + std::countr_zero(rows))) return;
      }
  }
  void ask(std::int32_t i, std::int32_t j) {
    low = asked == 0 ? Point2{i, j} : Point2{std::min(low.x, i), std::min(low.z, j)};
    high = asked == 0 ? Point2{i, j} : Point2{std::max(high.x, i), std::max(high.z, j)};
    expects(tile().block(i >> Tile::kBlockBits, j >> Tile::kBlockBits) < 64, "a block that asks has its bit");
    asked |= std::uint64_t{1} << tile().block(i >> Tile::kBlockBits, j >> Tile::kBlockBits);
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
  if (around.empty(shape)) return;
  around.judge(shape, error_);
  search.passed = std::max(search.passed, around.cells.passed);
  around.forEachSuspicious(shape, [&](std::int32_t i, std::int32_t j) {
    cell(around, i, j, shape, search);
    return !search.over(error_);
  });
  if (search.worst > error_ && search.admissible) return;  // whatever finer samples say
  const Area open = around.open(shape);
  for (; around.asked != 0; around.asked &= around.asked - 1) {
    const auto block = static_cast<std::size_t>(std::countr_zero(around.asked));
    if (const std::int32_t finer = samples_.finer({number, block}); finer >= 0)
      look(static_cast<std::size_t>(finer), open, shape, search);
    else if (search.tooCoarse)
      search.tooCoarse->push_back({{number, block}, open});
    else
      search.worst = std::numeric_limits<float>::infinity();
  }
}

namespace {

// The corners of a triangle's part of a cell, in spacings from the cell's corner, and what the bilinear surface is off there: where the
// lines above and below begin and end, those on the left and the right, and the triangle's own. Some are not there.
struct Places {
  std::array<Floats, 3> x, z, off;
  std::array<Ints, 3> there;

  Places(const Cells& cells, const Parts& columns, std::int32_t i, std::int32_t j) {
    const float *const here = &cells.offAt(i, j), *const next = here + Cells::kAcross;
    const float across = here[1] - here[0], down = next[0] - here[0], twist = next[1] - next[0] - across;
    const Floats far{0, 0, 1, 1};
    const auto n = static_cast<std::size_t>(j - cells.j0), m = static_cast<std::size_t>(i - cells.i0);
    x[0] = between(cells.rows, n, static_cast<float>(i), there[0]);
    z[0] = far;
    off[0] = here[0] + far * down + x[0] * (across + far * twist);
    x[1] = far;
    z[1] = between(columns, m, static_cast<float>(j), there[1]);
    off[1] = here[0] + far * across + z[1] * (down + far * twist);
    x[2] = Floats{cells.u[0], cells.u[1], cells.u[2], cells.u[2]} - static_cast<float>(i);
    z[2] = Floats{cells.v[0], cells.v[1], cells.v[2], cells.v[2]} - static_cast<float>(j);
    off[2] = here[0] + x[2] * across + z[2] * (down + x[2] * twist);
    there[2] = (x[2] >= 0) & (x[2] <= 1) & (z[2] >= 0) & (z[2] <= 1);
  }
  // Two lines from their number on: from, to, from, to.
  static Floats between(const Parts& parts, std::size_t line, float corner, Ints& there) {
    const Floats from = Floats{parts.from[line], parts.from[line], parts.from[line + 1], parts.from[line + 1]} - corner,
                 to = Floats{parts.to[line], parts.to[line], parts.to[line + 1], parts.to[line + 1]} - corner;
    const Floats begin = from > 0 ? from : Floats{}, end = to < 1 ? to : Floats{} + 1;
    there = begin <= end;
    return Floats{begin[0], end[0], begin[2], end[2]};
  }
  // The least and the greatest, which lie between these.
  std::pair<float, float> range(float least, float greatest) const {
    Floats low = Floats{} + greatest, high = Floats{} + least;
    for (std::size_t k = 0; k < 3; ++k) {
      low = (there[k] & (off[k] < low)) ? off[k] : low;
      high = (there[k] & (off[k] > high)) ? off[k] : high;
    }
    return {std::min(std::min(low[0], low[1]), std::min(low[2], low[3])), std::max(std::max(high[0], high[1]), std::max(high[2], high[3]))};
  }
  // Where it is that much off.
  std::pair<float, float> find(float wanted) const {
    for (std::size_t k = 3; k-- > 0;)
      for (int lane = 4; lane-- > 0;)
        if (there[k][lane] != 0 && off[k][lane] == wanted) return {x[k][lane], z[k][lane]};
    return {0, 0};
  }
};

}  // namespace

// Only the triangle's part. Between the grid's lines and within them, the difference of a bilinear surface and a plane is greatest at the
// part's corners, but for the bulge along its edges.
void Judge::cell(Around& around, std::int32_t i, std::int32_t j, const Shape& shape, Search& search) const {
  const Tile& tile = around.tile();
  const float *const here = &around.cells.offAt(i, j), *const next = here + Cells::kAcross;
  const Slack slack = tile.slackOf(i, j);
  const Places places(around.cells, around.columns, i, j);
  const auto [lowest, highest] = places.range(std::min(std::min(here[0], here[1]), std::min(next[0], next[1])),
                                              std::max(std::max(here[0], here[1]), std::max(next[0], next[1])));
  const bool up = highest + slack.above >= slack.below - lowest;
  const float hidden = (up ? slack.above : slack.below) + around.bulge * std::abs(next[1] - next[0] - here[1] + here[0]),
              off = up ? highest : -lowest, most = off + hidden;
  if (most <= error_) {
    search.passed = std::max(search.passed, most);
    return;
  }
  const bool open = hidden > kTrust * error_ && tile.bits > 0;
  if (open && off <= error_) return around.ask(i, j);
  const auto [u, v] = places.find(up ? off : -off);
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
