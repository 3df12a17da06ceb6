// Edits under a mesh that is there already: after the next iteration no vertex is off the new ground, at rest the mesh keeps its threshold
// there as elsewhere, and nothing depends on threads.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "server/pipeline/pipeline.h"
#include "tests/support/crater.h"
#include "tests/support/mesh_check.h"
#include "tests/support/rays.h"
#include "tests/support/verify.h"

namespace ridgecast::pipeline {
namespace {

using edits::Operation;
using lattice::Step;

using testing_support::m;

struct Rig {
  explicit Rig(unsigned threads = 2, const char* name = "alpine")
      : executor(threads),
        pool(executor.makePool(4)),
        base(terrain::create(name, 7).value()),
        history(base),
        pipeline(base, grant({.threshold = 1, .triangleBudget = 2'000'000}, {}), pool) {}
  camera::Camera standing(double x, double z, double altitude, double yaw, double pitch) const {
    constexpr double kDegree = std::numbers::pi / 180;
    camera::Camera c;
    c.pose.x = m(x);
    c.pose.z = m(z);
    c.pose.y = base->height({c.pose.x, c.pose.z}) + altitude;
    c.pose.yaw = yaw * kDegree;
    c.pose.pitch = pitch * kDegree;
    return c;
  }
  void edit(const std::vector<Operation>& operations) {
    std::vector<lattice::Area> areas;
    for (const Operation& o : operations) areas.push_back(edits::groundOf(history.add(history.prepare(o).value()).value()));
    terrain = std::make_shared<edits::EditedTerrain>(base, history.layer());
    pipeline.setGround(terrain, areas);
  }
  void settle(const camera::Camera& camera) {
    int n = 0;
    do pipeline.iterate(camera);
    while (!pipeline.settled() && ++n < 300);
    ASSERT_TRUE(pipeline.settled());
  }
  std::uint64_t hash() const {
    std::uint64_t sum = 0;
    for (const mesh::LeafState& leaf : pipeline.leaves()) sum += lattice::mix(leaf.hash + leaf.triangles);
    return sum;
  }
  void expectOnTheGround() const {
    std::vector<mesh::LeafMesh> leaves;
    for (const mesh::LeafState& state : pipeline.leaves()) {
      leaves.push_back(pipeline.extract(state.address));
      EXPECT_EQ(mesh::hashLeaf(leaves.back()), state.hash);
      for (const mesh::LocalVertex& v : leaves.back().vertices) {
        const lattice::Point p{leaves.back().address.x() + v.x, leaves.back().address.z() + v.z};
        const int level = leaves.back().address.level;  // snapped to it, to the one above, or to a finer one
        const std::int32_t spacing = std::int32_t{1} << lattice::verticalBits(level + 1);
        ASSERT_LE(std::abs(v.y - terrain->heightStep(p)), spacing / 2) << level;
      }
    }
    const testing_support::MeshReport report = testing_support::checkMesh(leaves);
    EXPECT_TRUE(report.clean()) << report.text();
    EXPECT_EQ(testing_support::verify(pipeline.mesh()), "");
  }

  scheduling::Executor executor;
  std::shared_ptr<scheduling::Pool> pool;
  std::shared_ptr<const terrain::Terrain> base, terrain = base;
  edits::History history;
  Pipeline pipeline;
};

std::vector<Operation> siteAt(const Rig& rig, double x, double z) {
  edits::Road road;
  road.line = {{m(x - 200), m(z - 50), 0}, {m(x), m(z - 90), 0}, {m(x + 180), m(z - 20), 0}};
  road.width = m(8);
  const std::int32_t height = rig.base->heightStep({m(x + 40), m(z)});
  return {
      {edits::Crater{{m(x), m(z)}, m(15), static_cast<std::int32_t>(m(6))}, 0},
      {edits::Crater{{m(x - 60), m(z + 30)}, m(2), static_cast<std::int32_t>(m(1))}, 0},
      {edits::Level{{{m(x + 30), m(z - 10)}, {m(x + 90), m(z - 10)}, {m(x + 90), m(z + 40)}, {m(x + 30), m(z + 40)}}, 0, height, 256}, 0},
      {road, 0}};
}

TEST(OtherGround, IsUnderEveryVertexAtOnce) {
  Rig rig;
  const camera::Camera camera = rig.standing(0, 0, 30, 0, -15);
  rig.settle(camera);
  rig.edit(siteAt(rig, 20, -150));
  rig.pipeline.iterate(camera);
  rig.expectOnTheGround();
  std::vector<Operation> undo;
  for (std::uint64_t n = 1; n <= 4; ++n) undo.push_back({edits::Undo{n}, 0});
  rig.edit(undo);
  rig.pipeline.iterate(camera);
  rig.expectOnTheGround();
}

TEST(OtherGround, KeepsTheThresholdAtRest) {
  for (const char* name : {"alpine", "canyon"}) {
    Rig rig(2, name);
    const camera::Camera camera = rig.standing(0, 0, 40, 10, -12);
    rig.settle(camera);
    rig.edit(siteAt(rig, 30, -180));
    rig.settle(camera);
    rig.expectOnTheGround();
    const auto error = testing_support::errorOnScreen(rig.pipeline, *rig.terrain, camera, 1, 128);
    EXPECT_LE(error.p99, 1.5) << name << " " << error.worst;
    EXPECT_LE(error.most, 8) << name << " " << error.worst;
  }
}

// A lake is a few large triangles.
TEST(OtherGround, ASmallEditIsFoundInALargeTriangle) {
  Rig rig;
  lattice::Point lake{0, 0};
  while (rig.base->height(lake) != 420 || rig.base->height({lake.x, lake.z - m(300)}) != 420) lake.z -= m(50);
  camera::Camera camera = rig.standing(0, static_cast<double>(lake.z) / 256, 60, 0, -10);
  rig.settle(camera);
  for (int k = 0; k < 20; ++k) {
    rig.edit({{edits::Crater{{lake.x + m(13 * k - 130), lake.z - m(250 + 7 * (k % 8))}, m(1.5), static_cast<std::int32_t>(m(2))}, 0}});
    EXPECT_GT(rig.pipeline.iterate(camera).inserted, 0u) << k;  // looked at before the camera rests
    rig.settle(camera);
  }
}

TEST(OtherGround, IsTheSameWithAnyNumberOfThreads) {
  std::vector<std::uint64_t> hashes[2];
  for (unsigned threads : {1u, 4u}) {
    Rig rig(threads);
    std::mt19937_64 random(5);
    for (int k = 0; k < 30; ++k) {
      const camera::Camera camera = rig.standing(4 * k, -3 * k, 25, 3 * k, -10);
      if (k % 3 == 2) {
        const auto place = [&] { return m(static_cast<double>(random() % 400) - 200); };
        rig.edit({{edits::Crater{{m(4 * k) + place(), m(-3 * k) + place()}, m(8), static_cast<std::int32_t>(m(3))}, 0}});
      }
      rig.pipeline.iterate(camera);
      hashes[threads > 1].push_back(rig.hash());
    }
    rig.expectOnTheGround();
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

TEST(OtherGround, WhereNobodyIsChangesNothing) {
  Rig rig;
  const camera::Camera camera = rig.standing(0, 0, 30, 0, -15);
  rig.settle(camera);
  const std::uint64_t before = rig.hash();
  rig.edit({{edits::Crater{{m(1e9), m(-1e9)}, m(15), static_cast<std::int32_t>(m(6))}, 0}});
  rig.settle(camera);
  EXPECT_EQ(rig.hash(), before);
}

}  // namespace
}  // namespace ridgecast::pipeline
