#include "server/box/outline.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ridgecast::box {

using lattice::Step;
using triangulation::Point2;

namespace {

constexpr Step kSpacing = 32;  // steps between samples, at least; and at most 2^15 of them

}  // namespace

std::vector<Point2> divided(const terrain::Terrain& terrain, const Frame& frame, const Side& side) {
  Point2 from = side.from, to = side.to;
  const bool alongX = from.z == to.z;
  if (alongX ? from.x > to.x : from.z > to.z) std::swap(from, to);  // adjoining boxes divide a shared side alike
  const Step begin = alongX ? from.x : from.z, end = alongX ? to.x : to.z;
  const Step spacing = std::max<Step>(kSpacing >> frame.unitBits, ((end - begin) >> 15) + 1);
  std::vector<Step> x, z, at;
  for (Step s = begin; s < end; s += spacing) at.push_back(s);
  at.push_back(end);
  for (Step s : at) {
    const lattice::Point p =
        frame.global(alongX ? Point2{static_cast<std::int32_t>(s), from.z} : Point2{from.x, static_cast<std::int32_t>(s)});
    x.push_back(p.x);
    z.push_back(p.z);
  }
  std::vector<std::int32_t> y(at.size());
  terrain.heightSteps(x, z, y);
  const auto snapped = [&](std::size_t k) { return static_cast<double>(lattice::roundTo(y[k], side.vertical)); };
  const double limit = side.error * lattice::kStepsPerMetre;
  std::vector<Point2> out;
  std::vector<std::pair<std::size_t, std::size_t>> pieces{{0, at.size() - 1}};
  while (!pieces.empty()) {
    const auto [a, b] = pieces.back();
    pieces.pop_back();
    double worst = limit;
    std::size_t where = 0;
    for (std::size_t k = a + 1; k < b; ++k) {
      const double t = static_cast<double>(at[k] - at[a]) / static_cast<double>(at[b] - at[a]);
      const double off = std::abs(snapped(a) + t * (snapped(b) - snapped(a)) - y[k]);
      if (off > worst) {
        worst = off;
        where = k;
      }
    }
    if (where == 0) continue;
    out.push_back(alongX ? Point2{static_cast<std::int32_t>(at[where]), from.z} : Point2{from.x, static_cast<std::int32_t>(at[where])});
    pieces.push_back({a, where});
    pieces.push_back({where, b});
  }
  return out;
}

}  // namespace ridgecast::box
