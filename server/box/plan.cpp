#include "server/box/plan.h"

#include <algorithm>
#include <cmath>

#include "common/terrain/raster.h"

namespace ridgecast::box {

namespace {

constexpr double kSnapShare = 1.0 / 16;                   // of the error: what snapping a height may cost
constexpr double kLeastSpacing = 32, kMostSpacing = 512;  // steps between samples of a formula, at first; as far as the error, in between
// Samples for each triangle that there may be, and for all of them: at first, and in the end (430 MB; of a map 1.3 GB).
constexpr double kFirstATriangle = 64, kFirstSamples = 1 << 24;
constexpr std::uint64_t kMostATriangle = 256, kMostSamples = 100'000'000;

}  // namespace

Plan::Plan(const Box& box, const terrain::Raster* map, std::uint32_t mostTriangles)
    : error(box.error), most(mostTriangles), samples(std::min(kMostSamples, kMostATriangle * most)) {
  const double fits = kSnapShare * box.error * lattice::kStepsPerMetre;  // at most half a spacing of heights
  while (std::ldexp(1.0, vertical) <= fits && vertical < 12) ++vertical;
  const int horizontal = vertical + 1;
  low = {lattice::floorTo(box.low.x, horizontal), lattice::floorTo(box.low.z, horizontal)};
  high = {-lattice::floorTo(-box.high.x, horizontal), -lattice::floorTo(-box.high.z, horizontal)};
  const auto width = static_cast<double>(high.x - low.x), depth = static_cast<double>(high.z - low.z);
  // Points lie within 2^25 units of the anchor.
  frame.unitBits = std::clamp(std::ilogb(std::max(width, depth)) - 23, 0, horizontal);
  // What the error or the posts of a map ask for, or what is bearable.
  const double wanted = map ? map->shape().pitch : std::clamp(box.error * lattice::kStepsPerMetre, kLeastSpacing, kMostSpacing);
  const double bearable = std::sqrt(width * depth / std::min(kFirstSamples, kFirstATriangle * most));
  bits = std::max({0, std::ilogb(wanted) - frame.unitBits, static_cast<int>(std::ceil(std::log2(bearable))) - frame.unitBits});
  const int tile = bits + frame.unitBits + Samples::kCellBits;
  frame.anchor = {lattice::floorTo(low.x, tile), lattice::floorTo(low.z, tile)};
  const triangulation::Point2 from = frame.local(low), to = frame.local(high);
  corners = {from, {from.x, to.z}, to, {to.x, from.z}};
}

}  // namespace ridgecast::box
