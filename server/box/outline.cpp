#include "server/box/outline.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

namespace ridgecast::box {

using lattice::Step;
using triangulation::Point2;

namespace {

constexpr Step kSpacing = 32;  // steps between samples where the ground is not steep, at least; and at most 2^15 of them

}  // namespace

std::vector<Point2> divided(const terrain::Terrain& terrain, const Frame& frame, const Side& side) {
  Point2 from = side.from, to = side.to;
  const bool alongX = from.z == to.z;
  if (alongX ? from.x > to.x : from.z > to.z) std::swap(from, to);  // adjoining boxes divide a shared side alike
  const Step begin = alongX ? from.x : from.z, end = alongX ? to.x : to.z;
  const Step spacing = std::max<Step>(kSpacing >> frame.unitBits, ((end - begin) >> 15) + 1);
  const double limit = side.error * lattice::kStepsPerMetre;
  const auto place = [&](Step s) {
    return frame.global(alongX ? Point2{static_cast<std::int32_t>(s), from.z} : Point2{from.x, static_cast<std::int32_t>(s)});
  };
  std::vector<Step> x, z, first;
  for (Step s = begin; s < end; s += spacing) first.push_back(s);
  first.push_back(end);
  for (Step s : first) {
    x.push_back(place(s).x);
    z.push_back(place(s).z);
  }
  std::vector<std::int32_t> firstY(first.size());
  terrain.heightSteps(x, z, firstY);
  // What rises by more than the error from one sample to the next may be a wall anywhere between.
  std::vector<Step> at;
  std::vector<std::int32_t> y;
  const std::function<void(Step, std::int32_t, Step, std::int32_t)> halve = [&](Step a, std::int32_t ya, Step b, std::int32_t yb) {
    if (b - a > 1 && std::abs(yb - ya) > limit) {
      const Step middle = (a + b) / 2;
      const std::int32_t between = terrain.heightStep(place(middle));
      halve(a, ya, middle, between);
      halve(middle, between, b, yb);
    } else {
      at.push_back(b);
      y.push_back(yb);
    }
  };
  at.push_back(begin);
  y.push_back(firstY.front());
  for (std::size_t k = 1; k < first.size(); ++k) halve(first[k - 1], firstY[k - 1], first[k], firstY[k]);
  const auto snapped = [&](std::size_t k) { return static_cast<double>(lattice::roundTo(y[k], side.vertical)); };
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
