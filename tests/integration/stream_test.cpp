// Net, sessions and pipelines together with the client's connection and scene, in one process over loopback.

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/loopback.h"
#include "tests/support/flier.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;

camera::Camera cameraAt(double t) {
  camera::Camera c;
  c.pose.x = static_cast<lattice::Step>(2000 * 256 + t * 5000);
  c.pose.z = static_cast<lattice::Step>(1500 * 256 - t * 9000);
  c.pose.y = 1900;
  c.pose.yaw = t * 0.1;
  c.pose.pitch = -0.2;
  c.projection.width = 320;
  c.projection.height = 180;
  return c;
}

wire::Settings coarse() {
  wire::Settings s;
  s.threshold = 10;
  return s;
}

class StreamTest : public LoopbackTest {
 protected:
  void SetUp() override {
    open();
    listen();
  }
  std::string url(const std::string& session = "default") const {
    return "ws://127.0.0.1:" + std::to_string(server->port()) + "/v1/stream?session=" + session;
  }
};

TEST_F(StreamTest, AFlightEndsInAMeshThatIsSound) {
  Flier flier(url(), coarse());
  for (int k = 0; k < 30; ++k) flier.step(cameraAt(k * 0.2));
  flier.settle(cameraAt(6));
  const MeshReport report = flier.check();
  EXPECT_TRUE(report.clean()) << report.text();
  // The height of the mesh held is near the terrain's under the camera.
  const auto terrain = terrain::create("alpine", 1).value();
  const lattice::Point below{cameraAt(6).pose.x, cameraAt(6).pose.z};
  const auto height = flier.scene().height(below);
  ASSERT_TRUE(height);
  EXPECT_NEAR(*height, terrain->height(below), 20);
}

// Leaves beyond the lattice once came here, which clients must refuse.
TEST_F(StreamTest, FliesAtEveryEdgeAndCornerOfTheLattice) {
  const auto terrain = terrain::create("alpine", 1).value();
  constexpr lattice::Step kEdge = lattice::kMaxPosition;
  for (const lattice::Point place : {lattice::Point{kEdge, kEdge}, {-kEdge, -kEdge}, {kEdge, -kEdge}, {0, kEdge}, {-kEdge, 77}}) {
    SCOPED_TRACE(std::to_string(place.x) + ", " + std::to_string(place.z));
    Flier flier(url(), coarse());
    camera::Camera camera = cameraAt(0);
    for (int k = 0; k < 6; ++k) {  // inwards, 300 m an iteration
      camera.pose.x = place.x - (place.x > 0 ? 1 : -1) * k * 76'800;
      camera.pose.z = place.z - (place.z > 0 ? 1 : -1) * (5 - k) * 76'800;
      camera.pose.y = terrain->height({camera.pose.x, camera.pose.z}) + 200;
      flier.step(camera);
    }
    flier.settle(camera);
    EXPECT_TRUE(flier.check().clean()) << flier.check().text();
  }
}

TEST_F(StreamTest, SessionsAreWorldsOfTheirOwn) {
  ASSERT_TRUE(directory->add("other", terrain::create("alpine", 2).value()));
  Flier here(url(), coarse()), there(url("other"), coarse()), beside(url("other"), coarse());
  EXPECT_EQ(here.world().seed, 1u);
  EXPECT_EQ(there.world().seed, 2u);
  EXPECT_EQ(there.world().session, "other");
  EXPECT_NE(here.world().contentHash, there.world().contentHash);
  EXPECT_EQ(there.world().contentHash, beside.world().contentHash);
  for (int k = 0; k < 5; ++k)
    for (Flier* f : {&here, &there, &beside}) f->step(cameraAt(k));
  EXPECT_NE(here.scene().hash(), there.scene().hash());
  EXPECT_EQ(there.scene().hash(), beside.scene().hash());
}

TEST_F(StreamTest, SettingsChangeOnTheWayAndTheMeshStaysTheSameOnBothSides) {
  wire::Hello hello;
  hello.settings = coarse();
  auto connection = link::Connection::open(core::parseUrl(url()).value(), hello, {.reconnects = false, .timeout = kTimeout}).value();
  core::Scene held;
  const auto settle = [&] {
    for (int k = 0; k < 500; ++k) {
      const auto r = connection->receive(kTimeout);
      if (!r) throw std::runtime_error("no iteration");
      EXPECT_TRUE(held.apply(r->iteration));
      EXPECT_EQ(held.hash(), r->iteration.meshHash);
      connection->acknowledge({r->iteration.number, held.hash()});
      if (r->iteration.settled) return held.triangles();
    }
    throw std::runtime_error("it does not settle");
  };
  connection->send({1, cameraAt(0)});
  const std::uint64_t first = settle();
  wire::Settings other = coarse();
  other.threshold = connection->granted().threshold / 2;
  connection->change(other);
  EXPECT_GT(settle(), first);
  EXPECT_EQ(connection->granted().threshold, other.threshold);
  // Candidates come with iterations and are no part of the mesh; a client that wants none any more is sent none.
  other.candidates = 500;
  connection->change(other);
  const auto wanted = connection->receive(30s);
  ASSERT_TRUE(wanted && wanted->iteration.candidates);
  EXPECT_EQ(wanted->iteration.candidates->size(), 500u);
  EXPECT_EQ(connection->granted().candidates, 500u);
  ASSERT_TRUE(held.apply(wanted->iteration));
  EXPECT_EQ(held.hash(), wanted->iteration.meshHash);
  connection->acknowledge({wanted->iteration.number, held.hash()});
  other.candidates = 0;
  other.metric = wire::Metric::kArea;  // begins anew
  other.threshold = 0;
  connection->change(other);
  settle();
  EXPECT_EQ(connection->granted().metric, wire::Metric::kArea);
  EXPECT_GT(connection->granted().threshold, 0);
}

TEST_F(StreamTest, ManyComeFlyAndGoAtOnce) {
  std::vector<std::thread> pilots;
  std::atomic<int> failures = 0;
  std::vector<std::uint64_t> hashes(8);
  for (std::size_t p = 0; p < hashes.size(); ++p)
    pilots.emplace_back([&, p] {
      try {
        for (int round = 0; round < 3; ++round) {
          Flier flier(url(), coarse());
          for (int k = 0; k < 6; ++k) flier.step(cameraAt(k * 0.5));
          hashes[p] = flier.scene().hash();
        }
      } catch (const std::exception& e) {
        ADD_FAILURE() << e.what();
        ++failures;
      }
    });
  for (std::thread& p : pilots) p.join();
  EXPECT_EQ(failures, 0);
  for (const std::uint64_t hash : hashes) EXPECT_EQ(hash, hashes[0]);
  EXPECT_TRUE(await([&] { return directory->cameras() == 0; }));  // a moment after they have gone
}

}  // namespace
}  // namespace ridgecast
