// The law of points: a client that follows them holds, after every iteration, exactly the server's leaves, with their errors and shades.
#include "server/encoding/held_points.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <random>
#include <utility>

#include "client/core/mesh/scene.h"
#include "common/terrain/shades.h"
#include "common/terrain/terrain.h"
#include "server/encoding/encoder.h"
#include "server/pipeline/pipeline.h"
#include "server/query/query.h"
#include "server/scheduling/pool.h"
#include "tests/support/flight.h"
#include "tests/support/sanitized.h"

namespace ridgecast::encoding {
namespace {

struct Flight {
  explicit Flight(const char* name, Form form = {}) : terrain(*terrain::create(name, 1)), encoder(terrain, executor.makePool(), form) {
    settings::Settings asked;
    asked.threshold = 2;
    asked.triangleBudget = 60'000;
    mesh = std::make_unique<pipeline::Pipeline>(terrain, pipeline::grant(asked, {}), executor.makePool());
    scene.follow({form.points, form.shades});
  }

  wire::Iteration iterate(const camera::Camera& camera) {
    mesh->iterate(camera);
    wire::Iteration iteration;
    encoder.encode(replica.send(mesh->leaves()), *mesh, iteration);
    return iteration;
  }
  void apply(const wire::Iteration& iteration) {
    const auto applied = scene.apply(iteration);
    ASSERT_TRUE(applied) << applied.error().message;
    ASSERT_FALSE(scene.lost()) << iteration.number;
    ASSERT_EQ(scene.hash(), iteration.meshHash) << iteration.number;
    replica.acknowledge(iteration.number, scene.hash());
  }
  void expectSameLeaves() const {
    ASSERT_EQ(scene.leaves().size(), mesh->leaves().size());
    for (const mesh::LeafState& leaf : mesh->leaves()) {
      mesh::LeafMesh held = *scene.leaves().at(leaf.address).mesh;
      mesh::canonicalize(held);
      EXPECT_TRUE(held == mesh->extract(leaf.address));
    }
  }

  std::shared_ptr<const terrain::Terrain> terrain;
  scheduling::Executor executor{2};
  std::unique_ptr<pipeline::Pipeline> mesh;
  replica::Replica replica{1, true};
  Encoder encoder;
  core::Scene scene;
};

// Of an hour's flight; ITERATIONS=36000 flies it ten a second.
int frames() {
  const char* const asked = std::getenv("ITERATIONS");
  return asked ? std::atoi(asked) : testing_support::rounds(80);
}

TEST(HeldPoints, MakeTheServersMeshOverFlightsDivesAndJumps) {
  for (const char* name : {"alpine", "canyon", "archipelago"}) {
    Flight f(name);
    std::size_t bytes = 0, leaves = 0;
    for (int k = 0; k < frames(); ++k) {
      const wire::Iteration iteration = f.iterate(testing_support::hour(*f.terrain, k * 3600.0 / frames()));
      EXPECT_TRUE(iteration.whole.empty());
      bytes += iteration.points.size();
      leaves += iteration.come.size();
      f.apply(iteration);
      ASSERT_FALSE(testing::Test::HasFatalFailure()) << name << ", " << k;
      if (k % (frames() < 1000 ? 10 : 100) == 0) f.expectSameLeaves();
    }
    f.expectSameLeaves();
    EXPECT_GT(bytes, 10'000u);
    EXPECT_GT(leaves, 2'000u);
  }
}

TEST(HeldPoints, MakeALeafWhenItIsReadAndNoOther) {
  Flight f("canyon");
  std::size_t unmade = 0, looked = 0;
  for (int k = 0; k < 60; ++k) {
    f.apply(f.iterate(testing_support::straight(*f.terrain, 0.7 * k)));
    for (const mesh::LeafState& state : f.mesh->leaves()) {
      const core::HeldLeaf& leaf = f.scene.index().at(state.address);
      const mesh::LeafMesh made = f.mesh->extract(state.address);
      EXPECT_EQ(leaf.triangles, made.triangles.size());
      EXPECT_EQ(leaf.hash, mesh::hashLeaf(made));
      for (const mesh::LocalVertex& v : made.vertices) {
        EXPECT_TRUE(v.x >= leaf.low.x && v.z >= leaf.low.z && v.y >= leaf.low.y);
        EXPECT_TRUE(v.x <= leaf.high.x && v.z <= leaf.high.z && v.y <= leaf.high.y);
      }
      unmade += !leaf.mesh;
      if (++looked % 101 != 0) continue;
      mesh::LeafMesh held = *f.scene.leaf(state.address)->mesh;
      mesh::canonicalize(held);
      EXPECT_TRUE(held == made);
    }
    ASSERT_FALSE(testing::Test::HasFailure()) << k;
  }
  EXPECT_GT(unmade, looked / 2);
  const lattice::Point at{f.mesh->leaves().front().address.x(), f.mesh->leaves().front().address.z()};
  const std::optional<double> height = f.scene.height(at);
  f.expectSameLeaves();
  EXPECT_EQ(f.scene.height(at), height);
}

TEST(HeldPoints, FollowAMeshThatBeginsAnewWithOtherSettings) {
  Flight f("canyon");
  for (int k = 0; k < 30; ++k) {
    f.apply(f.iterate(testing_support::straight(*f.terrain, 0.1 * k)));
    settings::Settings asked;
    asked.threshold = k % 2 == 0 ? 3 : 1;
    asked.metric = k % 10 < 5 ? settings::Metric::kPixels : settings::Metric::kArea;
    asked.triangleBudget = 60'000;
    if (k % 5 == 3) f.mesh->change(pipeline::grant(asked, {}));
  }
  f.expectSameLeaves();
}

TEST(HeldPoints, CarryErrorsAndShadesOfWhatTheyChange) {
  Flight f("alpine", {true, true, true});
  for (int k = 0; k < 12; ++k) f.apply(f.iterate(testing_support::straight(*f.terrain, 0.5 * k)));
  std::size_t equal = 0, all = 0;
  for (const auto& [address, leaf] : f.scene.leaves()) {
    EXPECT_FLOAT_EQ(leaf.error, query::deviation(*f.terrain, f.mesh->extract(address)));
    ASSERT_EQ(leaf.shades->size(), leaf.mesh->vertices.size());
    std::vector<lattice::Step> x, z;
    for (const mesh::LocalVertex& v : leaf.mesh->vertices) {
      x.push_back(address.x() + v.x);
      z.push_back(address.z() + v.z);
    }
    std::vector<terrain::Shade> shades(x.size());
    terrain::shadesAt(*f.terrain, x, z, address.level, shades);
    for (std::size_t k = 0; k < shades.size(); ++k) equal += shades[k] == (*leaf.shades)[k];
    all += shades.size();
  }
  // A vertex has the shade of the level at which it came; where leaves split or merged since, and along borders, that is another one.
  EXPECT_GT(equal, all * 3 / 4);
}

TEST(HeldPoints, AreThoseOfTheLeavesAfterARepairAndForWhoResumes) {
  Flight f("alpine");
  for (int k = 0; k < (testing_support::kSanitized ? 20 : 60); ++k) {
    if (k % 20 == 10) f.replica.resend({});
    if (k % 20 == 19) {
      f.scene.reconnect(false);
      f.replica = replica::Replica(1, true);
      ASSERT_TRUE(f.replica.resume(f.scene.held()));
    }
    const wire::Iteration iteration = f.iterate(testing_support::straight(*f.terrain, 2.0 * k));
    EXPECT_EQ(iteration.whole.empty(), k % 20 != 10 && (k == 0 || k % 20 != 19)) << k;
    f.apply(iteration);
  }
  f.expectSameLeaves();
}

// Ground that is another number of metres higher in a square at each edit.
class Raised : public terrain::Terrain {
 public:
  Raised(std::shared_ptr<const terrain::Terrain> base, lattice::Area area, int metres)
      : base_(std::move(base)), area_(area), metres_(static_cast<float>(metres)) {}
  std::string_view name() const override { return base_->name(); }
  std::string_view source() const override { return base_->source(); }
  std::uint32_t seed() const override { return base_->seed(); }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    base_->heights(x, z, out);
    for (std::size_t k = 0; k < out.size(); ++k) out[k] += area_.holds({x[k], z[k]}) ? metres_ : 0;
  }

 private:
  std::shared_ptr<const terrain::Terrain> base_;
  lattice::Area area_;
  float metres_;
};

// A client whose window is full misses iterations: leaves split and merge, the camera jumps, ground and limits change meanwhile.
TEST(HeldPoints, AreThoseOfTheLeavesWhateverHappenedBetweenTwoPayloads) {
  std::mt19937_64 random(27);
  const auto oneOf = [&](int count) { return static_cast<int>(random() % static_cast<std::uint64_t>(count)); };
  int raised = 0, moved = 0;
  for (int flight = 0; flight < 2; ++flight) {
    Flight f("alpine");
    double t = 0;
    lattice::Area before{};
    for (int k = 0; k < testing_support::rounds(60); ++k) {
      for (int unsent = oneOf(6); unsent > 0; --unsent) {
        t += oneOf(12) == 0 ? 500 : 0.1 * oneOf(20);
        const camera::Camera camera = testing_support::straight(*f.terrain, t);
        f.mesh->setInsertionLimit(oneOf(3) == 0 ? 0xffffffffu : static_cast<std::uint32_t>(1 + oneOf(300)));
        if (oneOf(4) == 0) {
          const lattice::Point at{camera.pose.x - (1 << 14) + oneOf(1 << 14), camera.pose.z - (1 << 14) + oneOf(1 << 14)};
          const lattice::Area area{at.x, at.z, at.x + (1 << 14), at.z + (1 << 14)};
          f.mesh->setGround(std::make_shared<Raised>(f.terrain, area, oneOf(20)), std::array{area, std::exchange(before, area)});
          ++raised;
        }
        f.mesh->iterate(camera);
      }
      if (oneOf(12) == 0) f.replica.resend({});
      wire::Iteration iteration;
      f.encoder.encode(f.replica.send(f.mesh->leaves()), *f.mesh, iteration);
      moved += !iteration.come.empty();
      f.apply(iteration);
      ASSERT_FALSE(testing::Test::HasFatalFailure()) << flight << ", " << k;
    }
    f.expectSameLeaves();
  }
  EXPECT_GT(raised, testing_support::rounds(60) / 2);
  EXPECT_GT(moved, testing_support::rounds(60) / 2);
}

}  // namespace
}  // namespace ridgecast::encoding
