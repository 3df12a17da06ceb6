// The paths that come with the project are what their names promise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include "client/render/context.h"
#include "client/render/renderer.h"
#include "common/camera/path.h"
#include "common/terrain/terrain.h"

namespace ridgecast {
namespace {

struct Flight {
  camera::Path path;
  std::shared_ptr<const terrain::Terrain> terrain;
  camera::Pose at(double t) const {
    return camera::poseAt(path, t, [this](lattice::Point p) { return terrain->height(p); });
  }
};

Flight load(const std::string& name) {
  auto path = camera::readPath(std::filesystem::path(RIDGECAST_PATHS) / (name + ".json"));
  EXPECT_TRUE(path) << path.error().message;
  auto terrain = terrain::create(path->terrain, path->seed);
  EXPECT_TRUE(terrain) << terrain.error().message;
  return {*path, *terrain};
}

double metresBetween(const camera::Pose& a, const camera::Pose& b) {
  return std::hypot(static_cast<double>(a.x - b.x), static_cast<double>(a.z - b.z)) / 256;
}

TEST(Paths, EveryFileFliesAboveTheGround) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(RIDGECAST_PATHS)) {
    if (entry.path().extension() != ".json") continue;
    ++files;
    const Flight flight = load(entry.path().stem());
    EXPECT_GE(flight.path.duration(), 20);
    EXPECT_LE(flight.path.duration(), 60);
    for (double t = 0; t <= flight.path.duration(); t += 0.1) {
      const camera::Pose pose = flight.at(t);
      ASSERT_GE(pose.y, flight.terrain->height({pose.x, pose.z}) + 30) << entry.path() << " at " << t << " s";
    }
  }
  EXPECT_GE(files, 4);
}

TEST(Paths, AlpineIsALowFlightAtAboutFiftyMetresASecond) {
  for (const std::string name : {"alpine", "alpine-1e8", "alpine-1e12"}) {
    const Flight flight = load(name);
    double length = 0;
    for (double t = 0; t < flight.path.duration(); t += 0.5) length += metresBetween(flight.at(t), flight.at(t + 0.5));
    EXPECT_NEAR(length / flight.path.duration(), 55, 10) << name;
    const double expected = name == "alpine" ? 0 : name == "alpine-1e8" ? 1e8 : 1e12;
    EXPECT_NEAR(static_cast<double>(flight.at(0).x) / 256, expected, 10000);
    EXPECT_NEAR(static_cast<double>(flight.at(0).z) / 256, expected, 10000);
  }
}

TEST(Paths, TheReturnGoesFarAndComesBack) {
  const Flight flight = load("alpine-return");
  double farthest = 0;
  for (double t = 0; t <= flight.path.duration(); t += 0.5) farthest = std::max(farthest, metresBetween(flight.at(0), flight.at(t)));
  EXPECT_GT(farthest, 4000);
  EXPECT_LT(metresBetween(flight.at(0), flight.at(flight.path.duration())), 0.01);
}

TEST(Paths, TheEndShowsMostlyTerrain) {
  auto context = render::HeadlessContext::create();
  if (!context) GTEST_SKIP() << "no OpenGL here: " << context.error().message;
  // The demo flies the first 20 s, the evaluation the whole path; both end with the picture that is measured.
  for (const std::string name : {"alpine", "alpine-1e8", "alpine-1e12", "canyon", "archipelago"}) {
    const Flight flight = load(name);
    auto renderer = render::Renderer::create({std::string(flight.terrain->source()), flight.path.seed});
    ASSERT_TRUE(renderer) << renderer.error().message;
    for (const double t : {20.0, flight.path.duration()}) {
      render::View view;
      view.camera.pose = flight.at(t);
      view.camera.projection = {flight.path.verticalFov, 160, 90};
      view.horizon = 32768;
      const auto drawn = renderer->drawMarch(view);
      ASSERT_TRUE(drawn);
      const auto terrain = std::ranges::count(drawn->picture.terrain, 255);
      EXPECT_GE(static_cast<double>(terrain) / (160 * 90), 0.6) << name << " at " << t << " s";
    }
  }
}

}  // namespace
}  // namespace ridgecast
