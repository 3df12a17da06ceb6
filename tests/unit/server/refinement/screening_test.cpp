// What is remembered of a page of candidates, so that it need not be looked at again.
#include "server/refinement/adaptive_mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace ridgecast::refinement {
namespace {

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
  World() : mesh(terrain, 10'000, Metric::kPixels, square) {
    square.region = mesh.addRegion({0, 0, kSide}, 3);
    fill();
  }
  void fill() {
    std::mt19937 rng(7);
    const auto point = [&](std::int32_t x, std::int32_t z) { return GridPoint{{x, z}, terrain->heightStep({x, z})}; };
    mesh.start(point(-kSide, -kSide), point(-kSide, 3 * kSide), point(3 * kSide, -kSide));
    TriangleId hint = mesh.triangulation().anyTriangle();
    for (int n = 0; n < 400; ++n) {
      const auto x = static_cast<std::int32_t>(rng() % kSide), z = static_cast<std::int32_t>(rng() % kSide);
      mesh.insertGrid(std::vector{point(x, z)}, hint);
    }
  }
  std::vector<std::uint32_t> pages() const { return mesh.triangulation().trianglePages().pagesOf(square.region); }
  View view(double travel) const {
    camera::Camera camera;
    camera.pose.y = terrain->height({0, 0}) + 200;
    camera.pose.yaw = 0.7;
    return View(camera, {0, 0}, travel, 0, true);
  }
  std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 1).value();
  OneSquare square;
  AdaptiveMesh mesh;
};

// Which pages a region gets depends on threads, so what another region left in one may not be seen: it once made two runs differ by when a
// candidate was looked at.
TEST(Screening, AFormerRegionsBoundsAreForgotten) {
  World clean, used;
  const View earlier = used.view(990), view = clean.view(1000);
  const RegionId region = clean.square.region;
  ASSERT_GT(clean.pages().size(), 5u);
  // The same triangles come a second time, to pages of which most are the same.
  used.mesh.evaluateFresh(region, &earlier);
  Work work;
  used.mesh.findWork({{{region, true, 0, &work}}}, earlier, 6);
  bool dormant = false;
  for (std::uint32_t page : used.pages()) {
    EXPECT_EQ(used.mesh.candidates().screen(page).travel, 990);
    dormant = dormant || used.mesh.candidates().screen(page).dormant != 0;
  }
  ASSERT_TRUE(dormant);
  const std::vector<std::uint32_t> before = used.pages();
  used.mesh.clear();
  used.mesh.removeRegion(region);
  used.square.region = used.mesh.addRegion({0, 0, kSide}, 3);
  used.fill();
  const std::vector<std::uint32_t> after = used.pages();
  ASSERT_GT(
      std::count_if(after.begin(), after.end(), [&](std::uint32_t page) { return std::count(before.begin(), before.end(), page) > 0; }), 3);
  clean.mesh.evaluateFresh(region, &view);
  used.mesh.evaluateFresh(used.square.region, &view);
  for (std::size_t n = 0; n < clean.pages().size(); ++n) {
    const std::uint32_t c = clean.pages()[n], u = used.pages()[n];
    const PageScreen &a = clean.mesh.candidates().screen(c), &b = used.mesh.candidates().screen(u);
    EXPECT_EQ(clean.mesh.candidates().nextCheck(c).travel, used.mesh.candidates().nextCheck(u).travel);
    EXPECT_EQ(clean.mesh.candidates().nextCheck(c).turn, used.mesh.candidates().nextCheck(u).turn);
    EXPECT_EQ(a.travel, b.travel);
    EXPECT_EQ(a.steepest, b.steepest);
    EXPECT_EQ(a.seen, b.seen);
    EXPECT_EQ(a.nearest, b.nearest);
    EXPECT_EQ(a.dormant, b.dormant);
  }
  EXPECT_EQ(clean.mesh.nextRegionCheck(region).travel, used.mesh.nextRegionCheck(used.square.region).travel);
}

// The hash is that of the triangles, whatever the pages held before: records that were moved beside new ones, into a page that had been
// another region's, once left the former sum there.
TEST(Screening, HashesWhatThereIsAfterAnyChange) {
  World world;
  AdaptiveMesh& mesh = world.mesh;
  const auto& t = mesh.triangulation();
  const RegionId region = world.square.region;
  std::mt19937 rng(11);
  TriangleId hint = t.anyTriangle();
  for (int round = 0; round < 60; ++round) {
    std::vector<triangulation::VertexId> vertices;
    t.vertexPages().forEach(region, [&](triangulation::VertexId v) { vertices.push_back(v); });
    std::shuffle(vertices.begin(), vertices.end(), rng);
    vertices.resize(std::min<std::size_t>(vertices.size(), 300 * (round % 2)));
    for (triangulation::VertexId v : vertices) mesh.drop(v);
    hint = t.anyTriangle();
    for (int n = 0; n < 150; ++n) {
      const lattice::Point at{static_cast<std::int32_t>(rng() % kSide), static_cast<std::int32_t>(rng() % kSide)};
      mesh.insertGrid(std::vector{GridPoint{at, world.terrain->heightStep(at)}}, hint);
    }
    mesh.compact(region);
    mesh.evaluateFresh(region, nullptr);
    ASSERT_EQ(mesh.hash(region), mesh::hashLeaf(mesh.extract(region, {5, 0, 0}))) << "round " << round;
  }
}

// The bounds skip no candidate that is wanted: all along a way the same ones are found as where nothing is remembered, whatever the
// threshold, and though what is put off leaves its page as it is.
class Screenings : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Pages, Screenings, testing::Bool());

TEST_P(Screenings, SkipNothingThatIsWanted) {
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
  std::size_t found = 0, late = 0, pagesSkipped = 0;
  for (int step = 0; step < 100; ++step) {
    const View view(camera, {0, 0}, travel, 0, false);
    if (step == 0)
      for (World* world : {&remembers, &forgets}) world->mesh.evaluateFresh(region, &view);
    for (std::uint32_t page : forgets.pages()) pagesSkipped += remembers.mesh.candidates().nextCheck(page).travel > travel;
    forgets.mesh.triangulation().trianglePages().forEach(region, [&](TriangleId t) {
      forgets.mesh.postpone({t, {}, 0}, region, view, true);
    });
    Work known, all;
    const double threshold = GetParam() ? 6 : 6 + step / 3 % 7;
    remembers.mesh.findWork({{{region, true, 0, &known}}}, view, threshold);
    forgets.mesh.findWork({{{region, true, 0, &all}}}, view, threshold);
    for (const Pending& p : known.pending) remembers.mesh.postpone(p, region, view, GetParam());
    auto next = known.pending.begin();
    for (const Pending& p : all.pending) {
      if (next != known.pending.end() && next->triangle == p.triangle) {
        EXPECT_EQ(next->priority, p.priority);
        ++next;
        continue;
      }
      // Those dormant, for being specks or off the picture, may wake up a little later.
      const auto& pages = remembers.mesh.triangulation().trianglePages();
      EXPECT_TRUE((remembers.mesh.candidates().screen(pages.pageOf(p.triangle)).dormant >> pages.indexOf(p.triangle)) & 1)
          << "step " << step;
      ++late;
    }
    EXPECT_EQ(next, known.pending.end()) << "step " << step;
    found += all.pending.size();
    camera.pose.x += 1200;
    camera.pose.z += 1200;
    travel += 1200 * 1.4143;
  }
  EXPECT_GT(found, 1000u);
  EXPECT_LT(late, found / 100);
  EXPECT_GT(pagesSkipped, 100u);
}

}  // namespace
}  // namespace ridgecast::refinement
