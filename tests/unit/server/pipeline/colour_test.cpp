// Refinement that follows colour: level ground with a sharp shore gets vertices along it, and the picture that vertices' colours make comes
// closer to the terrain's.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/shades.h"
#include "server/pipeline/pipeline.h"

namespace ridgecast::pipeline {
namespace {

double shoreAt(double z) { return 60 * std::sin(z / 70); }

// Level but for one hill far ahead to the right; water left of a winding shore, sand right of it.
class Shore : public terrain::Terrain {
 public:
  explicit Shore(bool coloured) : coloured_(coloured) {}
  std::string_view name() const override { return "shore"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < x.size(); ++k)
      out[k] = static_cast<float>(
          80 * std::max(0.0, 1 - std::hypot(static_cast<double>(x[k]) / 256 - 500, static_cast<double>(z[k]) / 256 + 500) / 120));
  }
  terrain::Colours colours() const override {
    if (!coloured_) return {};
    return [](const lattice::Step* x, const lattice::Step* z, const float*, const std::array<float, 3>*, float, std::array<float, 3>* out,
              std::size_t count, std::uint32_t) {
      for (std::size_t k = 0; k < count; ++k)
        out[k] = static_cast<double>(x[k]) / 256 < shoreAt(static_cast<double>(z[k]) / 256) ? std::array{0.02f, 0.06f, 0.1f}
                                                                                            : std::array{0.5f, 0.4f, 0.25f};
    };
  }

 private:
  bool coloured_;
};

struct Rig {
  explicit Rig(double colourError, bool coloured = true, unsigned threads = 2)
      : executor(threads),
        pool(executor.makePool(8)),
        terrain(std::make_shared<Shore>(coloured)),
        pipeline(terrain, grant({.threshold = 1, .colourError = colourError}, {}), pool) {}
  int settle(const camera::Camera& camera) {
    int n = 0;
    do pipeline.iterate(camera);
    while (!pipeline.settled() && ++n < 300);
    return n;
  }
  std::uint64_t hash() const {
    std::uint64_t sum = 0;
    for (const mesh::LeafState& leaf : pipeline.leaves()) sum += lattice::mix(leaf.hash + leaf.triangles);
    return sum;
  }
  // Calls f(corners in metres, their shades) for each triangle.
  template <class F>
  void forEachTriangle(F&& f) const {
    for (const mesh::LeafState& state : pipeline.leaves()) {
      const mesh::LeafMesh leaf = pipeline.extract(state.address);
      std::vector<lattice::Step> x, z;
      for (const mesh::LocalVertex& v : leaf.vertices) {
        x.push_back(leaf.address.x() + v.x);
        z.push_back(leaf.address.z() + v.z);
      }
      std::vector<terrain::Shade> shades(x.size());
      terrain::shadesAt(*terrain, x, z, leaf.address.level, shades);
      for (const mesh::Triangle& t : leaf.triangles) {
        std::array<std::array<double, 2>, 3> at;
        std::array<double, 3> red;
        for (std::size_t k = 0; k < 3; ++k) {
          at[k] = {static_cast<double>(x[t[k]]) / 256, static_cast<double>(z[t[k]]) / 256};
          red[k] = shades[t[k]].red / 255.0;
        }
        f(at, red);
      }
    }
  }
  scheduling::Executor executor;
  std::shared_ptr<scheduling::Pool> pool;
  std::shared_ptr<const Shore> terrain;
  Pipeline pipeline;
};

camera::Camera standing(double x = 0) {
  camera::Camera c;
  c.pose.x = std::llround(x * 256);
  c.pose.y = 40;
  c.pose.pitch = -0.5;
  c.projection.width = 320;
  c.projection.height = 180;
  return c;
}

// The mean difference of red, as vertices carry it, between picture and terrain: a ray for every eighth pixel, level ground below.
double difference(const Rig& rig, const camera::Camera& camera) {
  const camera::Vec3 forward = camera::forward(camera.pose), right = camera::right(camera.pose), up = camera::up(camera.pose);
  const double tangent = std::tan(camera.projection.verticalFov / 2);
  std::vector<std::array<double, 3>> places;  // x, z, and the red that was found
  for (int row = 0; row < 90; ++row)
    for (int column = 0; column < 160; ++column) {
      const double u = (column / 80.0 - 1) * tangent * camera.projection.aspect(), v = (1 - row / 45.0) * tangent;
      const camera::Vec3 ray{forward.x + u * right.x + v * up.x, forward.y + u * right.y + v * up.y, forward.z + u * right.z + v * up.z};
      if (ray.y > -0.05) continue;
      const double t = camera.pose.y / -ray.y;
      places.push_back({static_cast<double>(camera.pose.x) / 256 + t * ray.x, t * ray.z, -1});
    }
  rig.forEachTriangle([&](const auto& at, const auto& red) {
    const auto& [a, b, c] = at;
    const double area = (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1]);
    const double low = std::min({a[0], b[0], c[0]}), high = std::max({a[0], b[0], c[0]});
    for (auto& p : places) {
      if (p[0] < low || p[0] > high) continue;
      const double wb = ((p[1] - a[1]) * (c[0] - a[0]) - (p[0] - a[0]) * (c[1] - a[1])) / area,
                   wc = ((b[1] - a[1]) * (p[0] - a[0]) - (b[0] - a[0]) * (p[1] - a[1])) / area;
      if (wb >= 0 && wc >= 0 && wb + wc <= 1) p[2] = red[0] + wb * (red[1] - red[0]) + wc * (red[2] - red[0]);
    }
  });
  double sum = 0;
  for (const auto& p : places) {
    EXPECT_GE(p[2], 0) << "no triangle at " << p[0] << ", " << p[1];
    sum += std::abs(p[2] - std::sqrt(p[0] < shoreAt(p[1]) ? 0.02 : 0.5));
  }
  return sum / static_cast<double>(places.size());
}

// Triangles shorter than 8 m, near the camera, that the shore crosses.
int atTheShore(const Rig& rig) {
  int found = 0;
  rig.forEachTriangle([&](const auto& at, const auto& red) {
    if (red[0] == red[1] && red[1] == red[2]) return;
    double longest = 0;
    for (std::size_t k = 0; k < 3; ++k)
      longest = std::max(longest, std::hypot(at[k][0] - at[(k + 1) % 3][0], at[k][1] - at[(k + 1) % 3][1]));
    found += longest < 8;
  });
  return found;
}

TEST(FollowingColour, PutsVerticesAlongAShoreAndSharpensThePicture) {
  Rig plain(0), following(0.1);
  const camera::Camera camera = standing();
  EXPECT_LT(plain.settle(camera), 300);
  const int iterations = following.settle(camera);
  EXPECT_LT(iterations, 300);
  const double before = difference(plain, camera), after = difference(following, camera);
  std::uint64_t a = 0, b = 0;
  for (const auto& leaf : plain.pipeline.leaves()) a += leaf.triangles;
  for (const auto& leaf : following.pipeline.leaves()) b += leaf.triangles;
  std::printf("difference %.4f without, %.4f with; %d and %d short triangles at the shore; %llu and %llu triangles, %d iterations\n",
              before, after, atTheShore(plain), atTheShore(following), static_cast<unsigned long long>(a),
              static_cast<unsigned long long>(b), iterations);
  EXPECT_LT(after, before / 3);
  EXPECT_EQ(atTheShore(plain), 0);
  EXPECT_GT(atTheShore(following), 50);
}

// What colour has brought goes again when the camera has left, and the mesh is the same for any number of threads.
TEST(FollowingColour, ComesAndGoesWithTheCameraWhateverTheThreads) {
  Rig one(0.1, true, 1), two(0.1);
  for (const double x : {0.0, 30.0, 60.0, 9000.0, 9000.0}) {
    for (Rig* rig : {&one, &two}) EXPECT_LT(rig->settle(standing(x)), 300) << x;
    EXPECT_EQ(one.hash(), two.hash()) << x;
  }
  EXPECT_EQ(atTheShore(two), 0);
}

TEST(FollowingColour, ChangesNothingForOthers) {
  Rig plain(0, false), coloured(0.1), following(0.1, false), off(0);
  for (Rig* rig : {&plain, &coloured, &following, &off}) rig->settle(standing());
  EXPECT_NE(plain.hash(), coloured.hash());
  EXPECT_EQ(plain.hash(), following.hash());
  EXPECT_EQ(plain.hash(), off.hash());
}

TEST(FollowingColour, IsGrantedWithinLimits) {
  EXPECT_EQ(grant({.colourError = 1e-5}, {}).colourError, settings::kMinColourError);
  EXPECT_EQ(grant({.colourError = 0.2}, {}).colourError, 0.2);
  EXPECT_EQ(grant({.metric = settings::Metric::kThesis, .colourError = 0.2}, {}).colourError, 0);
}

}  // namespace
}  // namespace ridgecast::pipeline
