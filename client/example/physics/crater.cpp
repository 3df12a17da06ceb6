// 25 boxes fall asleep on level ground of a session; a crater opens under them, then the ground rises:  crater URL
#include <cstdio>
#include <memory>
#include <string>

#include "judge.h"

namespace {

constexpr int kRate = 120, kMaxSeconds = 30;
constexpr double kAtRest = 0.05;  // metres between a box at rest and the ground
constexpr float kRadius = 0.25f;

void check(rc_status status) {
  if (status != RC_OK) throw std::runtime_error(rc_message());
}

struct Scene {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  btDbvtBroadphase broadphase;
  btSequentialImpulseConstraintSolver solver;
  btDiscreteDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
  btBoxShape box{{kRadius, kRadius, kRadius}};
  const std::vector<btVector3> points = surface(box, kRadius);
  rc_world* const session;
  rc_terrain* const terrain;
  BulletGround ground;
  std::vector<std::unique_ptr<btRigidBody>> boxes;

  explicit Scene(rc_world* joined) : session(joined), terrain(rc_world_terrain(joined)), ground(world, terrain, 0, 0, 0.25, 2) {
    world.setGravity({0, -9.81f, 0});
    for (int k = 0; k < 25; ++k) {
      const double at[] = {3.0 * (k % 5) - 6, 3.0 * (k / 5) - 6};
      float height;
      check(rc_terrain_heights(terrain, at, 1, &height));
      btVector3 inertia;
      box.calculateLocalInertia(10, inertia);
      btRigidBody::btRigidBodyConstructionInfo info(10, nullptr, &box, inertia);
      info.m_startWorldTransform = btTransform(btQuaternion(0.3f * k, 0.2f, 0.1f), {float(at[0]), height + 1, float(at[1])});
      info.m_friction = 0.9f;
      info.m_linearDamping = info.m_angularDamping = 0.3f;
      boxes.push_back(std::make_unique<btRigidBody>(info));
      boxes.back()->setCcdMotionThreshold(kRadius);
      boxes.back()->setCcdSweptSphereRadius(0.5f * kRadius);
      world.addRigidBody(boxes.back().get());
    }
  }
  ~Scene() {
    for (auto& one : boxes) world.removeRigidBody(one.get());
  }
  void edit(const std::string& operation) { check(rc_world_edit(session, operation.c_str(), nullptr, 60, nullptr)); }
  std::size_t asleep() const {
    return std::ranges::count_if(boxes, [](const auto& one) { return !one->isActive(); });
  }
  // Until all sleep; false: they do not, or not on the true ground.
  bool rests(const char* where) {
    int step = 0;
    do {
      ground.followWaiting();
      world.stepSimulation(1.0f / kRate, 0);
    } while (asleep() < boxes.size() && ++step < kMaxSeconds * kRate);
    double worst = 0;
    for (const auto& one : boxes) worst = std::max(worst, std::abs(gap(ground, *one, terrain, points)));
    std::printf("%s: %zu of %zu asleep after %.1f s, at most %.4f m from the true ground\n", where, asleep(), boxes.size(),
                double(step) / kRate, worst);
    return asleep() == boxes.size() && worst <= kAtRest;
  }
};

}  // namespace

int main(int argc, char** argv) try {
  rc_join_options options{};
  options.size = sizeof options;
  options.sensor = 1;
  rc_world* session;
  check(rc_join(argc > 1 ? argv[1] : "ws://127.0.0.1:7070", &options, &session));
  bool good;
  {
    check(rc_world_edit(session, R"({"op": "level", "x": 0, "z": 0, "radius": 40, "height": 1000})", nullptr, 60, nullptr));
    Scene scene(session);
    good = scene.rests("level");
    scene.edit(R"({"op": "crater", "x": 0, "z": 0, "radius": 30, "depth": 6})");
    good = scene.rests("crater") && good;
    scene.edit(R"({"op": "raise", "x": 0, "z": 0, "radius": 30, "by": 8})");
    good = scene.rests("raised") && good;
  }
  rc_world_close(session);
  return good ? 0 : 1;
} catch (const std::exception& e) {
  return std::fprintf(stderr, "crater: %s\n", e.what()), 1;
}
