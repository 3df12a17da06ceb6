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
#include "common/mesh/leaf_mesh.h"
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

// One iteration on its way into a scene, in four steps: what goes, what each changed leaf starts from, whether the whole has room, and the
// leaves themselves. The scene is only read.
class Preparation {
 public:
  Preparation(const wire::Iteration& iteration, const Leaves& held, std::uint64_t hash, std::uint64_t triangles, bool shaded)
      : iteration_(iteration),
        held_(held),
        shaded_(shaded),
        name_("iteration " + std::to_string(iteration.number) + ": "),
        out_{iteration.number, hash, triangles, {}, {}, {}},
        count_(held.size()) {}

  Outcome<Scene::Prepared> run() {
    for (const auto step : {&Preparation::drop, &Preparation::findBases, &Preparation::judgeSize, &Preparation::decode})
      if (const auto done = (this->*step)(); !done) return done.error();
    return std::move(out_);
  }

 private:
  // What a delta starts from: the leaf that is held, or the triangles of leaves that are gone.
  struct Base {
    std::shared_ptr<const mesh::LeafMesh> mesh;
    std::uint64_t hash = 0;
    std::vector<const HeldLeaf*> leaves;  // that it consists of
  };
  struct Decoded {
    HeldLeaf leaf;
    std::optional<Error> error;
    bool damaged = false;
  };

  Error wrong(const lattice::LeafAddress& address, const std::string& why) const { return Error{name_ + nameOf(address) + why}; }

  void subtract(const lattice::LeafAddress& address, const HeldLeaf& leaf) {
    out_.hash -= mesh::hashTerm(address, leaf.hash);
    out_.triangles -= leaf.mesh->triangles.size();
    --count_;
  }

  Outcome<void> drop() {
    for (const lattice::LeafAddress& address : iteration_.gone) {
      const auto held = held_.find(address);
      if (held == held_.end()) return wrong(address, " is gone but was not held");
      if (!out_.gone.insert(address).second) return wrong(address, " is gone twice");
      subtract(address, held->second);
    }
    announced_ = out_.triangles;
    return {};
  }

  // Notes a leaf that comes; the one that is held in its place, if any.
  Outcome<const HeldLeaf*> expect(const lattice::LeafAddress& address) {
    if (!lattice::addressIsValid(address)) return wrong(address, " lies beyond the lattice");
    if (!out_.fresh.emplace(address, HeldLeaf{}).second) return wrong(address, " is there twice");
    const auto held = held_.find(address);
    if (held == held_.end() || out_.gone.contains(address)) return static_cast<const HeldLeaf*>(nullptr);
    subtract(address, held->second);
    announced_ -= held->second.mesh->triangles.size();
    return &held->second;
  }

  Outcome<void> findBases() {
    for (const wire::LeafWhole& whole : iteration_.whole) {
      announced_ += whole.triangles;
      if (auto held = expect(whole.address); !held) return held.error();
    }
    bases_.reserve(iteration_.changed.size());
    Families families(out_.gone);
    for (const wire::LeafDelta& delta : iteration_.changed) {
      const auto held = expect(delta.address);
      if (!held) return held.error();
      auto base = *held ? Base{(*held)->mesh, (*held)->hash, {*held}} : gather(delta.address, families);
      if (!base) return base.error();
      announced_ += base->mesh->triangles.size();
      if (const auto counts = codec::deltaCounts(delta.payload, base->mesh->triangles.size()))
        announced_ = announced_ + counts->added - counts->removed;
      bases_.push_back(std::move(*base));
      if (announced_ > kMaxTriangles) break;
    }
    return {};
  }

  Outcome<Base> gather(const lattice::LeafAddress& address, Families& families) {
    Base base;
    std::vector<const mesh::LeafMesh*> sources;
    for (const lattice::LeafAddress& source : families.of(address)) {
      base.leaves.push_back(&held_.at(source));
      sources.push_back(base.leaves.back()->mesh.get());
      searched_ += sources.back()->triangles.size();
    }
    if (searched_ > kMaxGathered) return Error{name_ + "too much would have to be gathered from leaves that are gone"};
    mesh::LeafMesh gathered = mesh::gather(address, sources);
    if (!mesh::isCanonical(gathered)) return wrong(address, " begins with leaves that overlap");
    base.hash = mesh::hashLeaf(gathered);
    base.mesh = std::make_shared<const mesh::LeafMesh>(std::move(gathered));
    return base;
  }

  Outcome<void> judgeSize() {
    const auto tooMuch = [&](std::uint64_t would, const std::string& what, std::uint64_t most) {
      return Error{name_ + "the mesh would have " + std::to_string(would) + " " + what + ", at most " + std::to_string(most) + " are held"};
    };
    count_ += out_.fresh.size();
    if (announced_ > kMaxTriangles) return tooMuch(announced_, "triangles", kMaxTriangles);
    if (count_ > kMaxLeaves) return tooMuch(count_, "leaves", kMaxLeaves);
    return {};
  }

  Outcome<void> decode() {
    std::size_t bytes = 0;
    for (const wire::LeafWhole& whole : iteration_.whole) bytes += whole.payload.size();
    for (const wire::LeafDelta& delta : iteration_.changed) bytes += delta.payload.size();
    const std::size_t wholes = iteration_.whole.size();
    std::vector<Decoded> decoded(wholes + iteration_.changed.size());
    spread(decoded.size(), bytes, [&](std::size_t k) {
      decoded[k] = k < wholes ? decodeWhole(iteration_.whole[k]) : decodeDelta(iteration_.changed[k - wholes], bases_[k - wholes]);
    });
    for (std::size_t k = 0; k < decoded.size(); ++k) {
      if (decoded[k].error) return *decoded[k].error;
      HeldLeaf& leaf = decoded[k].leaf;
      const lattice::LeafAddress& address = leaf.mesh->address;
      if (decoded[k].damaged) out_.damaged.insert(address);
      out_.hash += mesh::hashTerm(address, leaf.hash);
      out_.triangles += leaf.mesh->triangles.size();
      out_.fresh[address] = std::move(leaf);
    }
    return {};
  }

  Decoded decodeWhole(const wire::LeafWhole& whole) const {
    Outcome<mesh::LeafMesh> mesh = codec::decodeLeaf(whole.payload, whole.address, whole.vertices, whole.triangles);
    if (!mesh) return {{}, wrong(whole.address, ": " + mesh.error().message)};
    const std::uint64_t hash = mesh::hashLeaf(*mesh);
    HeldLeaf leaf = hold(std::move(*mesh), hash, whole.error);
    if (shaded_ && !(leaf.shades = shadesOf(*leaf.mesh, nullptr, {}, whole.shades)))
      return {{}, wrong(whole.address, ": its shades are not those of its vertices")};
    return {std::move(leaf), {}};
  }

  Decoded decodeDelta(const wire::LeafDelta& delta, const Base& base) const {
    auto changed = codec::decodeDelta(delta.payload, *base.mesh, base.hash);
    HeldLeaf leaf = changed ? hold(std::move(changed->leaf), changed->hash, delta.error) : hold(mesh::LeafMesh(*base.mesh), base.hash, 0);
    if (shaded_) {
      KnownShades known;
      for (const HeldLeaf* source : base.leaves) collect(*source, known);
      const std::span<const std::uint8_t> bytes = changed ? std::span<const std::uint8_t>(delta.shades) : std::span<const std::uint8_t>();
      if (!(leaf.shades = shadesOf(*leaf.mesh, base.mesh.get(), known, bytes)))
        return {{}, wrong(delta.address, ": its shades are not those of its vertices")};
    }
    return {std::move(leaf), {}, !changed};
  }

  const wire::Iteration& iteration_;
  const Leaves& held_;
  const bool shaded_;
  const std::string name_;
  Scene::Prepared out_;
  std::size_t count_;                           // of leaves, afterwards
  std::uint64_t announced_ = 0, searched_ = 0;  // triangles: afterwards, as the messages say; of leaves that are gone
  std::vector<Base> bases_;                     // of the changed leaves
};

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
  if (iteration.number == 0 || (iteration_ != 0 && iteration.number != iteration_ + 1))
    return Error{"iteration " + std::to_string(iteration.number) + ": out of order, " + std::to_string(iteration_ + 1) + " was expected"};
  return Preparation(iteration, leaves_, hash_, triangles_, shaded_).run();
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

std::optional<Scene::Place> Scene::locate(lattice::Point at) const {
  for (const auto& [address, leaf] : leaves_) {
    const std::int64_t x = at.x - address.x(), z = at.z - address.z();
    if (x < leaf.low.x || x > leaf.high.x || z < leaf.low.z || z > leaf.high.z) continue;
    for (const mesh::Triangle& t : leaf.mesh->triangles) {
      const mesh::LocalVertex &a = leaf.mesh->vertices[t[0]], &b = leaf.mesh->vertices[t[1]], &c = leaf.mesh->vertices[t[2]];
      const std::int64_t wa = side(b, c, x, z), wb = side(c, a, x, z), wc = side(a, b, x, z);
      if (wa < 0 || wb < 0 || wc < 0) continue;
      const double total = static_cast<double>(wa + wb + wc);
      const double steps = (static_cast<double>(wa) * a.y + static_cast<double>(wb) * b.y + static_cast<double>(wc) * c.y) / total;
      return Place{&leaf, {a, b, c}, steps * lattice::kMetresPerStep};
    }
  }
  return std::nullopt;
}

std::optional<double> Scene::height(lattice::Point at) const {
  const auto place = locate(at);
  return place ? std::optional(place->height) : std::nullopt;
}

}  // namespace ridgecast::scene
