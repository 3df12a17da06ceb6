#include "server/box/plan.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"

namespace ridgecast::box {

namespace {

constexpr std::size_t kAsked = 256, kOutliers = 4;     // places where noise is measured; so many may lie at a wall
constexpr double kMaxNoise = 1.0 / 4;                  // of the error
constexpr double kSnapShare = 1.0 / 16;                // of the error: what snapping a height may cost
constexpr double kMinSpacing = 32, kMaxSpacing = 512;  // steps between samples of a formula, at first; as far as the error, in between
// Samples for each triangle that there may be, and for all of them: at first, and in the end (430 MB; of a map 1.3 GB).
constexpr double kFirstATriangle = 64, kFirstSamples = 1 << 24;
constexpr std::uint64_t kMaxATriangle = 256, kMaxSamples = 100'000'000;

// A formula's coordinates and heights are rounded, which makes small steps on slopes. Between neighbours on the lattice second differences
// are these alone, and half of one is what they add to what wider samples show.
double noiseOf(const terrain::Terrain& terrain, lattice::Point low, lattice::Point high) {
  constexpr std::array<lattice::Point, 5> kAround{{{0, 0}, {-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
  std::vector<lattice::Step> x, z;
  double a = 0, b = 0;  // of the box's sides: spread evenly over it (Roberts 2018, R2)
  for (std::size_t k = 0; k < kAsked; ++k, a = std::fmod(a + 0.7548776662466927, 1), b = std::fmod(b + 0.5698402909980532, 1))
    for (const lattice::Point& to : kAround) {
      x.push_back(low.x + static_cast<lattice::Step>(a * static_cast<double>(high.x - low.x)) + to.x);
      z.push_back(low.z + static_cast<lattice::Step>(b * static_cast<double>(high.z - low.z)) + to.z);
    }
  std::vector<float> h(x.size());
  terrain.heights(x, z, h);
  std::array<float, kAsked> bends;
  for (std::size_t k = 0, n = 0; k < kAsked; ++k, n += kAround.size())
    bends[k] = std::abs(h[n + 1] - 2 * h[n] + h[n + 2]) + std::abs(h[n + 3] - 2 * h[n] + h[n + 4]);
  const auto most = bends.end() - kOutliers - 1;
  std::nth_element(bends.begin(), most, bends.end());
  return static_cast<double>(*most) / 2;
}

}  // namespace

Plan::Plan(const Box& box, const terrain::Terrain& terrain, std::uint32_t mostTriangles)
    : error(box.error), most(mostTriangles), samples(std::min(kMaxSamples, kMaxATriangle * most)) {
  expects(box.error > 0 && mostTriangles > 0, "a box is asked for with an error above 0, and may have triangles");
  const double fits = kSnapShare * box.error * lattice::kStepsPerMetre;  // at most half a spacing of heights
  while (std::ldexp(1.0, vertical) <= fits && vertical < 12) ++vertical;
  const int horizontal = vertical + 1;
  low = {lattice::floorTo(box.low.x, horizontal), lattice::floorTo(box.low.z, horizontal)};
  high = {-lattice::floorTo(-box.high.x, horizontal), -lattice::floorTo(-box.high.z, horizontal)};
  const terrain::Raster* const map = terrain.raster();
  if (!map) noise = std::min(noiseOf(terrain, low, high), kMaxNoise * error);
  kept = static_cast<float>(error - noise);
  if (kept > error - noise) kept = std::nextafter(kept, 0.0f);
  const auto width = static_cast<double>(high.x - low.x), depth = static_cast<double>(high.z - low.z);
  // Points lie within 2^25 units of the anchor.
  frame.unitBits = std::clamp(std::ilogb(std::max(width, depth)) - 23, 0, horizontal);
  // What the error or the posts of a map ask for, or what is bearable.
  const double wanted = map ? map->shape().finest() : std::clamp(box.error * lattice::kStepsPerMetre, kMinSpacing, kMaxSpacing);
  const double bearable = std::sqrt(width * depth / std::min(kFirstSamples, kFirstATriangle * most));
  bits = std::max({0, std::ilogb(wanted) - frame.unitBits, static_cast<int>(std::ceil(std::log2(bearable))) - frame.unitBits});
  const int tile = bits + frame.unitBits + Samples::kCellBits;
  frame.anchor = {lattice::floorTo(low.x, tile), lattice::floorTo(low.z, tile)};
  const triangulation::Point2 from = frame.local(low), to = frame.local(high);
  corners = {from, {from.x, to.z}, to, {to.x, from.z}};
}

}  // namespace ridgecast::box
