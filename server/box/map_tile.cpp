#include "server/box/map_tile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "server/box/vectors.h"

namespace ridgecast::box {

using lattice::Step;

namespace {

// The tile's samples along one axis, among the posts around them.
struct Axis {
  std::int64_t zero;                     // the first post's number
  std::vector<std::size_t> before;       // by sample: the post before it, counted from the first
  std::vector<terrain::Pitch> beyond;    // from that post to it
  std::vector<std::size_t> first, last;  // by cell: intervals between posts that it meets, counted as the posts before them
  std::vector<float> from, to;           // in the first, if it is the last

  void place(Step at, Step spacing, std::size_t samples, const terrain::RasterAxis& map) {
    terrain::Between found = map.at(at);
    zero = found.sample - 1;
    before.resize(samples);
    beyond.resize(samples);
    const auto [whole, rest] = terrain::RasterAxis{0, map.pitch}.at(spacing);
    for (std::size_t k = 0; k < samples; ++k) {
      before[k] = static_cast<std::size_t>(found.sample - zero);
      beyond[k] = found.parts;
      const bool over = found.parts + rest >= map.pitch;
      found.sample += whole + over;
      found.parts += over ? rest - map.pitch : rest;
    }
    const auto share = [&](terrain::Pitch parts) { return static_cast<float>(parts) / static_cast<float>(map.pitch); };
    first.resize(samples - 1);
    last.resize(samples - 1);
    from.resize(samples - 1);
    to.resize(samples - 1);
    for (std::size_t k = 0; k + 1 < samples; ++k) {
      const bool onPost = beyond[k + 1] == 0;
      first[k] = before[k];
      last[k] = before[k + 1] - onPost;
      from[k] = share(beyond[k]);
      to[k] = onPost ? 1 : share(beyond[k + 1]);
    }
  }
  std::size_t posts() const { return before.back() + 3; }
};

// Slack of many places; whole vectors may be written beyond their end.
struct Slacks {
  std::vector<float> below, above;
  void resize(std::size_t n) {
    below.resize(n + kLanes);
    above.resize(n + kLanes);
  }
};

RIDGECAST_INLINE void most(Floats& a, const Floats& b) { a = b > a ? b : a; }

// Along a row of posts a, b, c, d the bicubic (Catmull-Rom) is a cubic between b and c whose second derivative runs straight from
// P = 2 a - 5 b + 4 c - d to Q = 2 d - 5 c + 4 b - a. From p to q on a part of width w, it is off the chord by w^2 t (1 - t) / 6 *
// (p (2 - t) + q (1 + t)), at most w^2 (|p + q| / 16 + |p - q| / 124): below it where p and q are positive, above it where they are
// negative, so both are bounded by themselves. Here in steps for w = 1, of four rows side by side.
RIDGECAST_INLINE void curvature(const std::int32_t* posts, std::size_t apart, Floats& p, Floats& q) {
  std::array<Floats, 4> at;
  for (std::size_t k = 0; k < 4; ++k) {
    Ints post;
    load(post, posts + k * apart);
    at[k] = __builtin_convertvector(post, Floats);
  }
  p = 2 * at[0] - 5 * at[1] + 4 * at[2] - at[3];
  q = 2 * at[3] - 5 * at[2] + 4 * at[1] - at[0];
}
RIDGECAST_INLINE void off(const Floats& begin, const Floats& end, float* to) {
  const Floats zero{}, a = begin > zero ? begin : zero, b = end > zero ? end : zero, apart = a - b;
  store((a + b) / 16 + (apart > zero ? apart : -apart) / 124, to);
}

// By cell and line of `lines` lines of posts side by side.
RIDGECAST_VECTOR_CLONES void bend(const Axis& axis, const std::int32_t* posts, std::size_t lines, Slacks& out) {
  for (std::size_t cell = 0; cell < axis.first.size(); ++cell) {
    const std::size_t first = axis.first[cell], last = axis.last[cell];
    for (std::size_t k = 0; k < lines; k += kLanes) {
      float *const below = &out.below[cell * lines + k], *const above = &out.above[cell * lines + k];
      Floats p, q;
      if (first == last) {
        curvature(posts + (first - 1) * lines + k, lines, p, q);
        const Floats u = p + (q - p) * axis.from[cell], v = p + (q - p) * axis.to[cell];
        off(u, v, below);
        off(-u, -v, above);
        continue;
      }
      Floats highest{}, lowest{};
      for (std::size_t n = first; n <= last; ++n) {
        curvature(posts + (n - 1) * lines + k, lines, p, q);
        most(highest, p);
        most(highest, q);
        most(lowest, -p);
        most(lowest, -q);
      }
      store(highest / 8, below);
      store(lowest / 8, above);
    }
  }
}

// Across, four lines are blended with weights of which the middle two sum to at most 9/8 and the outer two, which are negative, to 1/8. By
// line of cells and cell along it.
RIDGECAST_VECTOR_CLONES void blend(const Axis& axis, const Slacks& bends, std::size_t lines, std::size_t count, Slacks& between,
                                   Slacks& out) {
  const std::size_t cells = axis.first.size(), begin = axis.first.front(), end = axis.last.back();
  const auto outermost = [](const float* from, std::size_t apart, Floats& to) __attribute__((always_inline)) {
    Floats other;
    load(to, from);
    load(other, from + apart);
    most(to, other);
  };
  for (std::size_t line = 0; line < count; ++line) {
    for (std::size_t n = begin; n <= end; n += kLanes) {
      const float *const b = &bends.below[line * lines + n], *const a = &bends.above[line * lines + n];
      Floats middleBelow, middleAbove, outerBelow, outerAbove;
      outermost(b, 1, middleBelow);
      outermost(a, 1, middleAbove);
      outermost(b - 1, 3, outerBelow);
      outermost(a - 1, 3, outerAbove);
      store(1.125f * middleBelow + 0.125f * outerAbove, &between.below[n]);
      store(1.125f * middleAbove + 0.125f * outerBelow, &between.above[n]);
    }
    for (std::size_t k = 0; k < cells; ++k) {
      float below = 0, above = 0;
      for (std::size_t n = axis.first[k]; n <= axis.last[k]; ++n) {
        below = std::max(below, between.below[n]);
        above = std::max(above, between.above[n]);
      }
      out.below[line * cells + k] = below;
      out.above[line * cells + k] = above;
    }
  }
}

// Off the bilinear surface it is by no more than the sum of both directions. `both`: metres, times the share along each axis.
struct Scale {
  float both, x, z;
};
void prove(const Axis& x, const Axis& z, const std::vector<std::int32_t>& posts, Scale scale, Tile& tile) {
  const std::size_t columns = x.posts(), rows = z.posts(), cells = x.first.size();
  thread_local std::vector<std::int32_t> turned;
  turned.resize(columns * rows + kLanes);
  for (std::size_t j = 0; j < rows; ++j)
    for (std::size_t i = 0; i < columns; ++i) turned[i * rows + j] = posts[j * columns + i];
  thread_local Slacks bends, between, byColumn, byRow;
  bends.resize(cells * std::max(rows, columns));
  between.resize(std::max(rows, columns));
  byColumn.resize(cells * cells);
  byRow.resize(cells * cells);
  bend(x, turned.data(), rows, bends);
  blend(z, bends, rows, cells, between, byColumn);
  bend(z, posts.data(), columns, bends);
  blend(x, bends, columns, cells, between, byRow);
  for (std::size_t j = 0; j < cells; ++j)
    for (std::size_t i = 0; i < cells; ++i)
      tile.slack[j * cells + i] = {scale.both * (scale.x * byColumn.below[i * cells + j] + scale.z * byRow.below[j * cells + i]),
                                   scale.both * (scale.x * byColumn.above[i * cells + j] + scale.z * byRow.above[j * cells + i])};
}

// The posts around a tile, which may be a few more than a map gives at a time.
void fetch(const terrain::Raster& map, const Axis& x, const Axis& z, std::vector<std::int32_t>& posts) {
  constexpr std::size_t most = terrain::kTileSide;
  posts.resize(x.posts() * z.posts() + kLanes);  // whole vectors are read
  thread_local std::vector<std::int32_t> part;
  for (std::size_t j = 0; j < z.posts(); j += most)
    for (std::size_t i = 0; i < x.posts(); i += most) {
      const std::size_t columns = std::min(most, x.posts() - i), rows = std::min(most, z.posts() - j);
      part.resize(columns * rows);
      map.samples(x.zero + static_cast<std::int64_t>(i), z.zero + static_cast<std::int64_t>(j), static_cast<std::int32_t>(columns),
                  static_cast<std::int32_t>(rows), part.data());
      for (std::size_t row = 0; row < rows; ++row) std::copy_n(&part[row * columns], columns, &posts[(j + row) * x.posts() + i]);
    }
}

// The heights of a tile, row by row.
void evaluate(const Axis& x, const Axis& z, const std::vector<std::int32_t>& posts, const terrain::RasterShape& shape, float* out) {
  constexpr std::size_t kMax = terrain::CubicPlaces::kMax, kRound = 4;
  const std::size_t columns = x.posts(), across = x.before.size(), room = (across + kRound - 1) / kRound * kRound;
  // By row of posts, for each sample the four posts around it: first all first ones, then all second ones.
  thread_local std::vector<std::int32_t> around;
  around.resize(z.posts() * 4 * room);
  for (std::size_t row = 0; row < z.posts(); ++row)
    for (std::size_t n = 0; n < 4; ++n) {
      const std::int32_t* const from = &posts[row * columns + n];
      std::int32_t* const to = &around[(row * 4 + n) * room];
      for (std::size_t k = 0; k < across; ++k) to[k] = from[x.before[k] - 1];
    }
  const float inverseX = shape.x.inverse(), inverseZ = shape.z.inverse();
  thread_local terrain::CubicPlaces places;
  std::size_t count = 0;  // of them
  const auto flush = [&] {
    terrain::cubicHeights(places, static_cast<int>(count), inverseX, inverseZ, out);
    out += count;
    count = 0;
  };
  thread_local std::vector<float> stepsX;
  stepsX.clear();
  for (const terrain::Pitch parts : x.beyond) stepsX.push_back(terrain::Between{0, parts}.steps());
  for (std::size_t j = 0; j < across; ++j) {
    const float stepsZ = terrain::Between{0, z.beyond[j]}.steps();
    for (std::size_t begin = 0; begin < across;) {
      if (count + kRound > kMax) flush();
      const std::size_t part = std::min(across - begin, (kMax - count) / kRound * kRound);
      for (std::size_t n = 0; n < 16; ++n) {
        const std::int32_t* const from = &around[((z.before[j] - 1) * 4 + n) * room + begin];
        for (std::size_t k = 0; k < part; k += kRound) std::copy_n(from + k, kRound, &places.samples[n][count + k]);
      }
      std::copy_n(&stepsX[begin], part, &places.beyondX[count]);
      std::fill_n(&places.beyondZ[count], part, stepsZ);
      count += part;
      begin += part;
    }
  }
  flush();
}

}  // namespace

void sampleMap(const terrain::Raster& map, const Frame& frame, Tile& tile) {
  const terrain::RasterShape& shape = map.shape();
  const Step spacing = Step{1} << (tile.bits + frame.unitBits);
  const lattice::Point corner = frame.global(tile.corner);
  const auto across = static_cast<std::size_t>(tile.across());
  thread_local Axis x, z;
  x.place(corner.x, spacing, across, shape.x);
  z.place(corner.z, spacing, across, shape.z);
  thread_local std::vector<std::int32_t> posts;
  fetch(map, x, z, posts);
  evaluate(x, z, posts, shape, tile.height);
  if (spacing == 1) return;  // every point of the lattice
  const double share = static_cast<double>(spacing) / shape.finest();
  const auto square = [&](const terrain::RasterAxis& axis) { return static_cast<float>(std::pow(shape.finest() / axis.steps(), 2)); };
  prove(x, z, posts, {static_cast<float>(share * share * lattice::kMetresPerStep), square(shape.x), square(shape.z)}, tile);
}

void addEdits(const terrain::Raster& edits, const Frame& frame, Tile& tile) {
  const terrain::RasterShape& shape = edits.shape();
  const Step spacing = Step{1} << (tile.bits + frame.unitBits), pitch = shape.x.of(1);
  const lattice::Point corner = frame.global(tile.corner);
  // Of the posts that a square of `side` steps reads, by how much the curve between them may leave one another at most.
  const auto swing = [&](Step x, Step z, Step side) {
    const std::int64_t a = shape.x.at(x).sample - 1, b = shape.z.at(z).sample - 1;
    const std::int64_t posts = side / pitch + 4;
    const terrain::Raster::Range range = edits.range(a, b, posts, posts);
    return static_cast<float>(1.575 * (static_cast<double>(range.highest) - range.lowest) * lattice::kMetresPerStep);
  };
  const Step side = spacing << tile.cellBits;
  if (swing(corner.x, corner.z, side) == 0) return;
  const int blockSide = 1 << Tile::kBlockBits;
  Tile rise{.corner = tile.corner, .bits = tile.bits, .cellBits = tile.cellBits, .slackBits = 0};
  std::vector<float> height(rise.count());
  std::vector<Slack> between(rise.squares());
  rise.height = height.data();
  rise.slack = between.data();
  const bool looks = spacing <= kPostsACell * pitch;
  if (looks) sampleMap(edits, frame, rise);
  for (int j = 0; j < tile.blocks(); ++j)
    for (int i = 0; i < tile.blocks(); ++i) {
      Slack most;
      if (looks) {
        for (int row = j * blockSide; row < (j + 1) * blockSide; ++row)
          for (int column = i * blockSide; column < (i + 1) * blockSide; ++column) {
            const Slack cell = rise.slackOf(column, row);
            most = {std::max(most.below, cell.below), std::max(most.above, cell.above)};
          }
      } else {
        most.below = most.above = swing(corner.x + (Step{i} << Tile::kBlockBits) * spacing,
                                        corner.z + (Step{j} << Tile::kBlockBits) * spacing, spacing << Tile::kBlockBits);
      }
      Slack& slack = tile.slack[tile.block(i, j)];
      slack = {slack.below + most.below, slack.above + most.above};
    }
}

}  // namespace ridgecast::box
