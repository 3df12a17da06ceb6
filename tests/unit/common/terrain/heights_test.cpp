// Heights of the built-in terrains: the same bits from every variant, everywhere; continuous; never repeating; filtered as promised.

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "common/terrain/terrain.h"
#include "common/terrain/variants.h"
#include "tests/unit/common/terrain/filtered.h"
#include "tests/unit/common/terrain/points.h"

namespace ridgecast::terrain {
namespace {

using lattice::Step;

class Heights : public testing::TestWithParam<std::size_t> {
 protected:
  std::shared_ptr<const Terrain> made(std::uint32_t seed) const { return create(builtIn()[GetParam()].name, seed).value(); }
  Functions functions(const Variant& v) const { return v.terrain[GetParam()]; }
};
class Filter : public Heights {};
constexpr auto kName = [](const testing::TestParamInfo<std::size_t>& i) { return std::string(builtIn()[i.param].name); };
INSTANTIATE_TEST_SUITE_P(Terrain, Heights, testing::Range(std::size_t{0}, kBuiltIns), kName);
INSTANTIATE_TEST_SUITE_P(Terrain, Filter, testing::Range(std::size_t{0}, kBuiltIns), kName);

std::vector<float> heightsOf(Functions f, const Points& p, std::uint32_t seed) {
  std::vector<float> out(p.x.size());
  f.heights(p.x.data(), p.z.data(), out.data(), out.size(), seed, nullptr);
  return out;
}

TEST_P(Heights, everyVariantReturnsTheSameBits) {
  ASSERT_FALSE(variants().empty());
  EXPECT_EQ(variants().front().name, "baseline");
  std::string names;
  for (const Variant& v : variants()) names.append(v.name).append(" ");
  std::printf("variants of this machine: %s\n", names.c_str());
  for (const double distance : kDistances) {
    const Points p = pointsAt(distance, 100'000);
    for (const std::uint32_t seed : {1u, 0xfedcba98u}) {
      const std::vector<float> reference = heightsOf(functions(variants().front()), p, seed);
      for (const Variant& v : variants().subspan(1)) {
        const std::vector<float> other = heightsOf(functions(v), p, seed);
        std::size_t different = 0;
        for (std::size_t i = 0; i < other.size(); ++i)
          different += std::bit_cast<std::uint32_t>(other[i]) != std::bit_cast<std::uint32_t>(reference[i]);
        EXPECT_EQ(different, 0u) << v.name << " at " << distance << " m, seed " << seed;
      }
    }
  }
}

TEST_P(Heights, doNotDependOnBatchOrNeighbours) {
  const auto terrain = made(11);
  const Points p = pointsAt(1e6, 700);
  std::vector<float> all(p.x.size());
  terrain->heights(p.x, p.z, all);
  for (const std::size_t n : {1u, 2u, 15u, 16u, 17u, 255u, 256u, 257u, 511u}) {
    std::vector<float> part(n + 1, -7.0f);
    terrain->heights(std::span(p.x).subspan(3, n), std::span(p.z).subspan(3, n), std::span(part).first(n));
    for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(part[i], all[i + 3]) << i << " of " << n;
    EXPECT_EQ(part[n], -7.0f) << "wrote past the end";
  }
}

TEST_P(Heights, stayInRangeUpToTheEdgeOfTheLattice) {
  const auto terrain = made(1);
  for (const double distance : {0.0, 1e6, 1e8, 1e12, 4.39e12}) {
    const Points p = pointsAt(distance, 20'000);
    std::vector<float> out(p.x.size());
    terrain->heights(p.x, p.z, out);
    for (const float h : out) {
      ASSERT_GE(h, 0.0f);
      ASSERT_LE(h, 4000.0f);
    }
    const auto [least, most] = std::minmax_element(out.begin(), out.end());
    EXPECT_GT(*most - *least, 350.0f);
  }
}

// Neighbouring steps (3.9 mm) differ by little, across borders of cells as inside them.
TEST_P(Heights, areContinuousAcrossCells) {
  const auto terrain = made(2);
  for (const double distance : kDistances) {
    const Step centre = lattice::floorTo(static_cast<Step>(distance * 256), lattice::kCellBits);
    std::vector<Step> x, z;
    for (Step k = -20; k < 20; ++k) {
      for (Step t = 0; t < 500; ++t) {
        const Step border = centre + (k << lattice::kCellBits);
        const Step along = centre + t * 12'345;
        x.insert(x.end(), {border - 1, border, along, along});
        z.insert(z.end(), {along, along, border - 1, border});
      }
    }
    std::vector<float> h(x.size());
    terrain->heights(x, z, h);
    std::vector<float> jump;
    for (std::size_t i = 0; i < h.size(); i += 2) jump.push_back(std::abs(h[i + 1] - h[i]));
    std::sort(jump.begin(), jump.end());
    EXPECT_LT(jump[jump.size() * 99 / 100], 0.020f) << distance;  // slope 5
    EXPECT_LT(jump.back(), 0.25f) << distance;
  }
}

TEST_P(Heights, areGentleEnoughForAMesh) {
  const auto terrain = made(1);
  const Points p = pointsAt(0, 50'000);
  Points q = p;
  for (Step& x : q.x) x += 256;
  std::vector<float> a(p.x.size()), b(p.x.size());
  terrain->heights(p.x, p.z, a);
  terrain->heights(q.x, q.z, b);
  std::size_t steep = 0;
  for (std::size_t i = 0; i < a.size(); ++i) steep += std::abs(a[i] - b[i]) > 2.1445f;  // 65 degrees
  EXPECT_LT(static_cast<double>(steep) / static_cast<double>(a.size()), 0.02);
}

TEST_P(Heights, doNotRepeat) {
  const auto terrain = made(1);
  const Points p = pointsAt(0, 400);
  std::vector<float> a(p.x.size()), b(p.x.size());
  terrain->heights(p.x, p.z, a);
  for (int bits = 5; bits <= 49; ++bits) {
    for (const bool alongX : {true, false}) {
      Points q = p;
      for (Step& v : alongX ? q.x : q.z) v += Step{1} << bits;
      terrain->heights(q.x, q.z, b);
      // Lakes are equal wherever they are; nothing else is.
      std::size_t equal = 0, land = 0;
      double difference = 0;
      for (std::size_t i = 0; i < a.size(); ++i) {
        if (a[i] == b[i] && a[i] == *std::min_element(a.begin(), a.end())) continue;
        ++land;
        equal += a[i] == b[i];
        difference += std::abs(a[i] - b[i]);
      }
      EXPECT_LT(equal, land / 50) << "2^" << bits;
      if (bits >= lattice::kCellBits + 2) {
        EXPECT_GT(difference / static_cast<double>(land), 40.0) << "2^" << bits;
      }
    }
  }
}

TEST_P(Heights, dependOnTheSeed) {
  const Points p = pointsAt(1e8, 2000);
  const std::vector<float> a = heightsOf(functions(variants().front()), p, 1), b = heightsOf(functions(variants().front()), p, 2);
  double difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference += std::abs(a[i] - b[i]);
  EXPECT_GT(difference / static_cast<double>(a.size()), 25.0);
  EXPECT_EQ(a, heightsOf(functions(variants().front()), p, 1));
}

TEST_P(Filter, footprintZeroIsTheGeometry) {
  for (const double distance : kDistances) {
    const Points p = pointsAt(distance, 5000);
    for (const Variant& v : variants()) {
      const std::vector<float> h = heightsOf(functions(v), p, 4);
      for (std::size_t i = 0; i < h.size(); ++i) {
        ASSERT_EQ(std::bit_cast<std::uint32_t>(filteredHeight(GetParam(), p.x[i], p.z[i], 0.0f, 4)), std::bit_cast<std::uint32_t>(h[i]))
            << v.name;
      }
    }
  }
}

TEST_P(Filter, convergesToTheGeometryAsTheFootprintShrinks) {
  const Points p = pointsAt(1e6, 2000);
  const Variant& v = variants().back();
  const std::vector<float> h = heightsOf(functions(v), p, 4);
  double previous = 1e9;
  for (const float footprint : {8000.0f, 1000.0f, 100.0f, 10.0f, 1.0f, 0.3f}) {
    double sum = 0;
    for (std::size_t i = 0; i < h.size(); ++i) sum += std::abs(filteredHeight(GetParam(), p.x[i], p.z[i], footprint, 4) - h[i]);
    sum /= static_cast<double>(h.size());
    EXPECT_LE(sum, previous) << footprint;
    EXPECT_LE(sum, footprint) << "an octave changes the height by no more than its wavelength";
    previous = sum;
  }
  EXPECT_EQ(previous, 0.0) << "a footprint finer than half the finest octave filters nothing";
}

}  // namespace
}  // namespace ridgecast::terrain
