// The ground under the bodies of a Bullet world, from Ridgecast. Each tile is a btHeightfieldTerrainShape over the library's own heights,
// without a copy. Bullet's coordinates are metres from (x(), z()), y absolute; that origin follows the bodies, so that floats stay exact
// wherever they go. Where an edit changes the ground of a session, bodies that sleep wake up, and rise with ground that would swallow them.
#pragma once
#include <BulletCollision/CollisionShapes/btHeightfieldTerrainShape.h>
#include <btBulletDynamicsCommon.h>
#include <ridgecast.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <utility>
#include <vector>

class BulletGround {
 public:
  // Metres: initial origin, `spacing` of heights, `radius` of ground around each body. `world` and `terrain` must outlive it.
  BulletGround(btDiscreteDynamicsWorld& world, rc_terrain* terrain, double x, double z, double spacing, double radius)
      : world_(world), x_(std::round(x)), z_(std::round(z)) {
    rc_standing_options options{};
    options.size = sizeof options;
    options.spacing = spacing;
    options.radius = radius;
    check(rc_standing_open(terrain, &options, &standing_));
  }
  ~BulletGround() {
    for (auto& [key, tile] : tiles_) world_.removeCollisionObject(&tile.object);
    rc_standing_close(standing_);
  }
  BulletGround(const BulletGround&) = delete;
  BulletGround& operator=(const BulletGround&) = delete;

  double x() const { return x_; }
  double z() const { return z_; }
  std::size_t tiles() const { return tiles_.size(); }
  // The tile below a place of the terrain; null: not made yet.
  const rc_tile* tile(double x, double z) const {
    if (tiles_.empty()) return nullptr;
    const double side = kCells * tiles_.begin()->second.ground.spacing;
    const auto at = tiles_.find({std::llround(std::floor(x / side)), std::llround(std::floor(z / side))});
    return at == tiles_.end() ? nullptr : &at->second.ground;
  }

  // Before each step. Never waits: the ground ahead of the bodies is made by another thread.
  void follow() {
    move();
    take();
  }
  // The same, but waits until the ground around all bodies is there. Called before every step, it makes runs repeatable, bit for bit:
  // Bullet's results depend on the order of tiles.
  void followWaiting() {
    move();
    check(rc_standing_wait(standing_, 60));
    take();
  }

 private:
  void move() {
    const auto& bodies = world_.getNonStaticRigidBodies();
    btVector3 middle(0, 0, 0);
    for (int k = 0; k < bodies.size(); ++k) middle += bodies[k]->getWorldTransform().getOrigin() / btScalar(bodies.size());
    if (std::hypot(middle.x(), middle.z()) > 512) moveOrigin(std::round(middle.x()), std::round(middle.z()));
    places_.clear();
    for (int k = 0; k < bodies.size(); ++k) {
      places_.push_back(x_ + bodies[k]->getWorldTransform().getOrigin().x());
      places_.push_back(z_ + bodies[k]->getWorldTransform().getOrigin().z());
    }
    check(rc_standing_move(standing_, places_.data(), places_.size() / 2));
  }

  static constexpr int kCells = 32;
  struct Tile {
    explicit Tile(const rc_tile& t) : ground(t), shape(kCells + 1, kCells + 1, t.heights, t.lowest, t.highest, 1, false) {
      shape.setLocalScaling({btScalar(t.spacing), 1, btScalar(t.spacing)});
      object.setCollisionShape(&shape);
    }
    // Bullet's origin of a height field is the middle of its box.
    void place(double x, double z) {
      const double half = 0.5 * kCells * ground.spacing;
      object.getWorldTransform().setOrigin(
          {btScalar(ground.x + half - x), btScalar(0.5) * (ground.lowest + ground.highest), btScalar(ground.z + half - z)});
    }
    rc_tile ground;
    btHeightfieldTerrainShape shape;
    btCollisionObject object;
  };

  static void check(rc_status status) {
    if (status != RC_OK) throw std::runtime_error(rc_message());
  }

  // Wakes bodies that reach over a tile that goes, and adds those above it to `lifted`, with the ground's height there.
  using Lifted = std::vector<std::pair<btRigidBody*, double>>;
  void wake(const rc_tile& tile, Lifted& lifted) {
    const double x = tile.x - x_, z = tile.z - z_, side = kCells * tile.spacing;
    for (int k = 0; k < world_.getNonStaticRigidBodies().size(); ++k) {
      btRigidBody& body = *world_.getNonStaticRigidBodies()[k];
      btVector3 low, high;
      body.getAabb(low, high);
      if (high.x() < x || low.x() > x + side || high.z() < z || low.z() > z + side) continue;
      body.activate(true);
      const btVector3& at = body.getWorldTransform().getOrigin();
      if (at.x() >= x && at.x() < x + side && at.z() >= z && at.z() < z + side)
        lifted.emplace_back(&body, height(tile, x_ + at.x(), z_ + at.z()));
    }
  }
  void lift(const Lifted& lifted) {
    for (const auto& [body, before] : lifted) {
      btVector3 low, high;
      body->getAabb(low, high);
      const btVector3 at = body->getWorldTransform().getOrigin();
      const rc_tile* const now = tile(x_ + at.x(), z_ + at.z());
      const double by = now ? height(*now, x_ + at.x(), z_ + at.z()) - before : 0;
      if (by > 0 && low.y() < before + by) shift(*body, {0, btScalar(by), 0});
    }
  }
  // Bilinear, at a place of the terrain over the tile.
  static double height(const rc_tile& tile, double x, double z) {
    const double a = (x - tile.x) / tile.spacing, b = (z - tile.z) / tile.spacing;
    const int i = std::clamp(int(a), 0, kCells - 1), j = std::clamp(int(b), 0, kCells - 1);
    const float* const h = tile.heights + (kCells + 1) * j + i;
    const double low = h[0] + (a - i) * (h[1] - h[0]), high = h[kCells + 1] + (a - i) * (h[kCells + 2] - h[kCells + 1]);
    return low + (b - j) * (high - low);
  }

  void take() {
    Lifted lifted;
    rc_tile changed[64]{};
    changed[0].size = sizeof changed[0];
    std::size_t count = 0;
    do {
      check(rc_standing_changes(standing_, changed, 64, &count));
      for (std::size_t k = 0; k < std::min<std::size_t>(count, 64); ++k) {
        const std::pair key{changed[k].i, changed[k].j};
        if (changed[k].gone) {
          wake(tiles_.at(key).ground, lifted);
          world_.removeCollisionObject(&tiles_.at(key).object);
          tiles_.erase(key);
        } else {
          Tile& tile = tiles_.try_emplace(key, changed[k]).first->second;
          tile.place(x_, z_);
          world_.addCollisionObject(&tile.object, btBroadphaseProxy::StaticFilter,
                                    btBroadphaseProxy::AllFilter ^ btBroadphaseProxy::StaticFilter);
        }
      }
    } while (count > 64);
    lift(lifted);
  }

  void moveOrigin(double dx, double dz) {
    x_ += dx;
    z_ += dz;
    const btVector3 back(btScalar(-dx), 0, btScalar(-dz));
    for (auto& [key, tile] : tiles_) tile.place(x_, z_);
    for (int k = 0; k < world_.getNonStaticRigidBodies().size(); ++k) shift(*world_.getNonStaticRigidBodies()[k], back);
    world_.updateAabbs();
  }
  static void shift(btRigidBody& body, const btVector3& by) {
    body.getWorldTransform().getOrigin() += by;
    btTransform before = body.getInterpolationWorldTransform();
    before.getOrigin() += by;
    body.setInterpolationWorldTransform(before);
  }

  btDiscreteDynamicsWorld& world_;
  rc_standing* standing_ = nullptr;
  double x_, z_;
  std::map<std::pair<std::int64_t, std::int64_t>, Tile> tiles_;
  std::vector<double> places_;
};
