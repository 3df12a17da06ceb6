#include "server/encoding/encoder.h"

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/shades.h"
#include "server/query/query.h"

namespace ridgecast::encoding {

namespace {

// A delta with at most this many bytes a triangle is shorter than a whole leaf of more than a few triangles, so it needs no comparison.
constexpr std::size_t kSurelyCheaper = 1;
// A leaf is derived from others that have at most this many triangles for each of its own: the receiver reads them all.
constexpr std::size_t kMostGathered = 16;

}  // namespace

struct Encoder::Encoded {
  mesh::LeafMesh leaf;
  std::vector<std::uint8_t> payload, shades;
  bool delta = false;
  float error = 0;
};

Encoder::Encoder(std::shared_ptr<const terrain::Terrain> terrain, std::shared_ptr<scheduling::Pool> pool, Form form,
                 std::uint32_t triangleBudget)
    : terrain_(std::move(terrain)), pool_(std::move(pool)), form_(form) {
  setTriangleBudget(triangleBudget);
}

void Encoder::setTriangleBudget(std::uint32_t triangles) {
  if (form_.deltas) bases_.setBudget(kBaseBytesPerTriangle * triangles);
}

// The shades of the leaf's vertices, in order, that the base lacks (by position); of all vertices if there is no base.
std::vector<std::uint8_t> Encoder::shadesOf(const mesh::LeafMesh& leaf, const mesh::LeafMesh* base) const {
  if (!form_.shades) return {};
  std::vector<lattice::Step> x, z;
  auto old = base ? base->vertices.begin() : leaf.vertices.end();
  const auto end = base ? base->vertices.end() : leaf.vertices.end();
  for (const mesh::LocalVertex& v : leaf.vertices) {  // both ascend by x, then z
    while (old != end && (old->x < v.x || (old->x == v.x && old->z < v.z))) ++old;
    if (old != end && *old == v) continue;
    x.push_back(leaf.address.x() + v.x);
    z.push_back(leaf.address.z() + v.z);
  }
  std::vector<terrain::Shade> shades(x.size());
  terrain::shadesAt(*terrain_, x, z, leaf.address.level, shades);
  std::vector<std::uint8_t> out;
  out.reserve(shades.size() * terrain::kShadeBytes);
  for (const terrain::Shade& s : shades)
    out.insert(out.end(), {static_cast<std::uint8_t>(s.normalX), static_cast<std::uint8_t>(s.normalZ), s.red, s.green, s.blue});
  return out;
}

// Null: not all of it is known, or it is too large. Valid until the same thread calls again.
const mesh::LeafMesh* Encoder::baseOf(const replica::Changes& changes, const replica::Derived& derived, std::size_t triangles) const {
  const auto sources = std::span(changes.sources).subspan(derived.first, derived.count);
  thread_local mesh::LeafMesh base;
  if (sources.size() == 1 && sources.front() == derived.address) return bases_.find(derived.address, base) ? &base : nullptr;
  std::size_t looked = 0;
  for (const lattice::LeafAddress& source : sources) looked += bases_.triangles(source);
  if (looked > kMostGathered * triangles) return nullptr;
  std::vector<mesh::LeafMesh> meshes(sources.size());
  std::vector<const mesh::LeafMesh*> pointers;
  for (std::size_t k = 0; k < sources.size(); ++k) {
    if (!bases_.find(sources[k], meshes[k])) return nullptr;
    pointers.push_back(&meshes[k]);
  }
  base = mesh::gather(derived.address, pointers);
  return &base;
}

// `derived`: null if the leaf must be sent whole.
Encoder::Encoded Encoder::encode(const replica::Changes& changes, const replica::Derived* derived, mesh::LeafMesh leaf) const {
  Encoded out{std::move(leaf), {}, {}, false, 0};
  if (form_.errors) out.error = query::deviation(*terrain_, out.leaf);
  if (derived && !out.leaf.triangles.empty()) {
    const mesh::LeafMesh* const base = baseOf(changes, *derived, out.leaf.triangles.size());
    if (base && !base->triangles.empty()) {
      if (auto payload = codec::encodeDelta(*base, out.leaf, derived->hash)) {
        out.payload = std::move(*payload);
        out.delta = true;
        out.shades = shadesOf(out.leaf, base);
        if (out.payload.size() <= kSurelyCheaper * out.leaf.triangles.size()) return out;
      }
    }
  }
  auto payload = codec::encodeLeaf(out.leaf);
  if (out.delta && out.payload.size() <= payload.size()) return out;
  out.payload = std::move(payload);
  out.delta = false;
  out.shades = shadesOf(out.leaf, nullptr);
  return out;
}

void Encoder::encode(replica::Changes changes, const Extract& extract, wire::Iteration& iteration) {
  const std::size_t whole = changes.whole.size();
  std::vector<Encoded> encoded(whole + changes.changed.size());
  pool_->forEach(encoded.size(), 2, [&](std::size_t k) {
    const replica::Derived* derived = k < whole ? nullptr : &changes.changed[k - whole];
    encoded[k] = encode(changes, derived, extract(derived ? derived->address : changes.whole[k]));
  });
  for (const lattice::LeafAddress& address : changes.gone) bases_.erase(address);
  for (Encoded& e : encoded) {
    if (e.delta)
      iteration.changed.push_back({e.leaf.address, std::move(e.payload), e.error, std::move(e.shades)});
    else
      iteration.whole.push_back({e.leaf.address, static_cast<std::uint32_t>(e.leaf.vertices.size()),
                                 static_cast<std::uint32_t>(e.leaf.triangles.size()), std::move(e.payload), e.error, std::move(e.shades)});
    if (form_.deltas) bases_.put(std::move(e.leaf));
  }
  std::sort(iteration.whole.begin(), iteration.whole.end(), [](const auto& a, const auto& b) { return a.address < b.address; });
  iteration.number = changes.number;
  iteration.meshHash = changes.meshHash;
  iteration.gone = std::move(changes.gone);
}

}  // namespace ridgecast::encoding
