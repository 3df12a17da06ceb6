#include "tests/unit/server/member/scripted.h"

#include "common/codec/codec.h"
#include "common/mesh/leaf_mesh.h"
#include "tests/support/waiting.h"

namespace ridgecast::session {

using testing_support::kTimeout;

namespace {

class Flat final : public terrain::Terrain {
 public:
  explicit Flat(std::uint32_t seed) : seed_(seed) {}
  std::string_view name() const override { return "flat"; }
  std::string_view source() const override { return "// flat"; }
  std::uint32_t seed() const override { return seed_; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    std::fill(out.begin(), out.end(), 0.0f);
  }

 private:
  std::uint32_t seed_;
};

class ScriptedMesh final : public IteratingMesh {
 public:
  explicit ScriptedMesh(std::shared_ptr<Script> script) : script_(std::move(script)) { ++script_->alive; }
  ~ScriptedMesh() override { --script_->alive; }

  wire::IterationStats iterate(const camera::Camera& camera) override {
    state_ = script_->next(++script_->iterations, camera);
    leaves_.clear();
    for (const auto& [address, content] : state_.leaves) {
      const auto leaf = contentOf(address, content);
      leaves_.push_back({address, ++versions_, mesh::hashLeaf(leaf), static_cast<std::uint32_t>(leaf.triangles.size())});
    }
    wire::IterationStats figures;
    figures.leaves = static_cast<std::uint32_t>(leaves_.size());
    return figures;
  }
  void setInsertionLimit(std::uint32_t most) override { script_->insertionLimit = most; }
  void change(const wire::Settings& granted) override { script_->changes.emplace_back(script_->iterations.load(), granted); }
  void setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) override {
    script_->grounds.push_back({script_->iterations.load(), std::move(terrain), {changed.begin(), changed.end()}});
  }
  bool settled() const override { return state_.settled; }
  const std::vector<mesh::LeafState>& leaves() const override { return leaves_; }
  mesh::LeafMesh extract(lattice::LeafAddress address) const override { return contentOf(address, state_.leaves.at(address)); }
  // The first is marked with the iteration's number.
  std::vector<wire::Candidate> candidates(std::uint32_t most) const override {
    std::vector<wire::Candidate> out(most, wire::Candidate{{1, 2, 3}, 0.5f});
    if (most > 0) out.front().at.y = script_->iterations;
    return out;
  }

 private:
  std::shared_ptr<Script> script_;
  Script::State state_;
  std::vector<mesh::LeafState> leaves_;
  std::uint64_t versions_ = 0;
};

}  // namespace

std::shared_ptr<const terrain::Terrain> flatTerrain(std::uint32_t seed) { return std::make_shared<Flat>(seed); }

mesh::LeafMesh contentOf(lattice::LeafAddress address, std::int32_t content) {
  mesh::LeafMesh leaf{address, {}, {}};
  if (content == 0) return leaf;
  const int unit = 1 << lattice::horizontalBits(address.level);
  leaf.vertices = {{0, 0, content}, {unit, unit, content + 1}, {unit, 0, content}};
  leaf.triangles = {{0, 1, 2}};
  mesh::canonicalize(leaf);
  return leaf;
}

MakeMesh scriptedMeshes(const std::shared_ptr<Script>& script) {
  return [script](const std::shared_ptr<const terrain::Terrain>&, const wire::Settings&, const std::shared_ptr<scheduling::Pool>&) {
    return std::make_unique<ScriptedMesh>(script);
  };
}

void Client::hold(const mesh::LeafMesh& leaf) {
  const std::lock_guard lock(mutex_);
  held_[leaf.address] = leaf;
}

wire::Resume Client::held() const {
  const std::lock_guard lock(mutex_);
  wire::Resume out;
  for (const auto& [address, leaf] : held_) out.leaves.push_back({address, mesh::hashLeaf(leaf)});
  return out;
}

std::vector<wire::Settings> Client::granted() const {
  const std::lock_guard lock(mutex_);
  return granted_;
}

void Client::send(wire::ServerMessage message, std::shared_ptr<const void>) {
  const std::lock_guard lock(mutex_);
  if (error_) return;
  if (auto* world = std::get_if<wire::World>(&message)) {
    if (world_) complaint_ = "a second world";
    world_ = std::move(*world);
  } else if (const auto* granted = std::get_if<wire::Granted>(&message)) {
    granted_.push_back(granted->settings);
  } else if (auto* iteration = std::get_if<wire::Iteration>(&message)) {
    if (!world_) complaint_ = "an iteration before the world";
    apply(*iteration);
    iterations_.push_back(std::move(*iteration));
  }
  changed_.notify_all();
}

void Client::fail(wire::ErrorMessage message) {
  const std::lock_guard lock(mutex_);
  if (error_) complaint_ = "a second error";
  error_ = std::move(message);
  changed_.notify_all();
}

void Client::apply(const wire::Iteration& iteration) {
  if (iteration.number != iterations_.size() + 1) complaint_ = "numbers do not ascend by 1";
  for (const auto& address : iteration.gone)
    if (held_.erase(address) == 0) complaint_ = "a leaf is gone that is not held";
  for (const auto& whole : iteration.whole) {
    if (whole.triangles == 0) {
      if (!whole.payload.empty()) complaint_ = "an empty leaf has a payload";
      held_[whole.address] = {whole.address, {}, {}};
      continue;
    }
    const auto leaf = codec::decodeLeaf(whole.payload, whole.address, whole.vertices, whole.triangles);
    if (!leaf) {
      complaint_ = leaf.error().message;
    } else {
      held_[whole.address] = *leaf;
    }
  }
  meshHash_ = 0;
  for (const auto& [address, leaf] : held_) meshHash_ += mesh::hashTerm(address, mesh::hashLeaf(leaf));
  if (meshHash_ != iteration.meshHash)
    complaint_ = "iteration " + std::to_string(iteration.number) + " left another mesh than it announced";
}

std::optional<wire::World> Client::world() {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, kTimeout, [this] { return world_ || error_; });
  return world_;
}

std::optional<wire::Iteration> Client::iteration() {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, kTimeout, [this] { return iterations_.size() > taken_ || error_; });
  if (iterations_.size() <= taken_) return {};
  return iterations_[taken_++];
}

std::optional<wire::ErrorMessage> Client::error() {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, kTimeout, [this] { return error_.has_value(); });
  return error_;
}

bool Client::quiet(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  const std::size_t before = iterations_.size();
  return !changed_.wait_for(lock, time, [&] { return iterations_.size() != before || error_; });
}

std::uint64_t Client::meshHash() const {
  const std::lock_guard lock(mutex_);
  return meshHash_;
}

std::size_t Client::sent() const {
  const std::lock_guard lock(mutex_);
  return iterations_.size();
}

std::string Client::complaint() const {
  const std::lock_guard lock(mutex_);
  return complaint_;
}

}  // namespace ridgecast::session
