#include "client/scene/scene.h"

#include <algorithm>
#include <atomic>
#include <future>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/mesh/gather.h"
#include "common/wire/wire.h"

namespace ridgecast::scene {
namespace {

std::string nameOf(const lattice::LeafAddress& a) {
  return "leaf (level " + std::to_string(a.level) + ", " + std::to_string(a.i) + ", " + std::to_string(a.j) + ")";
}

HeldLeaf hold(mesh::LeafMesh&& mesh, std::uint64_t hash, float error) {
  HeldLeaf leaf;
  leaf.error = error;
  leaf.hash = hash;
  if (!mesh.vertices.empty()) leaf.low = leaf.high = mesh.vertices.front();
  for (const mesh::LocalVertex& v : mesh.vertices) {
    leaf.low = {std::min(leaf.low.x, v.x), std::min(leaf.low.z, v.z), std::min(leaf.low.y, v.y)};
    leaf.high = {std::max(leaf.high.x, v.x), std::max(leaf.high.z, v.z), std::max(leaf.high.y, v.y)};
  }
  leaf.mesh = std::make_shared<const mesh::LeafMesh>(std::move(mesh));
  return leaf;
}

// Which of the leaves that are gone cover a leaf or lie in it.
class Families {
 public:
  explicit Families(const std::set<lattice::LeafAddress>& gone) : gone_(gone) {
    for (const lattice::LeafAddress& address : gone)
      for (lattice::LeafAddress up = address; up.level < lattice::kMaxLevel;) below_[up = up.parent()].push_back(address);
  }
  std::vector<lattice::LeafAddress> of(const lattice::LeafAddress& address) const {
    std::vector<lattice::LeafAddress> out;
    if (const auto it = below_.find(address); it != below_.end()) out = it->second;
    for (lattice::LeafAddress up = address; up.level < lattice::kMaxLevel;)
      if (gone_.contains(up = up.parent())) out.push_back(up);
    return out;
  }

 private:
  const std::set<lattice::LeafAddress>& gone_;
  std::unordered_map<lattice::LeafAddress, std::vector<lattice::LeafAddress>, lattice::LeafAddressHash> below_;
};

using Shades = std::vector<terrain::Shade>;

terrain::Shade shadeAt(std::span<const std::uint8_t> bytes, std::size_t k) {
  const std::uint8_t* b = &bytes[k * terrain::kShadeBytes];
  return {static_cast<std::int8_t>(b[0]), static_cast<std::int8_t>(b[1]), b[2], b[3], b[4]};
}

// What vertices of the leaves that a delta starts from look like, by whole position.
using KnownShades = std::map<lattice::Vertex, terrain::Shade>;
void collect(const HeldLeaf& leaf, KnownShades& known) {
  if (!leaf.shades) return;
  for (std::size_t k = 0; k < leaf.shades->size(); ++k) {
    const mesh::LocalVertex& v = leaf.mesh->vertices[k];
    known.emplace(lattice::Vertex{leaf.mesh->address.x() + v.x, leaf.mesh->address.z() + v.z, v.y}, (*leaf.shades)[k]);
  }
}

// Shades of a leaf's vertices: those of the base by position, the others in order from the bytes. Null: the bytes are too few or too many.
std::shared_ptr<const Shades> shadesOf(const mesh::LeafMesh& leaf, const mesh::LeafMesh* base, const KnownShades& known,
                                       std::span<const std::uint8_t> bytes) {
  auto out = std::make_shared<Shades>();
  out->reserve(leaf.vertices.size());
  std::size_t taken = 0;
  auto old = base ? base->vertices.begin() : leaf.vertices.end();
  const auto end = base ? base->vertices.end() : leaf.vertices.end();
  for (const mesh::LocalVertex& v : leaf.vertices) {
    while (old != end && (old->x < v.x || (old->x == v.x && old->z < v.z))) ++old;
    if (old != end && *old == v) {
      const auto it = known.find({leaf.address.x() + v.x, leaf.address.z() + v.z, v.y});
      out->push_back(it == known.end() ? terrain::Shade{} : it->second);
    } else {
      if ((taken + 1) * terrain::kShadeBytes > bytes.size()) return nullptr;
      out->push_back(shadeAt(bytes, taken++));
    }
  }
  return taken * terrain::kShadeBytes == bytes.size() ? out : nullptr;
}

// Does `work` for each k below `count`: on a few threads of its own when there is much to do, as the bytes of all of it say.
template <class Work>
void spread(std::size_t count, std::size_t bytes, const Work& work) {
  constexpr std::size_t kWorthAThread = 8 << 10, kMostThreads = 4;
  std::atomic<std::size_t> next{0};
  const auto some = [&] {
    for (std::size_t k = next++; k < count; k = next++) work(k);
  };
  std::vector<std::future<void>> others(
      std::min({bytes / kWorthAThread, kMostThreads - 1, std::size_t{std::max(1u, std::thread::hardware_concurrency())} - 1}));
  for (auto& other : others) other = std::async(std::launch::async, some);
  some();
  for (auto& other : others) other.get();
}

// Twice the area of (a, b, p), positive when p lies to the left of a -> b seen from above. Coordinates below 2^29: exact.
std::int64_t side(const mesh::LocalVertex& a, const mesh::LocalVertex& b, std::int64_t x, std::int64_t z) {
  return (std::int64_t{b.z} - a.z) * (x - a.x) - (std::int64_t{b.x} - a.x) * (z - a.z);
}

}  // namespace

Outcome<void> Scene::apply(const wire::Iteration& iteration) {
  auto prepared = prepare(iteration);
  if (!prepared) return prepared.error();
  take(std::move(*prepared));
  return {};
}

Outcome<Scene::Prepared> Scene::prepare(const wire::Iteration& iteration) const {
  const std::string name = "iteration " + std::to_string(iteration.number) + ": ";
  if (iteration.number == 0 || (iteration_ != 0 && iteration.number != iteration_ + 1))
    return Error{name + "out of order, " + std::to_string(iteration_ + 1) + " was expected"};

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

  // What each delta starts from: the leaf that is held, or the triangles of leaves that are gone.
  std::uint64_t announced = triangles;
  std::map<lattice::LeafAddress, HeldLeaf> fresh;
  const auto expect = [&](const lattice::LeafAddress& address) -> Outcome<const HeldLeaf*> {
    if (!lattice::addressIsValid(address)) return Error{name + nameOf(address) + " lies beyond the lattice"};
    if (!fresh.emplace(address, HeldLeaf{}).second) return Error{name + nameOf(address) + " is there twice"};
    const auto held = leaves_.find(address);
    if (held == leaves_.end() || gone.contains(address)) return static_cast<const HeldLeaf*>(nullptr);
    subtract(address, held->second);
    announced -= held->second.mesh->triangles.size();
    return &held->second;
  };
  for (const wire::LeafWhole& whole : iteration.whole) {
    announced += whole.triangles;
    if (auto held = expect(whole.address); !held) return held.error();
  }
  struct Base {
    std::shared_ptr<const mesh::LeafMesh> mesh;
    std::uint64_t hash = 0;
    std::vector<const HeldLeaf*> leaves;  // that it consists of
  };
  std::vector<Base> bases;
  bases.reserve(iteration.changed.size());
  Families families(gone);
  std::uint64_t looked = 0;
  for (const wire::LeafDelta& delta : iteration.changed) {
    const auto held = expect(delta.address);
    if (!held) return held.error();
    Base base;
    if (*held) {
      base = {(*held)->mesh, (*held)->hash, {*held}};
    } else {
      std::vector<const mesh::LeafMesh*> sources;
      for (const lattice::LeafAddress& address : families.of(delta.address)) {
        base.leaves.push_back(&leaves_.at(address));
        sources.push_back(base.leaves.back()->mesh.get());
        looked += sources.back()->triangles.size();
      }
      if (looked > kMaxGathered) return Error{name + "too much would have to be gathered from leaves that are gone"};
      mesh::LeafMesh gathered = mesh::gather(delta.address, sources);
      if (!mesh::isCanonical(gathered)) return Error{name + nameOf(delta.address) + " begins with leaves that overlap"};
      base.hash = mesh::hashLeaf(gathered);
      base.mesh = std::make_shared<const mesh::LeafMesh>(std::move(gathered));
    }
    announced += base.mesh->triangles.size();
    if (const auto counts = codec::deltaCounts(delta.payload, base.mesh->triangles.size()))
      announced = announced + counts->added - counts->removed;
    bases.push_back(std::move(base));
    if (announced > kMaxTriangles) break;
  }
  count += fresh.size();
  if (announced > kMaxTriangles)
    return Error{name + "the mesh would have " + std::to_string(announced) + " triangles, at most " + std::to_string(kMaxTriangles) +
                 " are held"};
  if (count > kMaxLeaves)
    return Error{name + "the mesh would have " + std::to_string(count) + " leaves, at most " + std::to_string(kMaxLeaves) + " are held"};

  std::set<lattice::LeafAddress> damaged;
  const auto keep = [&](const lattice::LeafAddress& address, HeldLeaf&& leaf) {
    hash += mesh::hashTerm(address, leaf.hash);
    triangles += leaf.mesh->triangles.size();
    fresh[address] = std::move(leaf);
  };
  struct Decoded {
    HeldLeaf leaf;
    std::optional<Error> error;
    bool damaged = false;
  };
  const auto decodeWhole = [&](const wire::LeafWhole& whole) -> Decoded {
    Outcome<mesh::LeafMesh> mesh = codec::decodeLeaf(whole.payload, whole.address, whole.vertices, whole.triangles);
    if (!mesh) return {{}, Error{name + nameOf(whole.address) + ": " + mesh.error().message}};
    const std::uint64_t leafHash = mesh::hashLeaf(*mesh);
    HeldLeaf leaf = hold(std::move(*mesh), leafHash, whole.error);
    if (shaded_ && !(leaf.shades = shadesOf(*leaf.mesh, nullptr, {}, whole.shades)))
      return {{}, Error{name + nameOf(whole.address) + ": its shades are not those of its vertices"}};
    return {std::move(leaf), {}};
  };
  const auto decodeDelta = [&](const wire::LeafDelta& delta, const Base& base) -> Decoded {
    auto changed = codec::decodeDelta(delta.payload, *base.mesh, base.hash);
    HeldLeaf leaf = changed ? hold(std::move(changed->leaf), changed->hash, delta.error) : hold(mesh::LeafMesh(*base.mesh), base.hash, 0);
    if (shaded_) {
      KnownShades known;
      for (const HeldLeaf* source : base.leaves) collect(*source, known);
      const std::span<const std::uint8_t> bytes = changed ? std::span<const std::uint8_t>(delta.shades) : std::span<const std::uint8_t>();
      if (!(leaf.shades = shadesOf(*leaf.mesh, base.mesh.get(), known, bytes)))
        return {{}, Error{name + nameOf(delta.address) + ": its shades are not those of its vertices"}};
    }
    return {std::move(leaf), {}, !changed};
  };
  std::size_t bytes = 0;
  for (const wire::LeafWhole& whole : iteration.whole) bytes += whole.payload.size();
  for (const wire::LeafDelta& delta : iteration.changed) bytes += delta.payload.size();
  const std::size_t wholes = iteration.whole.size();
  std::vector<Decoded> decoded(wholes + iteration.changed.size());
  spread(decoded.size(), bytes, [&](std::size_t k) {
    decoded[k] = k < wholes ? decodeWhole(iteration.whole[k]) : decodeDelta(iteration.changed[k - wholes], bases[k - wholes]);
  });
  for (std::size_t k = 0; k < decoded.size(); ++k) {
    if (decoded[k].error) return *decoded[k].error;
    const lattice::LeafAddress& address = k < wholes ? iteration.whole[k].address : iteration.changed[k - wholes].address;
    if (decoded[k].damaged) damaged.insert(address);
    keep(address, std::move(decoded[k].leaf));
  }

  return Prepared{iteration.number, hash, triangles, std::move(gone), std::move(damaged), std::move(fresh)};
}

void Scene::take(Prepared&& prepared) {
  ++version_;
  for (const lattice::LeafAddress& address : prepared.gone) leaves_.erase(address);
  for (auto& [address, leaf] : prepared.fresh) {
    leaf.version = version_;
    leaves_[address] = std::move(leaf);
    if (prepared.damaged.contains(address) ? damaged_.insert(address).second : (damaged_.erase(address), false)) untold_.insert(address);
  }
  std::erase_if(damaged_, [&](const lattice::LeafAddress& address) { return !leaves_.contains(address); });
  hash_ = prepared.hash;
  triangles_ = prepared.triangles;
  iteration_ = prepared.number;
}

std::vector<lattice::LeafAddress> Scene::takeDamaged() {
  std::vector<lattice::LeafAddress> out(untold_.begin(), untold_.end());
  untold_.clear();
  return out;
}

void Scene::reconnect() {
  iteration_ = 0;
  damaged_.clear();
  untold_.clear();
}

std::vector<wire::HeldLeaf> Scene::held() const {
  std::vector<wire::HeldLeaf> out;
  if (leaves_.size() > wire::kMaxResumed) return out;
  out.reserve(leaves_.size());
  for (const auto& [address, leaf] : leaves_) out.push_back({address, leaf.hash});
  return out;
}

void Scene::clear() {
  leaves_.clear();
  damaged_.clear();
  untold_.clear();
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
