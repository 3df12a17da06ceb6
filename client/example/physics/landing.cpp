// Flies over a height map at 50 m/s with collision on, lands, and measures what the ground costs:
//   landing [KILOMETRES [TIMES REAL TIME]]     default: 5, as fast as it goes
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>

#include "bullet_ground.h"

namespace {

constexpr double kPitch = 30, kSpeed = 50;  // metres between the map's samples, m/s
constexpr int kRate = 60;
constexpr float kRadius = 1;
constexpr double kBelow = 0.05;  // metres that Bullet lets a body into its ground, beyond the tile's error

void check(rc_status status) {
  if (status != RC_OK) throw std::runtime_error(rc_message());
}

// Alpine's heights as a map of 30 m, 6 km wide, whose middle is the origin.
void writeMap(const std::filesystem::path& file, double length) {
  rc_terrain* alpine;
  check(rc_terrain_open("alpine", nullptr, &alpine));
  const int columns = static_cast<int>((length + 2000) / kPitch), rows = 200;
  std::ofstream out(file);
  out << "ncols " << columns << "\nnrows " << rows << "\nxllcorner 0\nyllcorner 0\ncellsize " << kPitch << '\n';
  std::vector<double> places(2 * columns);
  std::vector<float> heights(columns);
  for (int row = 0; row < rows; ++row) {
    for (int k = 0; k < columns; ++k) {
      places[2 * k] = kPitch * k;
      places[2 * k + 1] = kPitch * row;
    }
    check(rc_terrain_heights(alpine, places.data(), columns, heights.data()));
    for (float height : heights) out << height << ' ';
    out << '\n';
  }
  rc_terrain_close(alpine);
}

double residentMegabytes() {
  long pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return resident * 4096 / 1e6;
}

struct Times {
  std::vector<double> all;
  void print(const char* name) {
    std::ranges::sort(all);
    std::printf("%s: %.3f ms (median), %.3f ms (p99), %.3f ms (worst)\n", name, 1e3 * all[all.size() / 2], 1e3 * all[all.size() * 99 / 100],
                1e3 * all.back());
  }
};

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

struct Flight {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  btDbvtBroadphase broadphase;
  btSequentialImpulseConstraintSolver solver;
  btDiscreteDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
  btSphereShape shape{kRadius};
  btRigidBody body{{1000, nullptr, &shape, btVector3(400, 400, 400)}};
  rc_terrain* terrain;
  BulletGround ground;
  double pace = 0;  // times real time; 0: as fast as it goes
  std::chrono::steady_clock::time_point due = std::chrono::steady_clock::now();
  Times updates, steps;
  std::size_t waits = 0, mostTiles = 0;
  double deepest = -INFINITY;  // below the true ground, beyond the tile's error

  Flight(rc_terrain* over, double start) : terrain(over), ground(world, over, start, 0, 1, 32) {
    world.setGravity({0, -9.81f, 0});
    body.setDamping(0, 0.3f);
    body.setFriction(0.9f);
    body.setRollingFriction(0.3f);
    body.setActivationState(DISABLE_DEACTIVATION);
    body.getWorldTransform().setOrigin({0, above(start) + 60, 0});
    world.addRigidBody(&body);
    ground.followWaiting();
  }
  ~Flight() { world.removeRigidBody(&body); }

  double x() const { return ground.x() + body.getWorldTransform().getOrigin().x(); }
  double z() const { return ground.z() + body.getWorldTransform().getOrigin().z(); }
  double y() const { return body.getWorldTransform().getOrigin().y(); }
  float above(double x) const {
    const double at[] = {x, z()};
    float height;
    check(rc_terrain_heights(terrain, at, 1, &height));
    return height;
  }

  void step() {
    due += std::chrono::nanoseconds(pace > 0 ? std::llround(1e9 / (kRate * pace)) : 0);
    std::this_thread::sleep_until(due);
    const double begin = now();
    ground.follow();
    updates.all.push_back(now() - begin);
    if (!ground.tile(x(), z())) {  // simulated time may run ahead of the thread that makes the ground
      ++waits;
      ground.followWaiting();
    }
    const double simulated = now();
    world.stepSimulation(1.0f / kRate, 4, 1.0f / (4 * kRate));
    steps.all.push_back(now() - simulated + updates.all.back());
    mostTiles = std::max(mostTiles, ground.tiles());
    const rc_tile* tile = ground.tile(x(), z());
    if (tile) deepest = std::max(deepest, above(x()) - tile->error - (y() - kRadius));
  }
};

}  // namespace

int main(int argc, char** argv) try {
  const double length = 1000 * (argc > 1 ? std::atof(argv[1]) : 5);
  const auto file = std::filesystem::temp_directory_path() / ("landing-" + std::to_string(std::random_device{}()) + ".asc");
  writeMap(file, length);
  rc_terrain* terrain;
  rc_terrain_options options{};
  options.size = sizeof options;
  options.raster = "place=centre edge=mirror";
  check(rc_terrain_open(file.c_str(), &options, &terrain));
  std::filesystem::remove(file);
  {
    Flight flight(terrain, -length / 2);
    flight.pace = argc > 2 ? std::atof(argv[2]) : 0;
    double before = 0;
    while (flight.x() < length / 2) {  // 60 m over the highest ground of the next seconds
      float highest = -INFINITY;
      for (int k = 0; k <= 10; ++k) highest = std::max(highest, flight.above(flight.x() + kPitch * k));
      const double climb = std::clamp(highest + 60 - flight.y(), -20.0, 40.0);
      flight.body.setLinearVelocity({btScalar(kSpeed), btScalar(climb), 0});
      flight.step();
      if (before == 0 && flight.x() > -0.4 * length) before = residentMegabytes();
    }
    const double after = residentMegabytes();
    int touched = 0;
    for (int k = 0; k < 120 * kRate; ++k) {
      const bool down = flight.y() - flight.above(flight.x()) < 2 * kRadius;
      if (down && !touched) touched = k;
      if (!touched) flight.body.setLinearVelocity({15, -3, 0});
      flight.step();
    }
    std::printf("%.0f km; landed after %.0f s more, then %.1f m/s, %.3f m from the ground\n", length / 1000, double(touched) / kRate,
                flight.body.getLinearVelocity().length(), flight.y() - kRadius - flight.above(flight.x()));
    std::printf("at most %.3f m deeper than the tiles' error; waited for ground %zu times\n", flight.deepest, flight.waits);
    std::printf("at most %zu tiles, %.1f MB; the process %.1f MB after a tenth of the way, %.1f MB at its end\n", flight.mostTiles,
                flight.mostTiles * (33 * 33 * sizeof(float)) / 1e6, before, after);
    flight.updates.print("ground's share of a step");
    flight.steps.print("step");
    if (!touched || flight.deepest > kBelow) return 1;
  }
  rc_terrain_close(terrain);
} catch (const std::exception& e) {
  return std::fprintf(stderr, "landing: %s\n", e.what()), 1;
}
