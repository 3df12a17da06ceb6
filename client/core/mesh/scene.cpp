#include "client/core/mesh/scene.h"

#include <algorithm>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/codec/codec.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::core {
namespace {

std::string nameOf(const lattice::LeafAddress& a) {
  return "leaf (level " + std::to_string(a.level) + ", " + std::to_string(a.i) + ", " + std::to_string(a.j) + ")";
}

void hold(HeldLeaf& leaf, mesh::LeafMesh&& mesh) {
  leaf.triangles = static_cast<std::uint32_t>(mesh.triangles.size());
  leaf.low = leaf.high = {};
  if (!mesh.vertices.empty()) leaf.low = leaf.high = mesh.vertices.front();
  for (const mesh::LocalVertex& v : mesh.vertices) {
    leaf.low = {std::min(leaf.low.x, v.x), std::min(leaf.low.z, v.z), std::min(leaf.low.y, v.y)};
    leaf.high = {std::max(leaf.high.x, v.x), std::max(leaf.high.z, v.z), std::max(leaf.high.y, v.y)};
  }
  leaf.mesh = std::make_shared<const mesh::LeafMesh>(std::move(mesh));
}

HeldLeaf emptyLeaf(const lattice::LeafAddress& address) {
  HeldLeaf leaf;
  hold(leaf, {address, {}, {}});
  return leaf;
}

using Shades = std::vector<terrain::Shade>;

terrain::Shade shadeAt(std::span<const std::uint8_t> bytes, std::size_t k) {
  const std::uint8_t* b = &bytes[k * terrain::kShadeBytes];
  return {static_cast<std::int8_t>(b[0]), static_cast<std::int8_t>(b[1]), b[2], b[3], b[4]};
}

// Shades of a leaf's vertices, in order. Null: the bytes are too few or too many.
std::shared_ptr<const Shades> shadesOf(const mesh::LeafMesh& leaf, std::span<const std::uint8_t> bytes) {
  if (bytes.size() != leaf.vertices.size() * terrain::kShadeBytes) return nullptr;
  auto out = std::make_shared<Shades>();
  out->reserve(leaf.vertices.size());
  for (std::size_t k = 0; k < leaf.vertices.size(); ++k) out->push_back(shadeAt(bytes, k));
  return out;
}

// One iteration on its way into a scene, in four steps: what goes, whether the whole has room, leaves that came whole, and those that
// points make. The scene is only read.
class Preparation {
 public:
  Preparation(const wire::Iteration& iteration, const Scene& scene, PointMesh* points, const Scene::Following& following)
      : iteration_(iteration),
        scene_(scene),
        points_(points),
        following_(following),
        name_("iteration " + std::to_string(iteration.number) + ": ") {
    out_.number = iteration.number;
    out_.hash = scene.hash();
    out_.triangles = scene.triangles();
    out_.lost = scene.lost();
  }

  Outcome<Scene::Prepared> run() {
    for (const auto step : {&Preparation::drop, &Preparation::expect, &Preparation::decode, &Preparation::follow})
      if (const auto done = (this->*step)(); !done) return done.error();
    return std::move(out_);
  }

 private:
  struct Decoded {
    HeldLeaf leaf;
    std::optional<Error> error;
  };

  Error wrong(const lattice::LeafAddress& address, const std::string& why) const { return Error{name_ + nameOf(address) + why}; }
  Error tooMuch(std::uint64_t would, const std::string& what, std::uint64_t most) const {
    return Error{name_ + "the mesh would have " + std::to_string(would) + " " + what + ", at most " + std::to_string(most) + " are held"};
  }

  void subtract(const lattice::LeafAddress& address, const HeldLeaf& leaf) {
    expects(out_.triangles >= leaf.triangles, "a mesh has the triangles of its leaves");
    out_.hash -= mesh::hashTerm(address, leaf.hash);
    out_.triangles -= leaf.triangles;
  }
  void put(const lattice::LeafAddress& address, HeldLeaf&& leaf) {
    out_.hash += mesh::hashTerm(address, leaf.hash);
    out_.triangles += leaf.triangles;
    out_.fresh[address] = std::move(leaf);
  }
  // The leaf that is held and stays; null: there is none.
  const HeldLeaf* held(const lattice::LeafAddress& address) const {
    const auto it = scene_.index().find(address);
    return it == scene_.index().end() || out_.gone.contains(address) ? nullptr : &it->second;
  }

  Outcome<void> drop() {
    if (scene_.dropsAllFor(iteration_)) {
      for (const auto& [address, leaf] : scene_.index()) {
        out_.gone.insert(address);
        subtract(address, leaf);
      }
    }
    for (const lattice::LeafAddress& address : iteration_.gone) {
      const auto leaf = scene_.index().find(address);
      if (leaf == scene_.index().end() && scene_.lost()) continue;
      if (leaf == scene_.index().end()) return wrong(address, " is gone but was not held");
      if (!out_.gone.insert(address).second) return wrong(address, " is gone twice");
      subtract(address, leaf->second);
    }
    return {};
  }

  // What comes has its place, and there is room for it.
  Outcome<void> expect() {
    std::uint64_t announced = out_.triangles;
    std::size_t count = scene_.index().size() - out_.gone.size();
    const auto claim = [&](const lattice::LeafAddress& address) -> Outcome<void> {
      if (!lattice::addressIsValid(address)) return wrong(address, " lies beyond the lattice");
      if (!out_.fresh.emplace(address, HeldLeaf{}).second) return wrong(address, " is there twice");
      return {};
    };
    for (const wire::LeafWhole& whole : iteration_.whole) {
      if (auto claimed = claim(whole.address); !claimed) return claimed;
      announced += whole.triangles;
      if (const HeldLeaf* before = held(whole.address)) {
        announced -= before->triangles;
        subtract(whole.address, *before);
      } else {
        ++count;
      }
    }
    for (const lattice::LeafAddress& address : iteration_.come) {
      if (held(address)) return wrong(address, " comes but was held");
      if (auto claimed = claim(address); !claimed) return claimed;
      ++count;
    }
    if (announced > kMaxTriangles) return tooMuch(announced, "triangles", kMaxTriangles);
    if (count > kMaxLeaves) return tooMuch(count, "leaves", kMaxLeaves);
    return {};
  }

  Outcome<void> decode() {
    std::size_t bytes = 0;
    for (const wire::LeafWhole& whole : iteration_.whole) bytes += whole.payload.size();
    std::vector<Decoded> decoded(iteration_.whole.size());
    following_.spread(decoded.size(), bytes, [&](std::size_t k) { decoded[k] = decode(iteration_.whole[k]); });
    for (Decoded& d : decoded) {
      if (d.error) return *d.error;
      const lattice::LeafAddress address = d.leaf.mesh->address;
      out_.came += d.leaf.triangles;
      put(address, std::move(d.leaf));
    }
    for (const lattice::LeafAddress& address : iteration_.come) put(address, emptyLeaf(address));
    return {};
  }

  Decoded decode(const wire::LeafWhole& whole) const {
    Outcome<mesh::LeafMesh> mesh = codec::decodeLeaf(whole.payload, whole.address, whole.vertices, whole.triangles);
    if (!mesh) return {{}, wrong(whole.address, ": " + mesh.error().message)};
    HeldLeaf leaf;
    leaf.hash = mesh::hashLeaf(*mesh);
    leaf.error = whole.error;
    hold(leaf, std::move(*mesh));
    if (following_.shades) leaf.shades = shadesOf(*leaf.mesh, whole.shades);
    if (following_.shades && !leaf.shades) return {{}, wrong(whole.address, ": its shades are not those of its vertices")};
    return {std::move(leaf), {}};
  }

  // Points that do not fit leave the mesh as it is, to be requested again. A server that does not know them sends none.
  Outcome<void> follow() {
    if (!points_ || iteration_.points.empty()) return {};
    const bool anew = iteration_.number == 1 || !iteration_.whole.empty();
    if (anew) out_.lost = !begin();
    if (out_.lost) return lose();
    const std::vector<lattice::LeafAddress> none;
    out_.lost = !points_->follow({anew ? none : iteration_.gone, iteration_.come, iteration_.points, iteration_.shades});
    if (out_.lost) return lose();
    auto error = iteration_.errors.begin();
    out_.changed = points_->takeChanged();
    for (const PointMesh::Changed& changed : out_.changed) {
      const auto come = out_.fresh.find(changed.leaf);
      const bool isWhole = come != out_.fresh.end() && come->second.triangles != 0;
      if (isWhole) continue;
      const HeldLeaf* const before = come != out_.fresh.end() ? &come->second : held(changed.leaf);
      if (!before || (changed.hash == before->hash && come == out_.fresh.end())) continue;
      out_.came += changed.triangles - std::min(changed.triangles, before->triangles);
      subtract(changed.leaf, *before);
      HeldLeaf leaf;
      leaf.low = changed.low, leaf.high = changed.high;
      leaf.triangles = changed.triangles;
      leaf.hash = changed.hash;
      leaf.error = error == iteration_.errors.end() ? 0 : *error++;
      put(changed.leaf, std::move(leaf));
    }
    out_.lost = out_.triangles > kMaxTriangles;
    return lose();
  }

  // What was not made of points that were followed before cannot be made any more.
  Outcome<void> lose() {
    if (!out_.lost) return {};
    out_.changed.clear();
    const auto empty = [this](const lattice::LeafAddress& address, const HeldLeaf& leaf) {
      if (leaf.mesh) return;
      subtract(address, leaf);
      put(address, emptyLeaf(address));
    };
    for (const auto& [address, leaf] : out_.fresh) empty(address, leaf);
    for (const auto& [address, leaf] : scene_.index())
      if (held(address) && !out_.fresh.contains(address)) empty(address, leaf);
    return {};
  }

  // The points are those of the leaves that are held before others come by points.
  bool begin() {
    std::vector<PointMesh::Held> leaves;
    for (const auto& [address, leaf] : scene_.leaves())
      if (!out_.gone.contains(address) && !out_.fresh.contains(address)) leaves.push_back({leaf.mesh.get(), leaf.shades.get()});
    for (const wire::LeafWhole& whole : iteration_.whole) {
      const HeldLeaf& leaf = out_.fresh.at(whole.address);
      leaves.push_back({leaf.mesh.get(), leaf.shades.get()});
    }
    return points_->begin(leaves);
  }

  const wire::Iteration& iteration_;
  const Scene& scene_;
  PointMesh* const points_;  // null: this client does not follow points
  const Scene::Following& following_;
  const std::string name_;
  Scene::Prepared out_;
};

// Twice the area of (a, b, p), positive when p lies to the left of a -> b seen from above. Coordinates below 2^29: exact.
std::int64_t side(const mesh::LocalVertex& a, const mesh::LocalVertex& b, std::int64_t x, std::int64_t z) {
  return (std::int64_t{b.z} - a.z) * (x - a.x) - (std::int64_t{b.x} - a.x) * (z - a.z);
}

}  // namespace

void Scene::inOrder(std::size_t count, std::size_t, const std::function<void(std::size_t)>& work) {
  for (std::size_t k = 0; k < count; ++k) work(k);
}

Outcome<void> Scene::apply(const wire::Iteration& iteration) {
  auto prepared = decode(iteration);
  if (!prepared) return prepared.error();
  take(std::move(*prepared));
  return {};
}

Outcome<Scene::Prepared> Scene::prepare(const wire::Iteration& iteration) {
  auto prepared = decode(iteration);
  if (prepared)
    for (auto& [address, leaf] : prepared->fresh) make(leaf, address);
  return prepared;
}

Outcome<Scene::Prepared> Scene::decode(const wire::Iteration& iteration) {
  if (iteration.number == 0 || (iteration_ != 0 && iteration.number != iteration_ + 1))
    return Error{"iteration " + std::to_string(iteration.number) + ": out of order, " + std::to_string(iteration_ + 1) + " was expected"};
  if (following_.points && !points_) points_ = std::make_unique<PointMesh>(following_.shades, following_.triangles);
  return Preparation(iteration, *this, points_.get(), following_).run();
}

void Scene::make(HeldLeaf& leaf, const lattice::LeafAddress& address) const {
  if (leaf.mesh) return;
  expects(points_ != nullptr, "a leaf without a mesh is made of points");
  PointMesh::Leaf made = points_->extract(address);
  hold(leaf, std::move(made.mesh));
  if (following_.shades) leaf.shades = std::make_shared<const Shades>(std::move(made.shades));
}

const Leaves& Scene::leaves() const {
  if (!std::exchange(made_, true))
    for (auto& [address, leaf] : leaves_) make(leaf, address);
  return leaves_;
}

const HeldLeaf* Scene::leaf(const lattice::LeafAddress& address) const {
  const auto it = leaves_.find(address);
  if (it == leaves_.end()) return nullptr;
  make(it->second, address);
  return &it->second;
}

void Scene::take(Prepared&& prepared) {
  expects(iteration_ == 0 || prepared.number == iteration_ + 1, "what is taken was prepared for this scene");
  ++version_;
  unnamed_ = false;
  gone_ = std::move(prepared.gone);
  for (const lattice::LeafAddress& address : gone_) leaves_.erase(address);
  for (auto& [address, leaf] : prepared.fresh) {
    leaf.version = version_;
    made_ = made_ && leaf.mesh;
    leaves_[address] = std::move(leaf);
  }
  hash_ = prepared.hash;
  triangles_ = prepared.triangles;
  iteration_ = prepared.number;
  changed_ = std::move(prepared.changed);
  came_ = prepared.came;
  lost_ = prepared.lost;
}

void Scene::draw(PointMesh::Drawing& to) const {
  to = {};
  if (changed_.empty()) return;
  expects(points_ != nullptr, "what points have changed is drawn of points");
  points_->draw(changed_, to);
}

void Scene::follow(const Following& what) {
  leaves();  // of the points that go
  following_ = what;
  points_.reset();
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
  changed_.clear();
  came_ = 0;
  hash_ = triangles_ = iteration_ = 0;
  lost_ = true;
  unnamed_ = false;
  gone_.clear();
}

std::optional<Scene::Place> Scene::locate(lattice::Point at) const {
  for (auto& [address, leaf] : leaves_) {
    const std::int64_t x = at.x - address.x(), z = at.z - address.z();
    if (x < leaf.low.x || x > leaf.high.x || z < leaf.low.z || z > leaf.high.z) continue;
    make(leaf, address);
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

}  // namespace ridgecast::core
