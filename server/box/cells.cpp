#include "server/box/cells.h"

#include <algorithm>

namespace ridgecast::box {

namespace {

RIDGECAST_VECTOR_CLONES void cross(Parts& parts, const Lines& lines, std::int32_t first, std::int32_t count, std::int32_t low,
                                   std::int32_t high) {
  for (std::int32_t k = 0; k < count; k += kLanes) {
    const Ints line = first + k + kNext;
    const Doubles number = __builtin_convertvector(line, Doubles);
    Doubles begin = number * 0 - 1e30, end = number * 0 + 1e30;
    for (std::size_t side = 0; side < 3; ++side) {
      const Doubles where = (lines.at[side] + lines.by[side] * number) * lines.per[side], from = where + lines.from[side],
                    to = where + lines.to[side];
      begin = from > begin ? from : begin;
      end = to < end ? to : end;
    }
    const Ints in = (line >= low) & (line <= high);
    const Floats none = __builtin_convertvector(kNext * 0, Floats) + 1e30f;
    store(in ? __builtin_convertvector(begin, Floats) : none, &parts.from[static_cast<std::size_t>(k)]);
    store(in ? __builtin_convertvector(end, Floats) : -none, &parts.to[static_cast<std::size_t>(k)]);
  }
}

struct Span {  // columns in a row of cells
  std::array<std::int32_t, Parts::kLines + kLanes> first, last;
};

// The columns that the triangle meets in each row of cells.
RIDGECAST_INLINE void span(const Cells& cells, Span& spans) {
  const Floats zero{};
  for (std::int32_t k = 0; k <= cells.j1 - cells.j0; k += kLanes) {
    const auto n = static_cast<std::size_t>(k);
    Floats from, to, nextFrom, nextTo;
    load(from, &cells.rows.from[n]);
    load(to, &cells.rows.to[n]);
    load(nextFrom, &cells.rows.from[n + 1]);
    load(nextTo, &cells.rows.to[n + 1]);
    from = nextFrom < from ? nextFrom : from;
    to = nextTo > to ? nextTo : to;
    const Floats row = __builtin_convertvector(cells.j0 + k + kNext, Floats);
    for (std::size_t c = 0; c < 3; ++c) {
      const Ints in = (row <= cells.v[c]) & (row + 1 >= cells.v[c]);
      const Floats u = zero + cells.u[c];
      from = (in & (u < from)) ? u : from;
      to = (in & (u > to)) ? u : to;
    }
    const auto left = static_cast<float>(cells.i0), right = static_cast<float>(cells.i1 + 1);
    from = from > left ? from : zero + left;
    to = to < right ? to : zero + right;
    const Ints none = from > to;
    from = none ? zero + right : from;
    to = none ? zero : to;
    const Ints first = __builtin_convertvector(from + kNear, Ints), last = __builtin_convertvector(to - kNear, Ints);
    store(first, &spans.first[n]);
    store(last < cells.i1 ? last : kNext * 0 + cells.i1, &spans.last[n]);
  }
}

// Of a row of four cells, from `column` on.
RIDGECAST_INLINE void slackOf(const Tile& tile, std::int32_t column, std::int32_t row, Floats& below, Floats& above) {
  const Slack* const slack = &tile.slack[static_cast<std::size_t>(row >> tile.slackBits) << (tile.cellBits - tile.slackBits)];
  if (tile.slackBits == 0) {
    Floats low, high;
    load(low, &slack[column].below);
    load(high, &slack[column + kLanes / 2].below);
    below = __builtin_shufflevector(low, high, 0, 2, 4, 6);
    above = __builtin_shufflevector(low, high, 1, 3, 5, 7);
    return;
  }
  std::array<float, kLanes> b, a;
  for (std::int32_t lane = 0; lane < kLanes; ++lane) {
    b[static_cast<std::size_t>(lane)] = slack[(column + lane) >> tile.slackBits].below;
    a[static_cast<std::size_t>(lane)] = slack[(column + lane) >> tile.slackBits].above;
  }
  load(below, b.data());
  load(above, a.data());
}

RIDGECAST_VECTOR_CLONES void judgeCells(Cells& cells, float error) {
  const Tile& tile = *cells.tile;
  const std::int32_t rows = cells.j1 - cells.j0 + 1;
  Span spans;
  span(cells, spans);
  const Floats zero{};
  Floats passed = zero;
  for (std::int32_t begin = cells.i0; begin <= cells.i1; begin += kLanes) {
    const std::int32_t start = std::min(begin, tile.cells() - kLanes);  // no further than the tile's end
    const Ints column = start + kNext;
    const Floats step = __builtin_convertvector(column - cells.i0, Floats) * cells.along,
                 nextStep = __builtin_convertvector(column - cells.i0 + 1, Floats) * cells.along;
    // The greatest and the least at two samples side by side.
    const auto measure = [&](std::int32_t k, Floats & most, Floats & least) __attribute__((always_inline)) {
      const double exact = cells.base + cells.down * k;
      const auto level = static_cast<float>(exact), rest = static_cast<float>(exact - level);
      const float* const height = &tile.height[tile.index(start, cells.j0 + k)];
      Floats here, next;
      load(here, height);
      load(next, height + 1);
      here = here - level - (rest + step);
      next = next - level - (rest + nextStep);
      float* const to = &cells.off[Cells::place(start, k)];
      store(here, to);
      store(next, to + 1);
      most = here > next ? here : next;
      least = here < next ? here : next;
    };
    Ints failed = kNext * 0;
    Floats most, least, nextMost, nextLeast;
    measure(0, most, least);
    for (std::int32_t k = 0; k < rows; ++k, most = nextMost, least = nextLeast) {
      measure(k + 1, nextMost, nextLeast);
      const Floats highest = most > nextMost ? most : nextMost, lowest = least < nextLeast ? least : nextLeast;
      Floats below, above;
      slackOf(tile, start, cells.j0 + k, below, above);
      const Floats up = highest + above, down = below - lowest, all = up > down ? up : down;
      const auto n = static_cast<std::size_t>(k);
      const Ints met = (column >= begin) & (column >= spans.first[n]) & (column <= spans.last[n]), passes = all <= error;
      failed |= met & ~passes & (kNext * 0 + static_cast<std::int32_t>(1u << k));
      passed = (met & passes & (all > passed)) ? all : passed;
    }
    std::uint32_t* const to = &cells.suspicious[static_cast<std::size_t>(start)];
    if (start < begin) {
      Ints before;
      load(before, to);
      failed |= column < begin ? before : kNext * 0;
    }
    store(failed, to);
  }
  cells.passed = 0;
  for (std::int32_t lane = 0; lane < kLanes; ++lane) cells.passed = std::max(cells.passed, passed[lane]);
}

}  // namespace

void Parts::cross(const Lines& lines, std::int32_t first, std::int32_t count, std::int32_t low, std::int32_t high) {
  box::cross(*this, lines, first, count, low, high);
}

void Cells::judge(float error) { judgeCells(*this, error); }

}  // namespace ridgecast::box
