#include "client/scene/scene.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/codec/codec.h"

namespace ridgecast::scene {
namespace {

std::string nameOf(const lattice::LeafAddress& a) {
  return "leaf (level " + std::to_string(a.level) + ", " + std::to_string(a.i) + ", " + std::to_string(a.j) + ")";
}

HeldLeaf hold(mesh::LeafMesh&& mesh) {
  HeldLeaf leaf;
  leaf.hash = mesh::hashLeaf(mesh);
  if (!mesh.vertices.empty()) leaf.low = leaf.high = mesh.vertices.front();
  for (const mesh::LocalVertex& v : mesh.vertices) {
    leaf.low = {std::min(leaf.low.x, v.x), std::min(leaf.low.z, v.z), std::min(leaf.low.y, v.y)};
    leaf.high = {std::max(leaf.high.x, v.x), std::max(leaf.high.z, v.z), std::max(leaf.high.y, v.y)};
  }
  leaf.mesh = std::make_shared<const mesh::LeafMesh>(std::move(mesh));
  return leaf;
}

// Twice the area of (a, b, p), positive when p lies to the left of a -> b seen from above. Coordinates below 2^29: exact.
std::int64_t side(const mesh::LocalVertex& a, const mesh::LocalVertex& b, std::int64_t x, std::int64_t z) {
  return (std::int64_t{b.z} - a.z) * (x - a.x) - (std::int64_t{b.x} - a.x) * (z - a.z);
}

}  // namespace

Outcome<void> Scene::apply(const wire::Iteration& iteration) {
  const std::string name = "iteration " + std::to_string(iteration.number) + ": ";
  if (iteration.number == 0 || (iteration_ != 0 && iteration.number != iteration_ + 1))
    return Error{name + "out of order, " + std::to_string(iteration_ + 1) + " was expected"};

  // First everything that can fail, on the side; then what cannot.
  std::uint64_t hash = hash_, triangles = triangles_;
  std::size_t count = leaves_.size();
  const auto subtract = [&](const lattice::LeafAddress& address, const HeldLeaf& leaf) {
    hash -= mesh::hashTerm(address, leaf.hash);
    triangles -= leaf.mesh->triangles.size();
    --count;
  };

  std::set<lattice::LeafAddress> gone;
  for (const lattice::LeafAddress& address : iteration.gone) {
    const auto held = leaves_.find(address);
    if (held == leaves_.end()) return Error{name + nameOf(address) + " is gone but was not held"};
    if (!gone.insert(address).second) return Error{name + nameOf(address) + " is gone twice"};
    subtract(address, held->second);
  }

  std::uint64_t announced = triangles;
  for (const wire::LeafWhole& whole : iteration.whole) announced += whole.triangles;
  std::map<lattice::LeafAddress, HeldLeaf> fresh;
  for (const wire::LeafWhole& whole : iteration.whole) {
    if (!lattice::addressIsValid(whole.address)) return Error{name + nameOf(whole.address) + " lies beyond the lattice"};
    if (fresh.contains(whole.address)) return Error{name + nameOf(whole.address) + " is there twice"};
    const auto held = leaves_.find(whole.address);
    if (held != leaves_.end() && !gone.contains(whole.address)) {
      subtract(whole.address, held->second);
      announced -= held->second.mesh->triangles.size();
    }
    fresh.emplace(whole.address, HeldLeaf{});
  }
  count += fresh.size();
  if (announced > kMaxTriangles)
    return Error{name + "the mesh would have " + std::to_string(announced) + " triangles, at most " + std::to_string(kMaxTriangles) +
                 " are held"};
  if (count > kMaxLeaves)
    return Error{name + "the mesh would have " + std::to_string(count) + " leaves, at most " + std::to_string(kMaxLeaves) + " are held"};

  for (const wire::LeafWhole& whole : iteration.whole) {
    Outcome<mesh::LeafMesh> mesh = codec::decodeLeaf(whole.payload, whole.address, whole.vertices, whole.triangles);
    if (!mesh) return Error{name + nameOf(whole.address) + ": " + mesh.error().message};
    HeldLeaf& leaf = fresh[whole.address];
    leaf = hold(std::move(*mesh));
    hash += mesh::hashTerm(whole.address, leaf.hash);
    triangles += whole.triangles;
  }

  ++version_;
  for (const lattice::LeafAddress& address : gone) leaves_.erase(address);
  for (auto& [address, leaf] : fresh) {
    leaf.version = version_;
    leaves_[address] = std::move(leaf);
  }
  hash_ = hash;
  triangles_ = triangles;
  iteration_ = iteration.number;
  return {};
}

void Scene::clear() {
  leaves_.clear();
  hash_ = triangles_ = iteration_ = 0;
}

std::optional<double> Scene::height(lattice::Point at) const {
  for (const auto& [address, leaf] : leaves_) {
    const std::int64_t x = at.x - address.x(), z = at.z - address.z();
    if (x < leaf.low.x || x > leaf.high.x || z < leaf.low.z || z > leaf.high.z) continue;
    const mesh::LeafMesh& mesh = *leaf.mesh;
    for (const mesh::Triangle& t : mesh.triangles) {
      const mesh::LocalVertex &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
      const std::int64_t wa = side(b, c, x, z), wb = side(c, a, x, z), wc = side(a, b, x, z);
      if (wa < 0 || wb < 0 || wc < 0) continue;
      const double total = static_cast<double>(wa + wb + wc);
      const double steps = (static_cast<double>(wa) * a.y + static_cast<double>(wb) * b.y + static_cast<double>(wc) * c.y) / total;
      return steps * lattice::kMetresPerStep;
    }
  }
  return std::nullopt;
}

}  // namespace ridgecast::scene
