// The pass over a page of candidates: most of what screening costs.
#include "server/refinement/metric.h"

#include <algorithm>
#include <limits>

#include "common/terrain/vector_clones.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

namespace {

constexpr unsigned kWidth = triangulation::TrianglePages::kBlock, kVectors = triangulation::TrianglePages::kBlocks;
static_assert(kWidth == 16);
typedef float Floats __attribute__((vector_size(4 * kWidth)));
typedef std::int32_t Ints __attribute__((vector_size(4 * kWidth)));

#define INLINE inline __attribute__((always_inline))
// Halves: the low ones of both for k = 0, the high ones for 1. Quarters: the first and third of both, or the second and fourth.
template <int k>
INLINE void halves(const Ints& a, const Ints& b, Ints& out) {
  constexpr int n = 8 * k, m = n + 16;
  out =
      __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7, m, m + 1, m + 2, m + 3, m + 4, m + 5, m + 6, m + 7);
}
template <int k>
INLINE void quarters(const Ints& a, const Ints& b, Ints& out) {
  constexpr int n = 4 * k, m = n + 16;
  out = __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 8, n + 9, n + 10, n + 11, m, m + 1, m + 2, m + 3, m + 8, m + 9, m + 10,
                                m + 11);
}
INLINE float largest(const Floats& v) {
  const auto a = __builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7), b = __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15);
  const auto half = a > b ? a : b;
  const auto c = __builtin_shufflevector(half, half, 0, 1, 2, 3), d = __builtin_shufflevector(half, half, 4, 5, 6, 7);
  const auto quarter = c > d ? c : d;
  return std::max(std::max(quarter[0], quarter[1]), std::max(quarter[2], quarter[3]));
}
INLINE std::uint32_t united(const Ints& v) {  // the bits that any lane has
  const auto half = __builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7) | __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15);
  const auto quarter = __builtin_shufflevector(half, half, 0, 1, 2, 3) | __builtin_shufflevector(half, half, 4, 5, 6, 7);
  return static_cast<std::uint32_t>(quarter[0] | quarter[1] | quarter[2] | quarter[3]);
}

// Sixteen candidates at a time: the square of what is seen, and of the threshold, both times d^(2 p + 2).
template <bool kByArea>
INLINE PageLook look(const PageCandidates& page, const Eye& eye) {
  const Floats zero{}, nearest2 = zero + kNearest * kNearest;
  Floats steepest = zero, mostSeen = zero, nearest = zero + std::numeric_limits<float>::max();
  Ints wanted[kVectors]{}, any{};
  for (unsigned k = 0; k < kVectors; ++k) {
    if (!page[k]) continue;
    // Each line is four of x, z, y and error: sixteen of one are gathered.
    const auto& lines = reinterpret_cast<const Ints(&)[4]>(*page[k]);
    Ints places[2], rest[2], x, z, y, error;
    for (unsigned pair = 0; pair < 2; ++pair) {
      halves<0>(lines[2 * pair], lines[2 * pair + 1], places[pair]);
      halves<1>(lines[2 * pair], lines[2 * pair + 1], rest[pair]);
    }
    quarters<0>(places[0], places[1], x);
    quarters<1>(places[0], places[1], z);
    quarters<0>(rest[0], rest[1], y);
    quarters<1>(rest[0], rest[1], error);
    const Floats dx = __builtin_convertvector(x - eye.x, Floats), dz = __builtin_convertvector(z - eye.z, Floats),
                 dy = __builtin_convertvector(y, Floats) - eye.y;
    const Floats flat = dx * dx + dz * dz, d2 = flat + dy * dy, n = d2 < nearest2 ? nearest2 : d2;
    const Floats e = reinterpret_cast<Floats>(error) > zero ? reinterpret_cast<Floats>(error) : zero, e2 = e * e;
    Floats reach = n;  // d^(2 p)
    if constexpr (kByArea)
      for (unsigned lane = 0; lane < kWidth; ++lane) reach[lane] = n[lane] * __builtin_sqrtf(n[lane]);
    wanted[k] = eye.gain2 * e2 * flat >= eye.least * n * reach;
    any |= wanted[k];
    const Floats inverse = 1.0f / n, steep = wanted[k] ? zero : (kByArea ? e2 / reach : e2 * inverse), seen = steep * inverse * flat;
    steepest = steep > steepest ? steep : steepest;
    mostSeen = seen > mostSeen ? seen : mostSeen;
    nearest = n < nearest ? n : nearest;
  }
  PageLook result{0, largest(steepest), largest(mostSeen), -largest(-nearest)};
  if (united(any) != 0) {
    const Ints bits = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
    for (unsigned k = 0; k < kVectors; ++k) result.wanted |= PageScreen::Mask{united(wanted[k] & bits)} << (k * kWidth);
  }
  return result;
}
RIDGECAST_VECTOR_CLONES PageLook inPixels(const PageCandidates& page, const Eye& eye) { return look<false>(page, eye); }
RIDGECAST_VECTOR_CLONES PageLook byArea(const PageCandidates& page, const Eye& eye) { return look<true>(page, eye); }

}  // namespace

PageLook lookThrough(const Measure& measure, const PageCandidates& page, const Eye& eye) {
  return measure.byArea ? byArea(page, eye) : inPixels(page, eye);
}

}  // namespace ridgecast::refinement
