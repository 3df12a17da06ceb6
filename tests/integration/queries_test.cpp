// Queries over loopback: local answers are the server's bit for bit, on a million places of every built-in terrain; meshes keep their
// bounds; and how fast both are. RIDGECAST_QUERY_PLACES makes it fewer.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <future>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "client/core/mesh/mesh_ground.h"
#include "client/link/connection.h"
#include "client/query/ground.h"
#include "common/wire/wire.h"
#include "server/http/queries.h"
#include "tests/integration/loopback.h"
#include "tests/support/sanitized.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using lattice::Step;
using link::Connection;
using query::Ground;
using Time = std::chrono::steady_clock;
using testing_support::kTimeout;

std::size_t places() {
  const char* given = std::getenv("RIDGECAST_QUERY_PLACES");
  return given ? std::strtoull(given, nullptr, 10) : testing_support::kSanitized ? 50'000 : 1'000'000;
}

// A built-in terrain that no client knows: its name is another.
class Renamed final : public terrain::Terrain {
 public:
  explicit Renamed(std::shared_ptr<const terrain::Terrain> t) : terrain_(std::move(t)) {}
  std::string_view name() const override { return "renamed"; }
  std::string_view source() const override { return terrain_->source(); }
  std::uint32_t seed() const override { return terrain_->seed(); }
  terrain::Relief relief() const override { return terrain_->relief(); }
  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override { terrain_->heights(x, z, out); }
  std::span<const std::string> ownMaterials() const override { return own_; }
  void materials(std::span<const Step> x, std::span<const Step> z, std::span<std::uint8_t> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = static_cast<std::uint8_t>((x[k] ^ z[k]) % 11 & 15);
  }

 private:
  const std::vector<std::string> own_{"forest", "mud"};
  std::shared_ptr<const terrain::Terrain> terrain_;
};

class QueriesTest : public LoopbackTest {
 protected:
  void SetUp() override {
    open();
    for (const auto& d : terrain::builtIn()) {
      const auto terrain = terrain::create(d.name, 11).value();
      directory->add(std::string(d.name), terrain).value();
      directory->add("renamed-" + std::string(d.name), std::make_shared<Renamed>(terrain)).value();
    }
    listen({http::queryRoute(directory)});
  }
  std::unique_ptr<Connection> join(const std::string& session, wire::Hello hello = {}) {
    hello.edits = true;
    auto opened =
        Connection::open({"127.0.0.1", std::to_string(server->port()), session}, hello, {.reconnects = false, .timeout = kTimeout});
    if (!opened) throw std::runtime_error(opened.error().message);
    return std::move(*opened);
  }
};

struct Places {
  std::vector<Step> x, z;
};
Places randomPlaces(std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Places p;
  for (std::size_t k = 0; k < count; ++k) {
    // Near, far and at the lattice's end.
    const int bits = std::array{12, 24, 34, 50}[k % 4];
    const auto one = [&] { return static_cast<Step>(random() >> (63 - bits)) - (Step{1} << bits); };
    p.x.push_back(one());
    p.z.push_back(one());
  }
  return p;
}

TEST_F(QueriesTest, LocalAnswersAreTheServersBitForBit) {
  const Places p = randomPlaces(places(), 5);
  for (const auto& d : terrain::builtIn()) {
    auto here = join(std::string(d.name)), there = join("renamed-" + std::string(d.name));
    Ground local(*here), remote(*there, 5 * kTimeout);
    ASSERT_EQ(local.source(), Ground::Source::kLocal);
    ASSERT_EQ(remote.source(), Ground::Source::kServer);
    std::vector<float> a(p.x.size()), b(p.x.size());
    auto begin = Time::now();
    // In batches of 1,000, as a simulation asks.
    for (std::size_t at = 0; at < a.size(); at += 1000) {
      const std::size_t n = std::min<std::size_t>(1000, a.size() - at);
      ASSERT_TRUE(local.heights(std::span(p.x).subspan(at, n), std::span(p.z).subspan(at, n), std::span(a).subspan(at, n)));
    }
    const double localSeconds = std::chrono::duration<double>(Time::now() - begin).count();
    begin = Time::now();
    const auto asked = remote.heights(p.x, p.z, b);
    ASSERT_TRUE(asked) << asked.error().message;
    const double remoteSeconds = std::chrono::duration<double>(Time::now() - begin).count();
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0) << d.name;
    std::printf("%s: %.1f million heights/s locally in batches of 1,000, %.2f million/s over the socket\n", std::string(d.name).c_str(),
                static_cast<double>(a.size()) / localSeconds / 1e6, static_cast<double>(a.size()) / remoteSeconds / 1e6);

    const std::size_t some = 5000;
    std::vector<float> na(3 * some), nb(3 * some);
    ASSERT_TRUE(local.normals(std::span(p.x).first(some), std::span(p.z).first(some), na));
    ASSERT_TRUE(remote.normals(std::span(p.x).first(some), std::span(p.z).first(some), nb));
    EXPECT_EQ(std::memcmp(na.data(), nb.data(), na.size() * sizeof(float)), 0) << d.name;
    std::vector<ground::Ray> rays;
    std::mt19937 random(8);
    const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
    for (int k = 0; k < 600; ++k)
      rays.push_back({static_cast<Step>(uniform(-1e7, 1e7)), static_cast<Step>(uniform(-1e7, 1e7)), uniform(0, 4000), uniform(-1, 1),
                      uniform(-1, 0.1), uniform(-1, 1), 3000});
    std::vector<double> ra(rays.size()), rb(rays.size());
    ASSERT_TRUE(local.cast(rays, ra));
    ASSERT_TRUE(remote.cast(rays, rb));
    EXPECT_EQ(std::memcmp(ra.data(), rb.data(), ra.size() * sizeof(double)), 0) << d.name;
    EXPECT_GT(std::count_if(ra.begin(), ra.end(), [](double t) { return t > 0; }), 100);
  }
}

TEST_F(QueriesTest, MaterialsAndTheirNamesComeFromTheServer) {
  const Places p = randomPlaces(10'000, 7);
  const Renamed terrain(terrain::create("alpine", 11).value());
  std::vector<std::uint8_t> expected(p.x.size()), got(p.x.size(), 99);
  terrain.materials(p.x, p.z, expected);
  auto there = join("renamed-alpine"), here = join("alpine");
  Ground remote(*there, kTimeout), local(*here);
  ASSERT_TRUE(remote.materials(p.x, p.z, got));
  EXPECT_EQ(got, expected);
  EXPECT_THAT(remote.ownMaterials(), testing::ElementsAre("forest", "mud"));
  ASSERT_TRUE(local.materials(p.x, p.z, got));
  terrain::create("alpine", 11).value()->materials(p.x, p.z, expected);
  EXPECT_EQ(got, expected);
  EXPECT_THAT(local.ownMaterials(), testing::ElementsAre("water", "wood"));
  EXPECT_EQ(remote.known(), terrain::Relief::Known::kMeasured);
  EXPECT_EQ(local.known(), terrain::Relief::Known::kMeasured);
}

TEST_F(QueriesTest, AMeshKeepsItsBoundOnADenseSample) {
  wire::Hello hello;
  hello.role = wire::Role::kSensor;
  hello.errors = true;
  hello.settings.threshold = 4;
  auto connection = join("alpine", hello);
  Ground truth(*connection);
  core::Scene scene;
  wire::PoseMessage pose;
  pose.sequence = 1;
  pose.camera.pose = {.x = 2000 * 256, .z = 1500 * 256, .remainderX = 0, .remainderZ = 0, .y = 1900, .yaw = 0.3, .pitch = -0.3};
  pose.camera.projection.width = 640;
  pose.camera.projection.height = 360;
  connection->send(pose);
  for (bool settled = false; !settled;) {
    auto received = connection->receive(kTimeout);
    ASSERT_TRUE(received) << (connection->error() ? connection->error()->message : "nothing came");
    ASSERT_TRUE(scene.apply(received->iteration));
    connection->acknowledge({received->iteration.number, scene.hash()});
    settled = received->iteration.settled;
  }
  std::mt19937_64 random(6);
  std::size_t asked = 0, beyond = 0;
  double worst = 0;
  for (int k = 0; k < 4000; ++k) {
    const double reach = k % 2 == 0 ? 300 * 256 : 8000 * 256;
    const auto one = [&] { return static_cast<Step>(std::uniform_real_distribution<double>(-reach, reach)(random)); };
    const lattice::Point at{pose.camera.pose.x + one(), pose.camera.pose.z + one()};
    const auto height = core::heightOf(scene, at);
    if (!height) continue;
    ASSERT_TRUE(std::isfinite(height->bound));
    EXPECT_GT(height->normalY, 0);
    float exact = 0;
    ASSERT_TRUE(truth.heights({&at.x, 1}, {&at.z, 1}, {&exact, 1}));
    ++asked;
    worst = std::max(worst, std::abs(exact - height->height) / height->bound);
    beyond += std::abs(exact - height->height) > height->bound;
  }
  EXPECT_GT(asked, 3000u);
  EXPECT_EQ(beyond, 0u) << "of " << asked;
  std::printf("%zu places of the streamed mesh: at most %.2f of the bound\n", asked, worst);
  // A ray straight down meets the mesh at its height.
  const lattice::Point below{pose.camera.pose.x, pose.camera.pose.z};
  const auto hit = core::cast(scene, {below.x, below.z, 3000, 0, -1, 0, 5000});
  ASSERT_TRUE(hit);
  EXPECT_NEAR(3000 - hit->distance, core::heightOf(scene, below)->height, 1e-6);
  EXPECT_FALSE(core::cast(scene, {below.x, below.z, 9000, 0, 1, 0, 5000}));
}

TEST_F(QueriesTest, PlacesOffTheLatticeAndSpansOfDifferentSizesAreErrors) {
  for (const char* name : {"alpine", "renamed-alpine"}) {
    const auto connection = join(name);
    Ground ground(*connection);
    for (const double far : {1e13, -1e13, 4.4e12, std::nan(""), std::numeric_limits<double>::infinity()}) {
      EXPECT_FALSE(ground.height(far, 0)) << far;
      EXPECT_FALSE(ground.height(0, far)) << far;
    }
    ASSERT_TRUE(ground.height(4.398e12, -4.398e12));
    const std::vector<Step> three(3), two(2);
    std::vector<float> heights(3), normals(9);
    EXPECT_TRUE(ground.heights(three, three, heights));
    EXPECT_FALSE(ground.heights(three, two, heights));
    EXPECT_FALSE(ground.heights(three, three, std::span(heights).first(2)));
    EXPECT_FALSE(ground.normals(three, three, heights));
    EXPECT_FALSE(ground.normals(two, three, normals));
    const std::vector<ground::Ray> rays(2, {.y = 1e5, .directionY = -1, .reach = 10});
    std::vector<double> distances(3);
    const auto cast = ground.cast(rays, distances);
    ASSERT_FALSE(cast);
    EXPECT_NE(cast.error().message.find("2 rays"), std::string::npos) << cast.error().message;
  }
}

TEST_F(QueriesTest, ABadRayIsRefusedAlikeHereAndThereForThatQuestionAlone) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  auto here = join("alpine"), there = join("renamed-alpine");
  Ground local(*here), remote(*there, kTimeout);
  const ground::Ray good{0, 0, 5000, 0, -1, 0, 5000};
  std::vector<ground::Ray> bad(9, good);
  bad[0].y = kNan;
  bad[1].directionY = 0;
  bad[2].directionX = kNan;
  bad[3].reach = -1;
  bad[4].reach = 2e5;
  bad[5].reach = kNan;
  bad[6].x = lattice::kMaxPosition + 1;
  bad[7].y = 2e6;
  bad[8].directionZ = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < bad.size(); ++k) {
    const std::array rays{good, bad[k], good};
    std::array<double, 3> out{};
    const auto refusedHere = local.cast(rays, out), refusedThere = remote.cast(rays, out);
    ASSERT_FALSE(refusedHere) << k;
    ASSERT_FALSE(refusedThere) << k;
    EXPECT_EQ(refusedHere.error().message, refusedThere.error().message) << k;
    EXPECT_NE(refusedHere.error().message.find("Ray."), std::string::npos) << refusedHere.error().message;
    ASSERT_FALSE(there->error()) << "the connection lives: " << there->error()->message;
    EXPECT_TRUE(remote.cast({&good, 1}, std::span(out).first(1)));
    EXPECT_GT(out[0], 0);
  }
}

TEST_F(QueriesTest, TooMuchIsRefusedAndTheEndIsTold) {
  auto connection = join("alpine");
  // More than the server lets wait at a time wait here.
  std::vector<std::future<Outcome<wire::Answer>>> asked;
  for (std::size_t k = 0; k < 200; ++k) {
    wire::Query q;
    q.x.assign(1000, 5);
    q.z.assign(1000, 7);
    asked.push_back(connection->ask(q));
  }
  for (auto& a : asked) {
    ASSERT_EQ(a.wait_for(kTimeout), std::future_status::ready);
    EXPECT_TRUE(a.get());
  }
  // What is out of range ends the connection with the server's sentence, and whoever waits is told.
  wire::Query wrong;
  wrong.x.assign(wire::kMaxPlaces + 1, 0);
  wrong.z = wrong.x;
  auto refused = connection->ask(wrong);
  ASSERT_EQ(refused.wait_for(kTimeout), std::future_status::ready);
  const auto answer = refused.get();
  ASSERT_FALSE(answer);
  EXPECT_NE(answer.error().message.find("Places.x"), std::string::npos) << answer.error().message;
  EXPECT_FALSE(connection->ask({}).get()) << "afterwards, too";

  auto leaves = join("alpine");
  auto open = leaves->askGround({0, {0, 0}, 100, 0.05});
  leaves.reset();
  ASSERT_EQ(open.wait_for(kTimeout), std::future_status::ready);
  EXPECT_FALSE(open.get());
}

}  // namespace
}  // namespace ridgecast
