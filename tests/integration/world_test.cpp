// The C interface, and with it the C++ library behind it, over a real server: members of one session, their clock,
// the ground, the mesh, and a server that is killed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "client/c/ridgecast.h"
#include "common/terrain/terrain.h"
#include "tests/integration/c_handles.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using testing_support::ServerProcess;

rc_world_info infoOf(const World& world) {
  rc_world_info out{};
  out.size = sizeof out;
  EXPECT_EQ(rc_world_get_info(world.get(), &out), RC_OK) << rc_message();
  return out;
}

rc_clock clockOf(const World& world) {
  rc_clock out{};
  out.size = sizeof out;
  EXPECT_EQ(rc_world_clock(world.get(), &out), RC_OK) << rc_message();
  return out;
}

double metresOf(std::int32_t steps) { return steps / 256.0; }

// Whether every place on a grid over the circle lies in a triangle that is at most `error` off.
void expectWithin(const rc_mesh& mesh, rc_terrain* terrain, double x, double z, double radius, double error) {
  std::size_t inside = 0, wanted = 0;
  for (double atX = -radius; atX <= radius; atX += radius / 20)
    for (double atZ = -radius; atZ <= radius; atZ += radius / 20) {
      if (std::hypot(atX, atZ) >= radius) continue;
      ++wanted;
      const double place[2] = {x + atX, z + atZ};
      const double px = place[0] - mesh.origin[0], pz = place[1] - mesh.origin[1];
      float height = 0;
      ASSERT_EQ(rc_terrain_heights(terrain, place, 1, &height), RC_OK) << rc_message();
      for (std::size_t t = 0; t < mesh.triangle_count; ++t) {
        std::array<const float*, 3> v{};
        for (std::size_t k = 0; k < 3; ++k) v[k] = mesh.positions + 3 * mesh.triangles[3 * t + k];
        const auto area = [&](const float* a, const float* b) { return (b[2] - pz) * (a[0] - px) - (b[0] - px) * (a[2] - pz); };
        const double u = area(v[1], v[2]), w = area(v[2], v[0]), s = area(v[0], v[1]), all = u + w + s;
        if (!(all < 0 ? u <= 0 && w <= 0 && s <= 0 : u >= 0 && w >= 0 && s >= 0)) continue;
        ++inside;
        EXPECT_LE(std::abs((u * v[0][1] + w * v[1][1] + s * v[2][1]) / all - height), error + metresOf(2)) << place[0] << " " << place[1];
        break;
      }
    }
  EXPECT_EQ(inside, wanted);
}

TEST(CWorld, ChangesTheGroundForEverybody) {
  ServerProcess server(RIDGECAST_SERVER);
  const World a = join(server.url()), b = join(server.url());
  const double place[2] = {10, -20};
  const auto height = [&](const World& world) {
    float out = 0;
    EXPECT_EQ(rc_terrain_heights(rc_world_terrain(world.get()), place, 1, &out), RC_OK) << rc_message();
    return out;
  };
  const float before = height(b);
  std::uint64_t number = 0;
  const char* const crater = R"({"op": "crater", "x": 10, "z": -20, "radius": 6, "depth": 2})";
  ASSERT_EQ(rc_world_edit(a.get(), crater, "once", kWait, &number), RC_OK) << rc_message();
  EXPECT_EQ(number, 1u);
  ASSERT_EQ(rc_world_edit(a.get(), crater, "once", kWait, &number), RC_OK) << rc_message();
  EXPECT_EQ(number, 1u);
  EXPECT_NEAR(height(a), before - 2, 0.01);
  for (int k = 0; k < 3000 && height(b) == before; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(height(b), height(a));
  EXPECT_EQ(rc_world_edit(a.get(), R"({"op": "dig"})", nullptr, kWait, &number), RC_REFUSED);
  EXPECT_NE(std::string(rc_message()).find("\"dig\""), std::string::npos);
  EXPECT_EQ(rc_world_edit(a.get(), nullptr, nullptr, kWait, &number), RC_INVALID);
}

// Each slice goes on waiting for the edit, however dear it is.
TEST(CWorld, AnEditThatIsWaitedForInSlicesIsMadeOnce) {
  ServerProcess server(RIDGECAST_SERVER);
  const World world = join(server.url());
  const char* const wide = R"({"op": "level", "polygon": [[-325, -325], [325, -325], [325, 325], [-325, 325]], "height": 300})";
  std::uint64_t number = 0;
  for (int round = 0; round < 2; ++round) {
    rc_status status = RC_TIMEOUT;
    for (int k = 0; k < 100'000 && status == RC_TIMEOUT; ++k) status = rc_world_edit(world.get(), wide, "once", 0.001, &number);
    ASSERT_EQ(status, RC_OK) << rc_message();
    EXPECT_EQ(number, 1u);
  }
}

class WorldTest : public testing::Test {
 protected:
  ServerProcess server{RIDGECAST_SERVER};
  World enter(const std::string& query, rc_join_options options = {}) { return join(server.url() + query, options); }
};

TEST_F(WorldTest, ComputesParametersOfABuiltInTerrainHere) {
  const World world = enter("?session=flat&terrain=archipelago&seed=3&param=heathLine=640");
  if (!world) return;
  const rc_world_info info = infoOf(world);
  EXPECT_TRUE(info.is_local);
  EXPECT_STREQ(info.session, "flat");
  rc_terrain_options options{};
  const rc_parameter parameter{"heathLine", 640};
  options.size = sizeof options;
  options.seed = 3;
  options.parameters = &parameter;
  options.parameter_count = 1;
  const Terrain here = open("archipelago", &options);
  EXPECT_EQ(info.hash, rc_terrain_hash(here.get()));
  const auto places = randomPlaces(5000);
  EXPECT_EQ(heightsOf(rc_world_terrain(world.get()), places), heightsOf(here.get(), places));
}

TEST_F(WorldTest, AsksTheServerForAHeightMap) {
  const testing_support::ScratchFolder folder;
  const std::string file = (folder / "hill.asc").string();
  std::ofstream out(file);
  out << "ncols 40\nnrows 40\nxllcorner 0\nyllcorner 0\ncellsize 10\n";
  for (int k = 0; k < 1600; ++k) out << (k * 7919) % 97 << (k % 40 == 39 ? '\n' : ' ');
  out.close();
  const Terrain here = open(file);
  ServerProcess mapped(RIDGECAST_SERVER, {"--terrain", file});
  const World world = join(mapped.url());
  EXPECT_FALSE(infoOf(world).is_local);
  std::vector<double> places = randomPlaces(20'000);
  for (double& at : places) at = std::fmod(at, 500);
  rc_terrain* there = rc_world_terrain(world.get());
  EXPECT_EQ(heightsOf(there, places), heightsOf(here.get(), places));
  std::vector<float> normals(6), same(6);
  ASSERT_EQ(rc_terrain_normals(there, places.data(), 2, 0.5, normals.data()), RC_OK) << rc_message();
  ASSERT_EQ(rc_terrain_normals(here.get(), places.data(), 2, 0.5, same.data()), RC_OK) << rc_message();
  EXPECT_EQ(normals, same);
  const rc_ray ray{{100, 500, 100}, {0.2, -1, 0}, 1e4};
  rc_hit hit{}, sameHit{};
  ASSERT_EQ(rc_terrain_rays(there, &ray, 1, &hit), RC_OK) << rc_message();
  ASSERT_EQ(rc_terrain_rays(here.get(), &ray, 1, &sameHit), RC_OK) << rc_message();
  EXPECT_EQ(hit.distance, sameHit.distance);
  rc_ray bad = ray;
  bad.reach = -1;
  EXPECT_EQ(rc_terrain_rays(there, &bad, 1, &hit), RC_INVALID);

  // Unless it is here, too.
  rc_join_options with{};
  with.terrain = here.get();
  const World same_world = join(mapped.url(), with);
  EXPECT_TRUE(infoOf(same_world).is_local);
  rc_terrain* local = rc_world_terrain(same_world.get());
  EXPECT_EQ(heightsOf(local, places), heightsOf(here.get(), places));
  const std::string crater = R"({"op": "crater", "x": 100, "z": 100, "radius": 20, "depth": 5})";
  std::uint64_t number = 0;
  ASSERT_EQ(rc_world_edit(world.get(), crater.c_str(), "", kWait, &number), RC_OK) << rc_message();
  places = {100, 100, 101, 100};
  const std::vector<float> edited = heightsOf(there, places);
  EXPECT_LT(edited[0], heightsOf(here.get(), places)[0] - 4);
  for (double waited = 0; waited < kWait && heightsOf(local, places) != edited; waited += 0.01)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_EQ(heightsOf(local, places), edited) << "with the session's edits";
  const Terrain other = open("alpine");
  with.size = sizeof with;
  with.terrain = other.get();
  rc_world* none = nullptr;
  EXPECT_EQ(rc_join(mapped.url().c_str(), &with, &none), RC_REFUSED);
  EXPECT_THAT(rc_message(), testing::HasSubstr("open the same file"));
  with.terrain = there;
  EXPECT_EQ(rc_join(mapped.url().c_str(), &with, &none), RC_INVALID);
}

TEST(CTerrain, PatchesAreTheHeightsAroundBodies) {
  const Terrain alpine = open("alpine");
  constexpr std::size_t kBodies = 300, kOffsets = 187;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> near(-9, 9), far(-1e6, 1e6);
  std::vector<double> bodies, offsets, places;
  for (std::size_t m = 0; m < kOffsets; ++m) offsets.insert(offsets.end(), {near(random), near(random)});
  for (std::size_t k = 0; k < kBodies; ++k) {
    const double x = far(random), z = far(random), yaw = near(random);
    bodies.insert(bodies.end(), {x, z, yaw});
    for (std::size_t m = 0; m < kOffsets; ++m) {
      const double right = offsets[2 * m], ahead = -offsets[2 * m + 1];
      places.push_back(x + right * std::cos(yaw) - ahead * std::sin(yaw));
      places.push_back(z - right * std::sin(yaw) - ahead * std::cos(yaw));
    }
  }
  std::vector<float> patches(kBodies * kOffsets);
  ASSERT_EQ(rc_terrain_patches(alpine.get(), bodies.data(), kBodies, offsets.data(), kOffsets, patches.data()), RC_OK) << rc_message();
  const std::vector<float> heights = heightsOf(alpine.get(), places);
  for (std::size_t k = 0; k < patches.size(); ++k) ASSERT_NEAR(patches[k], heights[k], 0.05) << k;  // a step aside at most
  EXPECT_EQ(rc_terrain_patches(alpine.get(), bodies.data(), 0, offsets.data(), kOffsets, patches.data()), RC_OK);
  EXPECT_EQ(rc_terrain_patches(alpine.get(), bodies.data(), kBodies, nullptr, kOffsets, patches.data()), RC_INVALID);
  EXPECT_EQ(rc_terrain_patches(alpine.get(), bodies.data(), SIZE_MAX / 8, offsets.data(), kOffsets, patches.data()), RC_INVALID);
  bodies[5] = std::nan("");
  EXPECT_EQ(rc_terrain_patches(alpine.get(), bodies.data(), kBodies, offsets.data(), kOffsets, patches.data()), RC_INVALID);
  EXPECT_THAT(rc_message(), testing::HasSubstr("place 187"));
}

TEST_F(WorldTest, GroundKeepsItsError) {
  const World world = enter("");
  for (const double x : {250.0, 1e9}) {
    const rc_mesh* made = nullptr;
    ASSERT_EQ(rc_world_ground(world.get(), x, -400, 64, 0.25, kWait, &made), RC_OK) << rc_message();
    const Mesh mesh(made);
    EXPECT_LE(mesh->error, 0.25);
    EXPECT_EQ(mesh->origin[0], x);
    expectWithin(*mesh, rc_world_terrain(world.get()), x, -400, 64, mesh->error);
  }
  const rc_mesh* made = nullptr;
  EXPECT_EQ(rc_world_ground(world.get(), 0, 0, 4000, 0.005, kWait, &made), RC_INVALID);
  EXPECT_EQ(rc_world_ground(world.get(), 0, 0, 4000, 0.02, kWait, &made), RC_REFUSED) << "too many triangles";
  EXPECT_EQ(rc_world_ground(world.get(), std::nan(""), 0, 64, 1, kWait, &made), RC_INVALID);
  EXPECT_EQ(rc_world_ground(world.get(), 0, 0, 64, 1, -1, &made), RC_INVALID);
  EXPECT_EQ(made, nullptr);
}

TEST_F(WorldTest, TheWholeMeshIsItsLeaves) {
  rc_join_options options{};
  options.errors = 1;
  const World world = enter("", options);
  rc_camera camera{};
  camera.size = sizeof camera;
  camera.y = 1500;
  rc_iteration iteration{};
  iteration.size = sizeof iteration;
  ASSERT_EQ(rc_world_fly(world.get(), &camera, kWait, &iteration), RC_OK) << rc_message();
  while (!iteration.settled) ASSERT_EQ(rc_world_receive(world.get(), kWait, &iteration), RC_OK) << rc_message();
  std::size_t count = 0;
  ASSERT_EQ(rc_world_leaves(world.get(), nullptr, 0, &count), RC_OK);
  std::vector<rc_leaf> leaves(count);
  leaves[0].size = sizeof leaves[0];
  ASSERT_EQ(rc_world_leaves(world.get(), leaves.data(), count, &count), RC_OK);
  std::size_t triangles = 0;
  for (const rc_leaf& leaf : leaves) {
    const rc_mesh* part = nullptr;
    ASSERT_EQ(rc_world_leaf(world.get(), leaf.level, leaf.i, leaf.j, &part), RC_OK) << rc_message();
    const Mesh mesh(part);
    EXPECT_EQ(mesh->triangle_count, leaf.triangles);
    EXPECT_EQ(mesh->origin[0], static_cast<double>(leaf.i) * leaf.side);
    triangles += mesh->triangle_count;
  }
  const rc_mesh* whole = nullptr;
  ASSERT_EQ(rc_world_mesh(world.get(), 0, 0, &whole), RC_OK);
  const Mesh mesh(whole);
  EXPECT_EQ(mesh->triangle_count, triangles);
  EXPECT_EQ(triangles, iteration.triangles);
  EXPECT_LT(mesh->vertex_count, triangles * 3 / 5 + 100) << "vertices of neighbouring leaves stand once";
  EXPECT_TRUE(std::isfinite(mesh->error));
  camera.pitch = 7;
  EXPECT_EQ(rc_world_fly(world.get(), &camera, kWait, &iteration), RC_INVALID);
  const rc_mesh* none = nullptr;
  EXPECT_EQ(rc_world_leaf(world.get(), -1, 0, 0, &none), RC_INVALID);
}

TEST_F(WorldTest, AThousandStepsAreDoneByAllBeforeTheNext) {
  rc_join_options sensor{};
  sensor.sensor = 1;
  sensor.name = "owner";
  const World owner = enter("", sensor), bystander = enter("");  // whom no step waits for
  sensor.follows = 1;
  constexpr int kSteps = 1000, kFollowers = 3;
  std::array<std::atomic<std::int64_t>, kFollowers> done{};
  std::vector<World> worlds;
  for (int k = 0; k < kFollowers; ++k) worlds.push_back(enter("", sensor));
  ASSERT_EQ(rc_world_set_clock(owner.get(), RC_STEPPED, 0, kWait), RC_OK) << rc_message();
  const std::int64_t begin = clockOf(owner).time;
  std::vector<std::thread> followers;
  for (int k = 0; k < kFollowers; ++k)
    followers.emplace_back([&, k] {
      rc_world* world = worlds[static_cast<std::size_t>(k)].get();
      for (int step = 0; step < kSteps; ++step) {
        std::int64_t time = 0;
        ASSERT_EQ(rc_world_next_step(world, kWait, &time), RC_OK) << rc_message();
        ASSERT_EQ(time, begin + 20'000 * (step + 1));
        done[static_cast<std::size_t>(k)] = time;
      }
      EXPECT_EQ(rc_world_next_step(world, 0.2, nullptr), RC_TIMEOUT);  // says that the last one is done
    });
  for (int step = 0; step < kSteps; ++step) {
    ASSERT_EQ(rc_world_step(owner.get(), 20'000, kWait), RC_OK) << rc_message();
    for (const auto& time : done) ASSERT_EQ(time, begin + 20'000 * (step + 1)) << "a follower was not waited for";
  }
  for (std::thread& thread : followers) thread.join();
  EXPECT_EQ(rc_world_set_clock(worlds[0].get(), RC_REAL_TIME, 1, kWait), RC_REFUSED);
  EXPECT_NE(std::string(rc_message()).find("member "), std::string::npos) << rc_message();
}

TEST_F(WorldTest, TheClockJumpsAheadAndGoesOnAsItDid) {
  const World owner = enter(""), other = enter("");
  ASSERT_EQ(rc_world_jump(owner.get(), 3'600'000'000, kWait), RC_OK) << rc_message();
  EXPECT_GE(clockOf(owner).time, 3'600'000'000);
  EXPECT_EQ(clockOf(owner).mode, RC_REAL_TIME);
  EXPECT_EQ(clockOf(owner).end, 0);
  ASSERT_EQ(rc_world_set_clock(owner.get(), RC_STEPPED, 0, kWait), RC_OK) << rc_message();
  ASSERT_EQ(rc_world_jump(owner.get(), 7'000'000'000, kWait), RC_OK) << rc_message();
  EXPECT_EQ(clockOf(owner).time, 7'000'000'000);
  EXPECT_EQ(clockOf(owner).mode, RC_STEPPED);
  EXPECT_EQ(rc_world_jump(owner.get(), 5, kWait), RC_REFUSED) << "back";
  EXPECT_NE(std::string(rc_message()).find("recordings"), std::string::npos) << rc_message();
  EXPECT_EQ(rc_world_jump(owner.get(), std::int64_t{1} << 53, kWait), RC_REFUSED);
  EXPECT_NE(std::string(rc_message()).find("an hour"), std::string::npos) << rc_message();
  EXPECT_EQ(rc_world_jump(owner.get(), (std::int64_t{1} << 53) + 1, kWait), RC_INVALID);
  EXPECT_EQ(rc_world_jump(owner.get(), -1, kWait), RC_INVALID);
  ASSERT_TRUE(testing_support::await([&] { return clockOf(other).time == 7'000'000'000; })) << "it hears of it";
  EXPECT_EQ(rc_world_jump(other.get(), 8'000'000'000, kWait), RC_REFUSED);
  EXPECT_NE(std::string(rc_message()).find("owns the clock"), std::string::npos) << rc_message();
}

TEST_F(WorldTest, AStepThatIsNotDoneSaysByWhom) {
  const World owner = enter("");
  EXPECT_EQ(rc_world_next_step(owner.get(), 0.1, nullptr), RC_INVALID) << "it does not follow";
  rc_join_options options{};
  options.name = "sleeper";
  options.follows = 1;
  const World sleeper = enter("", options);
  ASSERT_EQ(rc_world_set_clock(owner.get(), RC_STEPPED, 0, kWait), RC_OK) << rc_message();
  std::size_t others = 0;
  while (others == 0) ASSERT_EQ(rc_world_members(owner.get(), nullptr, 0, &others), RC_OK);
  EXPECT_EQ(rc_world_step(owner.get(), 1000, 0.2), RC_TIMEOUT);
  EXPECT_NE(std::string(rc_message()).find("(sleeper)"), std::string::npos) << rc_message();
  EXPECT_EQ(rc_world_step(owner.get(), 0, 0.1), RC_TIMEOUT) << "still";
  EXPECT_EQ(rc_world_jump(owner.get(), clockOf(owner).time + 1'000'000, kWait), RC_REFUSED);
  EXPECT_NE(std::string(rc_message()).find("under way"), std::string::npos) << rc_message();
  ASSERT_EQ(rc_world_next_step(sleeper.get(), kWait, nullptr), RC_OK) << rc_message();
  rc_world_next_step(sleeper.get(), 0.05, nullptr);
  EXPECT_EQ(rc_world_step(owner.get(), 0, kWait), RC_OK) << rc_message();
  EXPECT_EQ(rc_world_step(owner.get(), -5, kWait), RC_INVALID);
}

// What a slow server has not yet heard is no step that is done.
TEST_F(WorldTest, AStepIsNotDoneBeforeTheServerHasHeardOfIt) {
  const World owner = enter("");
  for (int k = 0; k < 2; ++k) {  // first without, then with the clock in hand
    const std::int64_t before = clockOf(owner).time;
    server.process().signal(SIGSTOP);
    const std::string stat = "/proc/" + std::to_string(server.process().id()) + "/stat";
    for (std::string pid, name, state; state != "T";) std::ifstream(stat) >> pid >> name >> state;
    EXPECT_EQ(rc_world_step(owner.get(), 1'000'000, 0.1), RC_TIMEOUT);
    EXPECT_EQ(rc_world_step(owner.get(), 0, 0.1), RC_TIMEOUT) << "still";
    server.process().signal(SIGCONT);
    ASSERT_EQ(rc_world_step(owner.get(), 0, kWait), RC_OK) << rc_message();
    if (k > 0) {
      EXPECT_EQ(clockOf(owner).time, before + 1'000'000);
    }
    EXPECT_EQ(clockOf(owner).step, static_cast<std::uint64_t>(k + 1));
  }
}

TEST_F(WorldTest, SeesTheOthers) {
  rc_join_options options{};
  options.name = "rover";
  const World rover = enter("", options), other = enter("");
  rc_camera camera{};
  camera.size = sizeof camera;
  camera.x = 4e9, camera.y = 3000, camera.z = -12.5, camera.yaw = 1;
  const std::uint8_t state[] = {1, 0, 255};
  camera.state = state;
  camera.state_size = sizeof state;
  ASSERT_EQ(rc_world_fly(rover.get(), &camera, kWait, nullptr), RC_OK) << rc_message();
  rc_member seen{};
  seen.size = sizeof seen;
  std::size_t count = 0;
  while (!seen.has_pose) ASSERT_EQ(rc_world_members(other.get(), &seen, 1, &count), RC_OK) << rc_message();
  EXPECT_EQ(count, 1u);
  std::uint64_t others = 0;
  ASSERT_EQ(rc_world_crowd(other.get(), nullptr, 0, &count, &others), RC_OK) << rc_message();
  EXPECT_EQ(count, 0u) << "everybody is named";
  EXPECT_EQ(others, 1u);
  EXPECT_STREQ(seen.name, "rover");
  EXPECT_EQ(seen.member, infoOf(rover).member);
  EXPECT_EQ(seen.x, 4e9);
  EXPECT_EQ(seen.z, -12.5);
  EXPECT_EQ(std::vector<std::uint8_t>(seen.state, seen.state + seen.state_size), std::vector<std::uint8_t>(state, state + 3));
  camera.state_size = 257;
  EXPECT_EQ(rc_world_fly(rover.get(), &camera, kWait, nullptr), RC_INVALID);
  rc_terrain_close(rc_world_terrain(rover.get()));  // is the world's: nothing
  EXPECT_NE(rc_terrain_hash(rc_world_terrain(rover.get())), 0u);
}

TEST(KilledServer, ACallSaysSoOrWaitsForItsReturn) {
  const std::uint16_t port = testing_support::freePort();
  auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{}, port);
  const World world = join(server->url());
  rc_camera camera{};
  camera.size = sizeof camera;
  camera.y = 1500;
  ASSERT_EQ(rc_world_fly(world.get(), &camera, kWait, nullptr), RC_OK) << rc_message();
  server->process().signal(SIGKILL);
  server.reset();
  rc_status status = RC_OK;
  while (status == RC_OK) status = rc_world_fly(world.get(), &camera, 0.3, nullptr);  // until the loss is noticed
  EXPECT_EQ(status, RC_LOST) << rc_message();
  const rc_mesh* mesh = nullptr;
  EXPECT_EQ(rc_world_ground(world.get(), 0, 0, 50, 1, 0.2, &mesh), RC_LOST) << rc_message();
  EXPECT_EQ(rc_world_step(world.get(), 1000, 0.2), RC_LOST) << rc_message();
  // The line is dialled again and again, as long as the call waits.
  std::thread asks([&] { EXPECT_EQ(rc_world_ground(world.get(), 0, 0, 50, 1, kWait, &mesh), RC_OK) << rc_message(); });
  std::this_thread::sleep_for(std::chrono::seconds(3));
  server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{}, port);
  asks.join();
  rc_mesh_close(mesh);
  EXPECT_EQ(rc_world_fly(world.get(), &camera, kWait, nullptr), RC_OK) << rc_message();
  EXPECT_EQ(rc_world_step(world.get(), 1000, kWait), RC_OK) << rc_message();
  EXPECT_EQ(infoOf(world).reconnections, 1u);
}

// A server of one's own keeps no clock. Nobody goes on as if nothing had happened.
TEST(KilledServer, ACallSaysOnceThatTheClockHasBegunAnew) {
  const std::uint16_t port = testing_support::freePort();
  auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{}, port);
  rc_join_options options{};
  options.size = sizeof options;
  options.follows = 1;
  const World owner = join(server->url()), follower = join(server->url(), options);
  const auto step = [&](int steps) {
    std::thread other([&] {
      for (int k = 0; k < steps; ++k) EXPECT_EQ(rc_world_next_step(follower.get(), kWait, nullptr), RC_OK) << rc_message();
      EXPECT_EQ(rc_world_next_step(follower.get(), 0.2, nullptr), RC_TIMEOUT) << "which says that the last one is done";
    });
    for (int k = 0; k < steps; ++k) EXPECT_EQ(rc_world_step(owner.get(), 20'000, kWait), RC_OK) << rc_message();
    other.join();
  };
  ASSERT_EQ(rc_world_set_clock(owner.get(), RC_STEPPED, 0, kWait), RC_OK) << rc_message();
  step(5);
  server->process().signal(SIGKILL);
  server.reset();
  server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{}, port);

  const std::string why = "begun anew: it was at step 5, 0.";
  EXPECT_EQ(rc_world_next_step(follower.get(), kWait, nullptr), RC_LOST);
  EXPECT_NE(std::string(rc_message()).find(why), std::string::npos) << rc_message();
  clockOf(owner);  // who reads it is told all the same
  EXPECT_EQ(rc_world_step(owner.get(), 20'000, kWait), RC_LOST);
  EXPECT_NE(std::string(rc_message()).find(why), std::string::npos) << rc_message();
  EXPECT_EQ(rc_world_step(owner.get(), 0, kWait), RC_LOST) << "there is none to wait for";
  EXPECT_EQ(clockOf(owner).step, 0u);
  ASSERT_EQ(rc_world_set_clock(owner.get(), RC_STEPPED, 0, kWait), RC_OK) << rc_message();
  step(3);
  EXPECT_EQ(clockOf(owner).step, 3u);
}

TEST(KilledServer, WhoIsNotToComeBackIsToldAtOnce) {
  auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER);
  rc_join_options options{};
  options.stays_lost = 1;
  const World world = join(server->url(), options);
  server.reset();
  rc_camera camera{};
  camera.size = sizeof camera;
  EXPECT_EQ(rc_world_fly(world.get(), &camera, kWait, nullptr), RC_LOST) << rc_message();
  rc_world* none = nullptr;
  EXPECT_EQ(rc_join("ws://127.0.0.1:1", nullptr, &none), RC_REFUSED);
  EXPECT_EQ(rc_join("ftp://x", nullptr, &none), RC_INVALID);
}

}  // namespace
}  // namespace ridgecast
