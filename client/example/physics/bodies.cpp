// Drops 1,000 bodies, spheres and boxes, at 100 places out to 10^9 m, and judges where they are by the true ground:  bodies [SECONDS]
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "judge.h"

namespace {

constexpr int kPlaces = 100, kBodies = 10, kRate = 120;
constexpr double kAtRest = 0.05;  // metres between a body at rest and the ground
constexpr double kBelow = 0.05;   // metres that Bullet lets a body into its ground, beyond the tile's error
constexpr float kRadius = 0.25f;

struct Place {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  btDbvtBroadphase broadphase;
  btSequentialImpulseConstraintSolver solver;
  btDiscreteDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
  std::vector<std::unique_ptr<btRigidBody>> bodies;
  BulletGround ground;

  Place(rc_terrain* terrain, double x, double z, btCollisionShape& sphere, btCollisionShape& box) : ground(world, terrain, x, z, 0.25, 2) {
    world.setGravity({0, -9.81f, 0});
    for (int k = 0; k < kBodies; ++k) {
      btCollisionShape& shape = k % 2 ? sphere : box;
      const int column = k % 3, row = k / 3;
      const double at[] = {ground.x() + 3 * column, ground.z() + 3 * row};
      float height;
      if (rc_terrain_heights(terrain, at, 1, &height) != RC_OK) throw std::runtime_error(rc_message());
      btVector3 inertia;
      shape.calculateLocalInertia(10, inertia);
      btRigidBody::btRigidBodyConstructionInfo info(10, nullptr, &shape, inertia);
      info.m_startWorldTransform =
          btTransform(btQuaternion(0.3f * k, 0.2f, 0.1f), {float(at[0] - ground.x()), height + 2 + 0.2f * k, float(at[1] - ground.z())});
      info.m_friction = 0.9f;
      info.m_rollingFriction = 0.1f;
      info.m_linearDamping = info.m_angularDamping = 0.3f;  // of the air
      bodies.push_back(std::make_unique<btRigidBody>(info));
      bodies.back()->setCcdMotionThreshold(kRadius);
      bodies.back()->setCcdSweptSphereRadius(0.5f * kRadius);
      world.addRigidBody(bodies.back().get());
    }
  }
  ~Place() {
    for (auto& body : bodies) world.removeRigidBody(body.get());
  }

  void step() {
    ground.followWaiting();
    world.stepSimulation(1.0f / kRate, 0);
  }
};

std::uint64_t hash(std::uint64_t before, const void* data, std::size_t size) {  // FNV-1a
  for (std::size_t k = 0; k < size; ++k) before = (before ^ static_cast<const unsigned char*>(data)[k]) * 1099511628211u;
  return before;
}

}  // namespace

int main(int argc, char** argv) try {
  const int seconds = argc > 1 ? std::atoi(argv[1]) : 5;
  rc_terrain* terrain;
  if (rc_terrain_open("alpine", nullptr, &terrain) != RC_OK) throw std::runtime_error(rc_message());
  btSphereShape sphere(kRadius);
  btBoxShape box({kRadius, kRadius, kRadius});
  const std::vector<btVector3> points[] = {surface(box, kRadius), surface(sphere, kRadius)};
  std::vector<double> resting;
  double below = 0, error = 0, farthest = 0;
  std::uint64_t state = 14695981039346656037u;
  for (int p = 0; p < kPlaces; ++p) {
    const double out = std::pow(10, 1 + 8.0 * p / (kPlaces - 1));
    Place place(terrain, out * std::cos(2.4 * p), out * std::sin(2.4 * p), sphere, box);
    const double from[] = {place.ground.x(), place.ground.z()};
    for (int step = 1; step <= seconds * kRate; ++step) {
      place.step();
      if (step % kRate) continue;
      for (int k = 0; k < kBodies; ++k) {
        const btRigidBody& body = *place.bodies[k];
        const btVector3 at = body.getWorldTransform().getOrigin();
        const rc_tile* tile = place.ground.tile(place.ground.x() + at.x(), place.ground.z() + at.z());
        const double apart = gap(place.ground, body, terrain, points[k % 2]);
        error = std::max(error, tile->error);
        below = std::max(below, -apart - tile->error);
        if (step == seconds * kRate && !body.isActive()) resting.push_back(std::abs(apart));
      }
    }
    for (const auto& body : place.bodies) {
      const btTransform& at = body->getWorldTransform();
      const double x = place.ground.x() + at.getOrigin().x(), z = place.ground.z() + at.getOrigin().z();
      farthest = std::max(farthest, std::hypot(x - from[0], z - from[1]));
      const btQuaternion turned = at.getRotation();
      const double all[] = {x, at.getOrigin().y(), z, turned.x(), turned.y(), turned.z(), turned.w()};
      state = hash(state, all, sizeof all);
    }
  }
  rc_terrain_close(terrain);
  std::ranges::sort(resting);
  const double worst = resting.empty() ? 0 : resting.back();
  std::printf("%d bodies, %d s: %zu at rest, %.4f m from the true ground (median), %.4f m (worst)\n", kPlaces * kBodies, seconds,
              resting.size(), resting.empty() ? 0 : resting[resting.size() / 2], worst);
  std::printf("at most %.4f m deeper than the tiles' error, which is at most %.4f m; farthest way %.0f m\n", below, error, farthest);
  std::printf("state %016llx\n", static_cast<unsigned long long>(state));
  return below <= kBelow && worst <= kAtRest ? 0 : 1;
} catch (const std::exception& e) {
  return std::fprintf(stderr, "bodies: %s\n", e.what()), 1;
}
