#include "server/session/grounds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <numbers>
#include <utility>

#include "common/codec/codec.h"
#include "common/wire/wire.h"
#include "server/query/query.h"

namespace ridgecast::session {

namespace {

constexpr double kPixels = 1;         // the threshold: triangles below a quarter of a pixel are not refined, so it is not a small one
constexpr int kMostIterations = 100;  // of one question
constexpr int kMostRounds = 4;        // of looking how good the mesh is and asking for more
constexpr double kWorthwhile = 0.9;   // another round, when the one before took the error to this share
constexpr int kFineness = 8;          // of the look: 1/256 of a leaf's side
constexpr std::uint32_t kMostPixels = 32768;

// Lets go of one open question when it is destroyed.
struct Ticket {
  std::shared_ptr<std::atomic<std::size_t>> open;
  explicit Ticket(std::shared_ptr<std::atomic<std::size_t>> o) : open(std::move(o)) {}
  Ticket(const Ticket&) = delete;
  Ticket& operator=(const Ticket&) = delete;
  ~Ticket() { --*open; }
};

wire::Settings finest(const wire::Settings& granted) {
  wire::Settings s = granted;
  s.metric = wire::Metric::kPixels;
  s.threshold = kPixels;
  return s;
}

}  // namespace

Grounds::Grounds(std::shared_ptr<const terrain::Terrain> terrain, const wire::Settings& granted, MakeMesh makeMesh,
                 std::shared_ptr<scheduling::Pool> pool, std::shared_ptr<Sender> sender)
    : terrain_(std::move(terrain)),
      settings_(finest(granted)),
      makeMesh_(std::move(makeMesh)),
      pool_(std::move(pool)),
      sender_(std::move(sender)) {}

bool Grounds::ask(const wire::AskGround& ask) {
  const std::lock_guard lock(mutex_);
  if (closed_) return true;
  if (*open_ >= wire::kMaxGrounds) return false;
  ++*open_;
  asked_.push_back(ask);
  if (!runs_) runs_ = post();
  return true;
}

void Grounds::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  asked_.clear();
  if (!runs_) runs_ = post();  // frees the mesh
}

bool Grounds::post() {
  return pool_->post([self = shared_from_this()] { self->run(); });
}

void Grounds::run() {
  bool closed = false;
  {
    const std::lock_guard lock(mutex_);
    closed = closed_;
    if (!closed && !begun_) {
      begun_ = true;
      now_ = asked_.front();
      iterations_ = rounds_ = 0;
      sharpness_ = 1;
    }
  }
  if (closed) {
    mesh_.reset();
    return;
  }
  bool done = true;
  try {
    if (iterations_ == 0) aim();
    done = work();
  } catch (const std::exception& e) {
    sender_->fail({wire::ErrorCode::kInternal, std::string("The server failed: ") + e.what()});
  }
  const std::lock_guard lock(mutex_);
  if (done) {
    begun_ = false;
    if (!asked_.empty()) asked_.pop_front();
  }
  runs_ = (!asked_.empty() || closed_) && post();
}

// An error is seen best from the side, a triangle from above (server/refinement/screening.h): the eye stands off so that it looks down at
// the circle at 20 to 60 degrees. The field of view holds all of it, and the picture is so fine that where the asked error looks smallest
// it is the threshold.
void Grounds::aim() {
  constexpr int kSide = 16;
  std::array<lattice::Step, kSide * kSide> x, z;
  std::array<float, kSide * kSide> height;
  const double radius = now_.radius;
  for (std::size_t k = 0; k < x.size(); ++k) {
    const auto place = [&](std::size_t i) {
      return static_cast<lattice::Step>(radius * lattice::kStepsPerMetre * (2.0 * static_cast<double>(i) / (kSide - 1) - 1));
    };
    x[k] = std::clamp(now_.at.x + place(k % kSide), -lattice::kMaxPosition, lattice::kMaxPosition);
    z[k] = std::clamp(now_.at.z + place(k / kSide), -lattice::kMaxPosition, lattice::kMaxPosition);
  }
  terrain_->heights(x, z, height);
  const auto [low, high] = std::minmax_element(height.begin(), height.end());
  const double away = 1.8 * radius + 32;
  const lattice::Step eyeZ = now_.at.z + static_cast<lattice::Step>(away * lattice::kStepsPerMetre);
  camera::Pose& pose = camera_.pose;
  pose = {};
  pose.x = now_.at.x;
  pose.z = std::clamp(eyeZ, -lattice::kMaxPosition, lattice::kMaxPosition);
  pose.y = *high + 0.9 * radius + 24;
  pose.pitch = -std::atan2(pose.y - 0.5 * (static_cast<double>(*low) + *high), away);
  const camera::Vec3 forward = camera::forward(pose), right = camera::right(pose), up = camera::up(pose);
  double tangent = 0.1, reach = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double dx = static_cast<double>(x[k] - pose.x) * lattice::kMetresPerStep, dy = height[k] - pose.y,
                 dz = static_cast<double>(z[k] - pose.z) * lattice::kMetresPerStep;
    const auto along = [&](const camera::Vec3& axis) { return axis.x * dx + axis.y * dy + axis.z * dz; };
    const double depth = std::max(along(forward), 1.0);
    tangent = std::max({tangent, std::abs(along(right)) / depth, std::abs(along(up)) / depth});
    const double flat2 = dx * dx + dz * dz;
    reach = std::max(reach, (flat2 + dy * dy) / std::sqrt(std::max(flat2, 1.0)));
  }
  tangent = std::min(1.1 * tangent, 12.0);
  const double pixelsPerRadian = kPixels * reach / now_.error * sharpness_;
  camera_.projection.verticalFov = 2 * std::atan(tangent);
  camera_.projection.width = camera_.projection.height =
      static_cast<std::uint32_t>(std::clamp(2 * tangent * pixelsPerRadian, 16.0, static_cast<double>(kMostPixels)));
}

bool Grounds::work() {
  if (!mesh_) mesh_ = makeMesh_(terrain_, settings_, pool_);
  mesh_->iterate(camera_);
  const bool last = ++iterations_ >= kMostIterations;
  if (!mesh_->settled() && !last) return false;
  wire::Ground ground = answer();
  const bool couldBeFiner = camera_.projection.width < kMostPixels;
  const bool helps = rounds_ == 0 || ground.error < kWorthwhile * lastError_;
  if (ground.error > now_.error && couldBeFiner && helps && !last && ++rounds_ < kMostRounds) {
    lastError_ = ground.error;
    sharpness_ *= std::clamp(1.1 * ground.error / now_.error, 1.2, 3.0);
    aim();
    return false;
  }
  sender_->send(std::move(ground), std::make_shared<Ticket>(open_));
  return true;
}

// The triangles over the circle, by leaf.
wire::Ground Grounds::answer() {
  wire::Ground ground;
  ground.id = now_.id;
  const auto radius = static_cast<lattice::Step>(std::ceil(now_.radius * lattice::kStepsPerMetre));
  std::vector<mesh::LeafMesh> leaves;
  for (const pipeline::LeafState& state : mesh_->leaves()) {
    const lattice::LeafAddress& a = state.address;
    // Triangles reach beyond their leaf's square by less than the square's side.
    const lattice::Step reach = radius + a.side();
    if (a.x() > now_.at.x + reach || a.x() + a.side() < now_.at.x - reach || a.z() > now_.at.z + reach ||
        a.z() + a.side() < now_.at.z - reach)
      continue;
    mesh::LeafMesh leaf = mesh_->extract(a);
    const auto over = [&](const mesh::Triangle& t) {
      lattice::Step lowX = lattice::kMaxPosition, highX = -lattice::kMaxPosition, lowZ = lowX, highZ = highX;
      for (const std::uint32_t v : t) {
        const lattice::Step x = a.x() + leaf.vertices[v].x, z = a.z() + leaf.vertices[v].z;
        lowX = std::min(lowX, x), highX = std::max(highX, x), lowZ = std::min(lowZ, z), highZ = std::max(highZ, z);
      }
      // The nearest place of the triangle's box lies in the circle.
      const double dx = static_cast<double>(std::max({lowX - now_.at.x, now_.at.x - highX, lattice::Step{0}}));
      const double dz = static_cast<double>(std::max({lowZ - now_.at.z, now_.at.z - highZ, lattice::Step{0}}));
      return dx * dx + dz * dz <= static_cast<double>(radius) * static_cast<double>(radius);
    };
    std::erase_if(leaf.triangles, [&](const mesh::Triangle& t) { return !over(t); });
    if (leaf.triangles.empty()) continue;
    mesh::canonicalize(leaf);
    leaves.push_back(std::move(leaf));
  }
  ground.leaves.resize(leaves.size());
  pool_->forEach(leaves.size(), 1, [&](std::size_t k) {
    const mesh::LeafMesh& leaf = leaves[k];
    ground.leaves[k] = {leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
                        codec::encodeLeaf(leaf), query::deviation(*terrain_, leaf, kFineness)};
  });
  for (const wire::LeafWhole& leaf : ground.leaves) ground.error = std::max(ground.error, static_cast<double>(leaf.error));
  return ground;
}

}  // namespace ridgecast::session
