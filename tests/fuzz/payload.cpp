// A leaf's payload (first byte even) or a delta's (odd) over a leaf that the input makes: refused, or a sound leaf; and what was encoded
// comes out again.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
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
  const bool isDelta = data[0] & 1;
  const mesh::LeafMesh& base = bases()[static_cast<std::size_t>(data[0] >> 1) % bases().size()];
  const std::uint32_t vertices = data[1], triangles = data[2];
  const std::vector<std::uint8_t> bytes(data + 3, data + size);  // a fresh allocation
  if (!isDelta) {
    const auto leaf = codec::decodeLeaf(bytes, {1, -2, 3}, vertices, triangles);
    if (!leaf) return 0;
    checkSound(*leaf);
    const auto again = codec::encodeLeaf(*leaf);
    const auto back = codec::decodeLeaf(again, leaf->address, vertices, triangles);
    require(back && *back == *leaf);
    return 0;
  }
  // The check would keep nearly everything out: it is made right, until it is the decoder's own word against another's.
  auto changed = codec::decodeDelta(bytes, base, mesh::hashLeaf(base), {.maxTriangles = 1u << 16});
  if (!changed) return 0;
  checkSound(changed->leaf);
  require(changed->hash == mesh::hashLeaf(changed->leaf));
  const auto again = codec::encodeDelta(base, changed->leaf, changed->hash);
  if (!again) return 0;
  const auto back = codec::decodeDelta(*again, base, mesh::hashLeaf(base));
  require(back && back->leaf == changed->leaf);
  return 0;
}
