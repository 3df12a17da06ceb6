#include "common/ground/march.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/ground/direction.h"

namespace ridgecast::ground {

using lattice::Step;

namespace {

// Heights of the ray above the ground at distances along it.
class Above {
 public:
  Above(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* taken)
      : terrain_(terrain), ray_(ray), taken_(taken), towards_(directionOf(ray)) {}

  // False if a distance lies beyond the lattice. Those before it are answered; `count` says how many.
  bool at(std::span<const double> distances, std::span<double> above, std::size_t& count) const {
    constexpr std::size_t kMax = 256;
    std::array<Step, kMax> x, z;
    std::array<float, kMax> height;
    for (count = 0; count < distances.size(); ++count) {
      const double t = distances[count];
      x[count] = ray_.x + static_cast<Step>(std::floor(towards_.x * t * lattice::kStepsPerMetre + 0.5));
      z[count] = ray_.z + static_cast<Step>(std::floor(towards_.z * t * lattice::kStepsPerMetre + 0.5));
      if (!lattice::positionIsValid(x[count], z[count])) break;
    }
    terrain_.heights(std::span(x).first(count), std::span(z).first(count), std::span(height).first(count));
    if (taken_) *taken_ += count;
    for (std::size_t k = 0; k < count; ++k) above[k] = ray_.y + towards_.y * distances[k] - height[k];
    return count == distances.size();
  }

 private:
  const terrain::Terrain& terrain_;
  const Ray& ray_;
  std::uint64_t* const taken_;
  const Direction towards_;
};

}  // namespace

double march(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* heights) {
  constexpr std::size_t kBlock = 64, kParts = 16;
  constexpr double kFinest = 0.25, kShare = 1.0 / 1024;
  constexpr int kRounds = 4;  // 1/4 m in 16^4 parts: 4 micrometres
  const Above ray_above(terrain, ray, heights);
  std::array<double, kBlock> distance, above;
  double before = 0, aboveBefore = 0;  // the last distance known to be above the ground
  bool first = true;
  std::size_t known = 0;
  for (bool last = false; !last;) {
    std::size_t n = 0;
    double t = before;
    if (first) distance[n++] = 0;
    while (n < kBlock && !last) {
      t += std::max(kFinest, t * kShare);
      last = t >= ray.reach;
      distance[n++] = last ? ray.reach : t;
    }
    if (!ray_above.at(std::span(distance).first(n), above, known)) last = true;
    if (first && known > 0 && above[0] <= 0) return 0;
    std::size_t hit = 0;
    while (hit < known && above[hit] > 0) ++hit;
    if (hit == known) {
      if (known == 0) return kNoHit;
      before = distance[known - 1];
      aboveBefore = above[known - 1];
      first = false;
      continue;
    }
    if (hit > 0) {
      before = distance[hit - 1];
      aboveBefore = above[hit - 1];
    }
    // Between `before`, above the ground, and `behind`, on or below it: find the first part with a crossing, repeatedly.
    double behind = distance[hit], aboveBehind = above[hit];
    for (int round = 0; round < kRounds && behind > before; ++round) {
      const double part = (behind - before) / kParts;
      for (std::size_t k = 0; k + 1 < kParts; ++k) distance[k] = before + part * static_cast<double>(k + 1);
      ray_above.at(std::span(distance).first(kParts - 1), above, known);
      std::size_t k = 0;
      while (k < known && above[k] > 0) ++k;
      if (k < known) behind = distance[k], aboveBehind = above[k];
      if (k > 0) before = distance[k - 1], aboveBefore = above[k - 1];
    }
    return before + (behind - before) * (aboveBefore / (aboveBefore - aboveBehind));
  }
  return kNoHit;
}

}  // namespace ridgecast::ground
