// What is remembered of a page of candidates, so that it need not be looked at again.
#include "server/refinement/screening.h"

#include <gtest/gtest.h>

#include <random>

#include "server/refinement/candidates.h"

namespace ridgecast::refinement {
namespace {

using triangulation::kNoEdge;
using triangulation::RegionId;
using triangulation::TriangleId;

constexpr std::int32_t kSide = 1 << 18;

struct OneSquare : triangulation::Partition {
  RegionId region = triangulation::kOutside;
  RegionId regionAt(triangulation::Point2 p) const override {
    return p.x >= 0 && p.z >= 0 && p.x < kSide && p.z < kSide ? region : triangulation::kOutside;
  }
};

struct World {
  World() : mesh(10'000, square), surface(mesh.triangleCapacity(), mesh.vertexCapacity(), false) {
    square.region = mesh.addRegion({0, 0, kSide});
    surface.regions.resize(square.region + 1);
    std::mt19937 rng(7);
    triangulation::WriteSet all;
    all.allowAll();
    const auto vertex = [&](std::int32_t x, std::int32_t z) {
      return triangulation::Vertex{x, z, static_cast<std::int32_t>(terrain->height({x, z}) * lattice::kStepsPerMetre), kNoEdge};
    };
    mesh.start(vertex(-kSide, -kSide), vertex(-kSide, 3 * kSide), vertex(3 * kSide, -kSide));
    for (int n = 0; n < 400; ++n) {
      const auto x = static_cast<std::int32_t>(rng() % kSide), z = static_cast<std::int32_t>(rng() % kSide);
      mesh.insert(vertex(x, z), mesh.locate({x, z}, mesh.anyTriangle(), all), all);
    }
  }
  View view() const {
    camera::Camera camera;
    camera.pose.y = terrain->height({0, 0}) + 200;
    camera.pose.yaw = 0.7;
    return View(camera, {0, 0}, 1000, 0, true);
  }
  std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 1).value();
  OneSquare square;
  triangulation::Triangulation mesh;
  Surface surface;
};

// Which pages a region gets depends on threads, so what another region left in one may not be seen: it once made two runs differ by when a
// candidate was looked at.
TEST(Screening, AFormerRegionsBoundsAreForgotten) {
  World clean, used;
  const View view = clean.view();
  const RegionId region = clean.square.region;
  const auto pages = clean.mesh.trianglePages().pagesOf(region);
  ASSERT_GT(pages.size(), 5u);
  ASSERT_EQ(used.mesh.trianglePages().pagesOf(region), pages);
  for (std::uint32_t page : pages) {
    PageScreen& screen = used.surface.screens[page];
    screen.travel = 990;
    screen.steepest = 0.3f;
    screen.seen = 0.2f;
    screen.nearest = 300;
    screen.asleep = 5;
    used.surface.dues[page].travel = 1e6;
  }
  HeightRange ground;
  evaluateFresh(clean.mesh, clean.surface, *clean.terrain, region, 3, Metric::kPixels, &view, ground);
  evaluateFresh(used.mesh, used.surface, *used.terrain, region, 3, Metric::kPixels, &view, ground);
  for (std::uint32_t page : pages) {
    const PageScreen &a = clean.surface.screens[page], &b = used.surface.screens[page];
    EXPECT_EQ(clean.surface.dues[page].travel, used.surface.dues[page].travel);
    EXPECT_EQ(clean.surface.dues[page].turn, used.surface.dues[page].turn);
    EXPECT_EQ(a.travel, b.travel);
    EXPECT_EQ(a.steepest, b.steepest);
    EXPECT_EQ(a.seen, b.seen);
    EXPECT_EQ(a.nearest, b.nearest);
    EXPECT_EQ(a.asleep, b.asleep);
  }
  EXPECT_EQ(clean.surface.regions[region].due.travel, used.surface.regions[region].due.travel);
}

// The bounds spare no candidate that is wanted: all along a way the same ones are told as where nothing is remembered.
TEST(Screening, SparesNothingThatIsWanted) {
  World remembers, forgets;
  const RegionId region = remembers.square.region;
  camera::Camera camera;
  camera.pose.x = camera.pose.z = -kSide;
  camera.pose.y = remembers.terrain->height({0, 0}) + 900;
  double best = -2, yaw = 0;  // towards the square
  for (double candidate = 0; candidate < 6.28; candidate += 0.05) {
    camera.pose.yaw = candidate;
    const camera::Vec3 ahead = camera::forward(camera.pose);
    if (ahead.x + ahead.z > best) best = ahead.x + ahead.z, yaw = candidate;
  }
  camera.pose.yaw = yaw;
  camera.pose.pitch = -0.3;
  double travel = 0;
  HeightRange ground;
  std::size_t told = 0, late = 0, pagesSpared = 0;
  for (int step = 0; step < 100; ++step) {
    const View view(camera, {0, 0}, travel, 0, false);
    if (step == 0)
      for (World* world : {&remembers, &forgets})
        evaluateFresh(world->mesh, world->surface, *world->terrain, region, 3, Metric::kPixels, &view, ground);
    for (std::uint32_t page : forgets.mesh.trianglePages().pagesOf(region)) {
      forgets.surface.screens[page].travel = -1;
      forgets.surface.dues[page].travel = kAlways;
      pagesSpared += remembers.surface.dues[page].travel > travel;
    }
    forgets.surface.regions[region].due.travel = kAlways;
    std::vector<Pending> known, all;
    screenPixels(remembers.mesh, remembers.surface, region, view, 6, known);
    screenPixels(forgets.mesh, forgets.surface, region, view, 6, all);
    for (const Pending& p : known) remembers.surface.wakeCandidate(p.triangle, region);
    auto next = known.begin();
    for (const Pending& p : all) {
      if (next != known.end() && next->triangle == p.triangle) {
        EXPECT_EQ(next->priority, p.priority);
        ++next;
        continue;
      }
      // Those asleep, for being specks or off the picture, may wake up a little later.
      const triangulation::TrianglePages::Mask asleep = remembers.surface.screens[p.triangle / CandidatePage::kSlots].asleep;
      EXPECT_TRUE((asleep >> (p.triangle % CandidatePage::kSlots)) & 1) << "step " << step;
      ++late;
    }
    EXPECT_EQ(next, known.end()) << "step " << step;
    told += all.size();
    camera.pose.x += 1200;
    camera.pose.z += 1200;
    travel += 1200 * 1.4143;
  }
  EXPECT_GT(told, 1000u);
  EXPECT_LT(late, told / 100);
  EXPECT_GT(pagesSpared, 100u);
}

}  // namespace
}  // namespace ridgecast::refinement
