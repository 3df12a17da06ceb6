// The pass over a page of candidates: most of what screening costs.
#include "server/refinement/metric.h"

#include <limits>
#include <utility>

#include "common/terrain/vector_clones.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

namespace {

// Sixteen candidates at a time: the square of what is seen, and of the threshold, both times d^(2 p + 2).
template <bool kByArea>
inline __attribute__((always_inline)) PageLook look(const PageCandidates& page, const Eye& eye) {
  constexpr unsigned kWidth = triangulation::TrianglePages::kBlock, kVectors = triangulation::TrianglePages::kBlocks;
  typedef float Floats __attribute__((vector_size(4 * kWidth)));
  typedef std::int32_t Ints __attribute__((vector_size(4 * kWidth)));
  const Floats zero{}, nearest2 = zero + kNearest * kNearest;
  Floats steepest = zero, mostSeen = zero, nearest = zero + std::numeric_limits<float>::max();
  Ints wanted[kVectors]{}, any{};
  constexpr auto lanes = std::make_index_sequence<kWidth>();
  for (unsigned k = 0; k < kVectors; ++k) {
    if (!page[k]) continue;
    const auto& lines = reinterpret_cast<const Ints(&)[4]>(*page[k]);
    // Each line is four of x, z, y and error: sixteen of one are gathered.
    Ints x, z, y, error;
    const auto gather = [&]<std::size_t... lane>(Ints & out, auto field, std::index_sequence<lane...>) __attribute__((always_inline)) {
      const Ints low = __builtin_shufflevector(lines[0], lines[1], (lane / 4 % 2 * 16 + field * 4 + lane % 4)...),
                 high = __builtin_shufflevector(lines[2], lines[3], (lane / 4 % 2 * 16 + field * 4 + lane % 4)...);
      out = __builtin_shufflevector(low, high, (lane / 8 * 16 + lane % 8)...);
    };
    gather(x, std::integral_constant<std::size_t, 0>(), lanes);
    gather(z, std::integral_constant<std::size_t, 1>(), lanes);
    gather(y, std::integral_constant<std::size_t, 2>(), lanes);
    gather(error, std::integral_constant<std::size_t, 3>(), lanes);
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
  // Halves against each other until all lanes hold the same.
  const auto fold = [&]<std::size_t... lane>(auto apart, std::index_sequence<lane...>) __attribute__((always_inline)) {
    const Floats s = __builtin_shufflevector(steepest, steepest, (lane ^ apart)...),
                 d = __builtin_shufflevector(nearest, nearest, (lane ^ apart)...),
                 m = __builtin_shufflevector(mostSeen, mostSeen, (lane ^ apart)...);
    steepest = s > steepest ? s : steepest;
    mostSeen = m > mostSeen ? m : mostSeen;
    nearest = d < nearest ? d : nearest;
    any |= __builtin_shufflevector(any, any, (lane ^ apart)...);
  };
  fold(std::integral_constant<std::size_t, 8>(), lanes);
  fold(std::integral_constant<std::size_t, 4>(), lanes);
  fold(std::integral_constant<std::size_t, 2>(), lanes);
  fold(std::integral_constant<std::size_t, 1>(), lanes);
  PageLook result{0, steepest[0], mostSeen[0], nearest[0]};
  if (any[0] != 0)
    for (unsigned k = 0; k < kVectors * kWidth; ++k)
      result.wanted |= static_cast<PageScreen::Mask>(wanted[k / kWidth][k % kWidth] != 0) << k;
  return result;
}
RIDGECAST_VECTOR_CLONES PageLook inPixels(const PageCandidates& page, const Eye& eye) { return look<false>(page, eye); }
RIDGECAST_VECTOR_CLONES PageLook byArea(const PageCandidates& page, const Eye& eye) { return look<true>(page, eye); }

}  // namespace

PageLook lookThrough(const Measure& measure, const PageCandidates& page, const Eye& eye) {
  return measure.byArea ? byArea(page, eye) : inPixels(page, eye);
}

}  // namespace ridgecast::refinement
