// The laws of a camera's mesh, seen from inside, over a flight with jumps.
#include "server/generation/camera_mesh.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "server/generation/grid.h"
#include "server/refinement/triangle.h"
#include "tests/support/sanitized.h"
#include "tests/support/verify.h"

namespace ridgecast::generation {
namespace {

using lattice::Step;

camera::Camera cameraAt(const terrain::Terrain& terrain, double x, double z, double altitude, double yaw) {
  camera::Camera c;
  c.pose.x = static_cast<Step>(x * 256);
  c.pose.z = static_cast<Step>(z * 256);
  c.pose.y = terrain.height({c.pose.x, c.pose.z}) + altitude;
  c.pose.yaw = yaw;
  c.pose.pitch = -0.2;
  c.projection.width = 640;
  c.projection.height = 360;
  return c;
}

void evaluate(CameraMesh& mesh) {
  mesh.forEachChanged([&](std::size_t k) { mesh.mesh().evaluateFresh(mesh.leaves()[k]->region, nullptr); });
}

TEST(CameraMesh, KeepsItsLaws) {
  scheduling::Executor executor(2);
  auto pool = executor.makePool(2);
  const auto terrain = terrain::create("alpine", 1).value();
  CameraMesh mesh(terrain, 400000, refinement::Metric::kPixels);
  std::mt19937 rng(2);
  double x = 0, z = 0;
  constexpr int kIterations = testing_support::kSanitized ? 9 : 30;
  for (int n = 0; n < kIterations; ++n) {
    const auto camera = cameraAt(*terrain, x, z, 30 + rng() % 500, n * 0.2);
    mesh.select(camera.pose, terrain->height({camera.pose.x, camera.pose.z}));
    mesh.generate(*pool);
    evaluate(mesh);
    const refinement::View view(camera, mesh.mesh().anchor(), n * 1e12, n, false);  // far apart: nothing is skipped
    for (Leaf* leaf : mesh.leaves()) mesh.mesh().findWork({{{leaf->region, true, 1.5, &leaf->work}}}, view, 3);
    triangulation::WriteSet set;
    for (Leaf* leaf : mesh.leaves()) {
      set.allow(leaf->writeSet);
      mesh.mesh().removeUnneeded(leaf->region, view, set, leaf->work);
      mesh.mesh().insertWanted(leaf->region, view, set, leaf->work);
    }
    for (Leaf* leaf : mesh.leaves()) {
      mesh.mesh().insertDeferred(leaf->region, view, leaf->work);
      leaf->work.end();
    }
    evaluate(mesh);
    ASSERT_EQ(testing_support::verify(mesh), "") << "iteration " << n;
    const auto& t = mesh.mesh().triangulation();
    const lattice::Point anchor = mesh.mesh().anchor();
    std::set<std::pair<Step, Step>> points;
    for (triangulation::RegionId r = 0; r < t.regionLimit(); ++r) {
      if (!t.vertexPages().hasRegion(r)) continue;
      t.vertexPages().forEach(r, [&](triangulation::VertexId v) {
        if (v == triangulation::kInfinite) return;
        const auto& p = t.vertex(v);
        points.insert({anchor.x + p.x, anchor.z + p.z});
        ASSERT_LT(std::abs(p.x), 1 << 26);
        ASSERT_LT(std::abs(p.z), 1 << 26);
        int level = quadtree::kRootLevel;
        for (const Leaf* leaf : mesh.leaves())
          if (leaf->region == r && r != triangulation::kOutside) level = leaf->address.level;
        ASSERT_LE(static_cast<int>(mesh.mesh().extra(v).level), level + 1);
        ASSERT_EQ(p.y,
                  lattice::snapHeight(terrain->heightStep({anchor.x + p.x, anchor.z + p.z}), static_cast<int>(mesh.mesh().extra(v).level)));
      });
    }
    for (const Leaf* leaf : mesh.leaves())
      for (lattice::Point p : gridPoints(leaf->address)) ASSERT_TRUE(points.count({p.x, p.z}));
    // The stored candidates are points of the terrain, with the error they have (they may have been chosen one level away from now).
    int looked = 0;
    for (const Leaf* leaf : mesh.leaves())
      t.trianglePages().forEach(leaf->region, [&](triangulation::TriangleId id) {
        const auto c = mesh.mesh().candidate(id);
        if (rng() % 50 != 0 || c.error == 0) return;
        ++looked;
        const triangulation::Point2 p = c.point;
        const auto& v = t.triangle(id).v;
        for (int k = 0; k < 3; ++k) ASSERT_GE(triangulation::orientation(t.vertex(v[k]).point(), t.vertex(v[(k + 1) % 3]).point(), p), 0);
        const std::int32_t fine = terrain->heightStep({anchor.x + p.x, anchor.z + p.z});
        ASSERT_EQ(fine, c.y);
        ASSERT_NEAR(std::abs(refinement::heightOnTriangle(t, id, p) - lattice::snapHeight(fine, leaf->address.level)), std::abs(c.error),
                    1 << lattice::verticalBits(leaf->address.level + 1));
      });
    ASSERT_GT(looked, 0);
    x += static_cast<double>(rng() % 800);
    z -= static_cast<double>(rng() % 400);
    if (n == kIterations * 2 / 3) x += 1e7;
  }
}

}  // namespace
}  // namespace ridgecast::generation
