// A leaf's payload (first byte even): refused, or a sound leaf that is encoded and decoded again. Or points (odd) over a leaf and what it
// becomes, twice: refused, or sound leaves with the hashes that they say.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "client/core/mesh/point_mesh.h"
#include "common/codec/codec.h"
#include "tests/support/leaf_meshes.h"

namespace {

using namespace ridgecast;

void require(bool ok) {
  if (!ok) std::abort();
}

void checkSound(const mesh::LeafMesh& leaf) {
  require(mesh::isCanonical(leaf));
  for (const mesh::Triangle& t : leaf.triangles)
    require(support::doubledArea(leaf.vertices[t[0]], leaf.vertices[t[1]], leaf.vertices[t[2]]) > 0);
  for (const mesh::LocalVertex& v : leaf.vertices) {
    require(std::max(std::abs(v.x), std::abs(v.z)) <= codec::kMaxOffset);
    require(std::abs(v.y) <= lattice::kMaxHeight);
  }
}

const std::vector<mesh::LeafMesh>& bases() {
  static const std::vector<mesh::LeafMesh> all = [] {
    support::Random random(1);
    std::vector<mesh::LeafMesh> out{{.address = {2, 1, 1}, .vertices = {}, .triangles = {}}};
    for (int n : {1, 2, 4, 8}) out.push_back(support::terrainLike(random, n, n % 3));
    out.push_back(support::torn(random, support::terrainLike(random, 6, 1), 0.4));
    out.push_back(support::randomTin(random, 30));
    return out;
  }();
  return all;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 4) return 0;
  const bool isPoints = data[0] & 1;
  const mesh::LeafMesh& base = bases()[static_cast<std::size_t>(data[0] >> 1) % bases().size()];
  const std::uint32_t vertices = data[1], triangles = data[2];
  const std::vector<std::uint8_t> bytes(data + 3, data + size);  // a fresh allocation
  if (!isPoints) {
    const auto leaf = codec::decodeLeaf(bytes, {1, -2, 3}, vertices, triangles);
    if (!leaf) return 0;
    checkSound(*leaf);
    const auto again = codec::encodeLeaf(*leaf);
    const auto back = codec::decodeLeaf(again, leaf->address, vertices, triangles);
    require(back && *back == *leaf);
    return 0;
  }
  static core::PointMesh points(false);
  const core::PointMesh::Held held{&base, nullptr};
  if (!points.begin({&held, 1})) return 0;
  // The leaf stays, splits, merges, goes, or has a neighbour, as the input wants; a second payload may follow the first.
  const lattice::LeafAddress a = base.address, beside{a.level, a.i + 1, a.j};
  std::vector<lattice::LeafAddress> gone, come;
  if (vertices & 1) gone.push_back(a);
  if (vertices & 2) come.push_back(beside);
  if (vertices & 4 && a.level > 0)
    for (int q = 0; q < 4; ++q) come.push_back(a.child(q));
  if (vertices & 8 && a.level < lattice::kMaxLevel) come.push_back(a.parent());
  const std::size_t cut = std::min<std::size_t>(triangles, bytes.size());
  const std::span<const std::uint8_t> all(bytes);
  if (!points.follow({gone, come, all.first(cut), {}})) return 0;
  if (!points.follow({{}, {}, all.subspan(cut), {}})) return 0;
  for (const core::PointMesh::Changed& changed : points.takeChanged()) {
    mesh::LeafMesh leaf = points.extract(changed.leaf).mesh;
    require(leaf.triangles.size() == changed.triangles);
    for (const mesh::Triangle& t : leaf.triangles)
      require(support::doubledArea(leaf.vertices[t[0]], leaf.vertices[t[1]], leaf.vertices[t[2]]) > 0);
    mesh::canonicalize(leaf);
    require(mesh::isCanonical(leaf) && mesh::hashLeaf(leaf) == changed.hash);
  }
  return 0;
}
