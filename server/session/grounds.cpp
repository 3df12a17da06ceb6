#include "server/session/grounds.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <utility>

#include "common/codec/codec.h"
#include "common/wire/wire.h"
#include "server/box/box_mesh.h"
#include "server/query/query.h"

namespace ridgecast::session {

namespace {

constexpr double kCoarser = 2;    // factor for an error that cannot be reached
constexpr double kInside = 0.65;  // of the error: the mesher's share; the rest is for what its samples missed
constexpr int kFineness = 8;      // of the check of the result: 1/256 of a leaf's side

// Keeps the triangles whose bounding box touches the circle.
void trim(mesh::LeafMesh& leaf, lattice::Point at, double radius) {
  const lattice::Step cornerX = leaf.address.x() - at.x, cornerZ = leaf.address.z() - at.z;
  std::erase_if(leaf.triangles, [&](const mesh::Triangle& t) {
    lattice::Step lowX = lattice::kMaxPosition, highX = -lowX, lowZ = lowX, highZ = -lowX;
    for (const std::uint32_t v : t) {
      lowX = std::min(lowX, cornerX + leaf.vertices[v].x), highX = std::max(highX, cornerX + leaf.vertices[v].x);
      lowZ = std::min(lowZ, cornerZ + leaf.vertices[v].z), highZ = std::max(highZ, cornerZ + leaf.vertices[v].z);
    }
    const auto dx = static_cast<double>(std::max({lowX, -highX, lattice::Step{0}}));
    const auto dz = static_cast<double>(std::max({lowZ, -highZ, lattice::Step{0}}));
    return dx * dx + dz * dz > radius * radius;
  });
  mesh::canonicalize(leaf);
}

}  // namespace

Grounds::Grounds(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangleBudget, std::shared_ptr<scheduling::Pool> pool,
                 std::shared_ptr<Sender> sender, std::chrono::seconds timeout)
    : terrain_(std::move(terrain)),
      triangleBudget_(triangleBudget),
      pool_(std::move(pool)),
      sender_(std::move(sender)),
      timeout_(timeout) {}

bool Grounds::ask(const wire::AskGround& ask) {
  const std::lock_guard lock(mutex_);
  if (*open_ >= wire::kMaxGrounds) return false;
  ++*open_;
  pending_.push_back(ask);
  if (!runs_) runs_ = pool_->post([self = shared_from_this()] { self->run(); });
  return true;
}

void Grounds::close() {
  stop_.request_stop();
  const std::lock_guard lock(mutex_);
  pending_.clear();
}

void Grounds::run() {
  wire::AskGround request;
  {
    const std::lock_guard lock(mutex_);
    runs_ = false;
    if (pending_.empty() || stop_.stop_requested()) return;
    request = pending_.front();
    pending_.pop_front();
    runs_ = true;
  }
  try {
    answer(request);
  } catch (const std::exception& e) {
    sender_->fail({wire::ErrorCode::kInternal, std::string("The server failed: ") + e.what()});
  }
  const std::lock_guard lock(mutex_);
  runs_ = !pending_.empty() && pool_->post([self = shared_from_this()] { self->run(); });
}

void Grounds::answer(const wire::AskGround& request) {
  const double radius = request.radius * lattice::kStepsPerMetre;
  const auto reach = static_cast<lattice::Step>(std::ceil(radius)) + 1;
  const auto within = [](lattice::Step v) { return std::clamp(v, -lattice::kMaxPosition, lattice::kMaxPosition); };
  const auto make = [&](double error) {
    const box::Watch watch{stop_.get_token(), std::chrono::steady_clock::now() + timeout_, static_cast<double>(timeout_.count())};
    return box::meshBox(
        *terrain_,
        {{within(request.at.x - reach), within(request.at.z - reach)}, {within(request.at.x + reach), within(request.at.z + reach)}, error},
        triangleBudget_, *pool_, watch);
  };
  double error = request.error * kInside;
  auto made = make(error);
  // A cliff, the budget or the time forbid it: use the best that is possible.
  using Kind = box::Problem::Kind;
  while (!made && error < 1e4 && (made.error().kind == Kind::kTooMuch || made.error().kind == Kind::kTooSlow))
    made = make(error *= kCoarser);
  if (stop_.stop_requested()) return;
  if (!made) return sender_->fail({wire::ErrorCode::kLimit, "The requested ground could not be made: " + made.error().message});

  wire::Ground ground;
  ground.id = request.id;
  for (mesh::LeafMesh& leaf : made->leaves) trim(leaf, request.at, radius);
  std::erase_if(made->leaves, [](const mesh::LeafMesh& leaf) { return leaf.triangles.empty(); });
  ground.leaves.resize(made->leaves.size());
  pool_->forEach(made->leaves.size(), 1, [&](std::size_t k) {
    const mesh::LeafMesh& leaf = made->leaves[k];
    ground.leaves[k] = {leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
                        codec::encodeLeaf(leaf), query::deviation(*terrain_, leaf, kFineness)};
  });
  for (const wire::LeafWhole& leaf : ground.leaves) ground.error = std::max(ground.error, static_cast<double>(leaf.error));
  sender_->send(std::move(ground), ticketOf(open_));
}

}  // namespace ridgecast::session
