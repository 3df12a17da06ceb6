#include "server/box/judge.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>

namespace ridgecast::box {

using triangulation::Point2;

namespace {

constexpr float kTrust = 0.05f;        // of the error: more slack than this asks for finer samples, less counts as error
constexpr std::int64_t kGlance = 400;  // samples, about, at most

}  // namespace

// The triangle, from its smallest corner on, so that nothing depends on how it came about.
struct Judge::Shape {
  std::array<Point2, 3> corner;
  std::array<std::int64_t, 3> dx, dz;  // of the edges, from corner k to the next
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
};

struct Judge::Search {
  int bits = 0;                             // units between samples, as a power of two, at least
  std::vector<Block>* tooCoarse = nullptr;  // null: a glance
  std::vector<std::size_t> asked = {};      // blocks of the tiles in hand
  float worst = 0, passed = 0;              // metres; with slack, what lies between samples that pass
  Point2 at = {};                           // where the worst is, or beside it
  bool admissible = false;
  std::size_t first = 0;  // of asked, for the tile in hand

  Worst found() const { return {std::max(worst, passed), at.x, at.z, admissible}; }

  // For finer samples in cells (i0, j0)..(i1, j1), as far as they lie in the tile.
  void ask(const Tile& tile, std::int32_t i0, std::int32_t j0, std::int32_t i1, std::int32_t j1) {
    const auto block = [&](std::int32_t cell) { return std::clamp(cell, 0, tile.cells() - 1) >> Tile::kBlockBits; };
    for (std::int32_t j = block(j0); j <= block(j1); ++j)
      for (std::int32_t i = block(i0); i <= block(i1); ++i)
        if (std::find(asked.begin() + static_cast<std::ptrdiff_t>(first), asked.end(), tile.block(i, j)) == asked.end())
          asked.push_back(tile.block(i, j));
  }
};

Worst Judge::glance(const Corners& corners) const {
  const Shape shape(corners);
  const auto cells = static_cast<std::uint64_t>(shape.twiceArea() / (2 * kGlance));
  Search search{.bits = static_cast<int>(std::bit_width(cells) + 1) / 2};
  samples_.forEach(shape.low, shape.high, [&](std::size_t tile) { look(tile, shape, search); });
  return search.found();
}

Worst Judge::verdict(const Corners& corners, std::vector<Block>& tooCoarse) const {
  const Shape shape(corners);
  Search search{.tooCoarse = &tooCoarse};
  samples_.forEach(shape.low, shape.high, [&](std::size_t tile) { look(tile, shape, search); });
  return search.found();
}

Worst Judge::verdict(const Corners& corners, const Block& block, std::vector<Block>& tooCoarse) const {
  const Shape shape(corners);
  Search search{.tooCoarse = &tooCoarse};
  look(static_cast<std::size_t>(samples_[block.tile].finer[block.block]), shape, search);
  return search.found();
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

// Where an edge crosses the lines of a grid, one after the other, exactly.
struct Line {
  std::int64_t at = 0, rest = 0, by = 0, restBy = 0, over = 1;  // at + rest / over; a line on, by + restBy / over more
  Line() = default;
  Line(std::int64_t top, std::int64_t step, std::int64_t bottom)
      : at(top / bottom), rest(top % bottom), by(step / bottom), restBy(step % bottom), over(bottom) {
    if (rest < 0) rest += over, --at;
    if (restBy < 0) restBy += over, --by;
  }
  void next() {
    at += by;
    rest += restBy;
    if (rest >= over) rest -= over, ++at;
  }
};

// The greatest distance of `count` heights from a line.
float farthest(const float* height, std::int32_t count, int stride, float base, float slope) {
  float most = 0;
  for (std::int32_t n = 0; n < count; ++n) most = std::max(most, std::abs(height[n * stride] - (base + static_cast<float>(n) * slope)));
  return most;
}

}  // namespace

void Judge::look(std::size_t number, const Shape& shape, Search& search) const {
  const Tile& tile = samples_[number];
  if (shape.high.x < tile.corner.x || shape.high.z < tile.corner.z || shape.low.x > tile.corner.x + tile.side() ||
      shape.low.z > tile.corner.z + tile.side())
    return;
  if (!search.tooCoarse) return rows(tile, shape, std::clamp(search.bits - tile.bits, 0, tile.cellBits), search);
  const std::size_t before = search.first = search.asked.size();
  rows(tile, shape, 0, search);
  crossings(tile, shape, search);
  for (std::size_t k = before; k < search.asked.size(); ++k) {
    const std::size_t block = search.asked[k];
    if (!tile.finer.empty() && tile.finer[block] >= 0)
      look(static_cast<std::size_t>(tile.finer[block]), shape, search);
    else
      search.tooCoarse->push_back({number, block});
  }
  search.asked.resize(before);
}

void Judge::rows(const Tile& tile, const Shape& shape, int strideBits, Search& search) const {
  const int bits = tile.bits + strideBits, stride = 1 << strideBits;
  // With strides the last line is the next tile's first.
  const std::int32_t last = strideBits == 0 ? tile.side() : tile.side() - 1;
  const auto first = [&](std::int32_t from, std::int32_t corner) { return from <= corner ? 0 : (from - corner + (1 << bits) - 1) >> bits; };
  // In strides.
  const std::int32_t j0 = first(std::max(shape.low.z, low_.z + 1), tile.corner.z),
                     j1 = (std::min({shape.high.z, high_.z - 1, tile.corner.z + last}) - tile.corner.z) >> bits,
                     left = first(std::max(shape.low.x, low_.x + 1), tile.corner.x),
                     right = (std::min({shape.high.x, high_.x - 1, tile.corner.x + last}) - tile.corner.x) >> bits;
  if (j0 > j1 || left > right) return;
  // The first point inside on each line, of edges that rise, and the last, of those that fall.
  std::array<Line, 3> edge;
  for (std::size_t k = 0; k < 3; ++k) {
    if (shape.dz[k] == 0) continue;
    const std::int64_t sign = shape.dz[k] > 0 ? 1 : -1, down = sign * shape.dz[k], along = sign * shape.dx[k], bottom = down << bits;
    const std::int64_t top = (std::int64_t{shape.corner[k].x} - tile.corner.x) * down +
                             along * (std::int64_t{tile.corner.z} + (std::int64_t{j0} << bits) - shape.corner[k].z);
    edge[k] = {sign > 0 ? top + bottom - 1 : top, along << bits, bottom};
  }
  const float slope = static_cast<float>(std::ldexp(shape.gx, bits));
  for (std::int32_t j = j0; j <= j1; ++j) {
    std::int64_t from = left, to = right;
    for (std::size_t k = 0; k < 3; ++k) {
      if (shape.dz[k] > 0)
        from = std::max(from, edge[k].at);
      else if (shape.dz[k] < 0)
        to = std::min(to, edge[k].at);
      edge[k].next();
    }
    if (from > to) continue;
    const auto i0 = static_cast<std::int32_t>(from) << strideBits, i1 = static_cast<std::int32_t>(to) << strideBits;
    const std::int32_t z = tile.corner.z + (j << bits);
    const auto base = static_cast<float>(shape.at(tile.corner.x + (i0 << tile.bits), z));
    const std::int32_t row = j << strideBits;
    const float* const height = &tile.height[tile.index(0, row)];
    const float most = farthest(height + i0, static_cast<std::int32_t>(to - from) + 1, stride, base, slope);
    const bool passes = search.tooCoarse && most + tile.most <= error_;
    if (passes) search.passed = std::max(search.passed, most + tile.most);
    if (most <= search.worst && (!search.tooCoarse || passes)) continue;
    int worst = -1;
    for (std::int32_t i = i0, n = 0; i <= i1; i += stride, ++n) {
      float off = std::abs(height[i] - (base + static_cast<float>(n) * slope));
      if (search.tooCoarse && !passes && off <= error_) {
        const float slack = tile.slackAround(i, row);
        if (off + slack <= error_)
          search.passed = std::max(search.passed, off + slack);
        else if (slack <= kTrust * error_ || tile.bits == 0)
          off += slack;
        else
          search.ask(tile, i - 1, row - 1, i, row);
      }
      if (off > search.worst) {
        search.worst = off;
        worst = i;
      }
    }
    if (worst >= 0) {
      search.at = {tile.corner.x + (worst << tile.bits), z};
      search.admissible = shape.holds(search.at);
    }
  }
}

void Judge::crossings(const Tile& tile, const Shape& shape, Search& search) const {
  const int cells = tile.cells();
  const double unit = std::ldexp(1.0, -tile.bits);
  // Along a side of the box there is no room for a vertex; the points on it keep the error by themselves.
  const bool besideSide =
      shape.high.x <= low_.x + 1 || shape.low.x >= high_.x - 1 || shape.high.z <= low_.z + 1 || shape.low.z >= high_.z - 1;
  for (std::size_t k = 0; k < 3; ++k) {
    const bool turned = triangulation::smaller(shape.corner[(k + 1) % 3], shape.corner[k]);  // both triangles of an edge say the same
    const Point2 p = shape.corner[turned ? (k + 1) % 3 : k], q = shape.corner[turned ? k : (k + 1) % 3];
    // In cells of the tile; the part of the edge in it is from + t * by, t0 <= t <= t1.
    const double px = (p.x - tile.corner.x) * unit, pz = (p.z - tile.corner.z) * unit, dx = (q.x - p.x) * unit, dz = (q.z - p.z) * unit;
    double t0 = 0, t1 = 1;
    const auto clip = [&](double from, double by) {
      if (by == 0) {
        if (from < 0 || from > cells) t1 = -1;
        return;
      }
      t0 = std::max(t0, ((by > 0 ? 0 : cells) - from) / by);
      t1 = std::min(t1, ((by > 0 ? cells : 0) - from) / by);
    };
    clip(px, dx);
    clip(pz, dz);
    if (t0 >= t1) continue;
    // How far the grid is from the edge there; in cell (i, j), where it is bilinear.
    const double from = turned ? shape.height[(k + 1) % 3] : shape.height[k],
                 rise = (turned ? shape.height[k] : shape.height[(k + 1) % 3]) - from;
    std::int32_t i = 0, j = 0;
    const float *here = nullptr, *below = nullptr;
    const auto off = [&](double t) {
      const double u = px + t * dx - i, v = pz + t * dz - j;
      const double upper = here[0] + u * (here[1] - here[0]), lower = below[0] + u * (below[1] - below[0]);
      return upper + v * (lower - upper) - (from + t * rise);
    };
    // The next line of the grid beyond t0, and how far lines are apart, along either axis.
    const auto first = [&](double at, double by) {
      if (by == 0) return 2.0;
      const double now = at + t0 * by;
      return ((by > 0 ? std::floor(now + 1e-9) + 1 : std::ceil(now - 1e-9) - 1) - at) / by;
    };
    double nextX = first(px, dx), nextZ = first(pz, dz), one = 0;
    const double apartX = dx == 0 ? 2 : 1 / std::abs(dx), apartZ = dz == 0 ? 2 : 1 / std::abs(dz);
    for (double t = t0; t < t1;) {
      const double to = std::min({nextX, nextZ, t1}), middle = (t + to) / 2;
      if (nextX <= to) nextX += apartX;
      if (nextZ <= to) nextZ += apartZ;
      i = std::clamp(static_cast<std::int32_t>(px + middle * dx), 0, cells - 1);
      j = std::clamp(static_cast<std::int32_t>(pz + middle * dz), 0, cells - 1);
      const std::size_t at = tile.index(i, j), under = at + static_cast<std::size_t>(tile.across());
      here = &tile.height[at];
      below = &tile.height[under];
      if (t == t0) one = off(t);
      const double two = off(middle), three = off(to), bend = one - 2 * two + three, lean = three - one;
      // A parabola through three points.
      double most = std::max(std::abs(one), std::abs(three)), where = std::abs(one) > std::abs(three) ? t : to;
      if (std::abs(lean) < 2 * std::abs(bend))
        if (const double peak = std::abs(two - lean * lean / (8 * bend)); peak > most) {
          most = peak;
          where = middle - lean / (4 * bend) * (to - t);
        }
      t = to;
      one = three;
      auto error = static_cast<float>(most);
      const float slack = tile.slackOf(i, j);
      if (error + slack > error_) {
        if (slack > kTrust * error_ && tile.bits > 0) {
          search.ask(tile, i, j, i, j);
          continue;  // the finer tile judges
        }
        error += slack;
      } else {
        search.passed = std::max(search.passed, error + slack);
      }
      if (error <= search.worst) continue;
      const auto mended = beside(shape, tile.corner.x + (px + where * dx) / unit, tile.corner.z + (pz + where * dz) / unit);
      if (!mended && besideSide) continue;  // between points of the lattice there is no ground to be off
      search.worst = error;
      search.at = mended.value_or(p);
      search.admissible = mended.has_value();
    }
  }
}

}  // namespace ridgecast::box
