#include "common/mesh/leaf_mesh.h"

#include <algorithm>
#include <numeric>
#include <tuple>

namespace ridgecast::mesh {
namespace {

Triangle rotated(Triangle t) {
  if (t[1] < t[0] && t[1] < t[2]) return {t[1], t[2], t[0]};
  if (t[2] < t[0] && t[2] < t[1]) return {t[2], t[0], t[1]};
  return t;
}

}  // namespace

std::uint64_t hashVertex(const lattice::Vertex& v) {
  using lattice::mix;
  return mix(static_cast<std::uint64_t>(v.x) + mix(static_cast<std::uint64_t>(v.z) + mix(static_cast<std::uint64_t>(std::int64_t{v.y}))));
}

void canonicalize(LeafMesh& leaf) {
  std::vector<char> used(leaf.vertices.size(), 0);
  for (const Triangle& t : leaf.triangles)
    for (std::uint32_t v : t) used[v] = 1;
  std::vector<std::uint32_t> order;
  order.reserve(leaf.vertices.size());
  for (std::uint32_t v = 0; v < leaf.vertices.size(); ++v)
    if (used[v]) order.push_back(v);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return leaf.vertices[a] < leaf.vertices[b]; });

  std::vector<std::uint32_t> place(leaf.vertices.size(), 0);
  std::vector<LocalVertex> vertices;
  vertices.reserve(order.size());
  for (std::uint32_t v : order) {
    if (vertices.empty() || vertices.back() != leaf.vertices[v]) vertices.push_back(leaf.vertices[v]);
    place[v] = static_cast<std::uint32_t>(vertices.size() - 1);
  }
  leaf.vertices = std::move(vertices);
  for (Triangle& t : leaf.triangles) t = rotated({place[t[0]], place[t[1]], place[t[2]]});
  std::sort(leaf.triangles.begin(), leaf.triangles.end());
}

bool isCanonical(const LeafMesh& leaf) {
  std::vector<char> used(leaf.vertices.size(), 0);
  for (std::size_t k = 0; k < leaf.triangles.size(); ++k) {
    const Triangle& t = leaf.triangles[k];
    for (std::uint32_t v : t) {
      if (v >= leaf.vertices.size()) return false;
      used[v] = 1;
    }
    if (t[0] >= t[1] || t[0] >= t[2] || t[1] == t[2]) return false;
    if (k > 0 && !(leaf.triangles[k - 1] < t)) return false;
  }
  for (std::size_t v = 0; v < leaf.vertices.size(); ++v) {
    if (!used[v]) return false;
    if (v == 0) continue;
    const LocalVertex &a = leaf.vertices[v - 1], &b = leaf.vertices[v];
    if (std::tie(a.x, a.z) >= std::tie(b.x, b.z)) return false;
  }
  return true;
}

std::uint64_t hashTriangle(const lattice::Vertex& a, const lattice::Vertex& b, const lattice::Vertex& c) {
  const lattice::Vertex* v[3] = {&a, &b, &c};
  int first = 0;
  for (int k = 1; k < 3; ++k)
    if (std::tie(v[k]->x, v[k]->z) < std::tie(v[first]->x, v[first]->z)) first = k;
  return hashMixed(hashVertex(*v[first]), hashVertex(*v[(first + 1) % 3]), hashVertex(*v[(first + 2) % 3]));
}

std::uint64_t hashLeaf(const LeafMesh& leaf) {
  const lattice::Step x0 = leaf.address.x(), z0 = leaf.address.z();
  std::uint64_t sum = 0;
  for (const Triangle& t : leaf.triangles) {
    lattice::Vertex v[3];
    for (int k = 0; k < 3; ++k) {
      const LocalVertex& p = leaf.vertices[t[k]];
      v[k] = {x0 + p.x, z0 + p.z, p.y};
    }
    sum += hashTriangle(v[0], v[1], v[2]);
  }
  return sum;
}

std::uint64_t hashTerm(lattice::LeafAddress address, std::uint64_t leafHash) {
  using lattice::mix;
  return mix(leafHash + mix(static_cast<std::uint64_t>(address.level) +
                            mix(static_cast<std::uint64_t>(address.i) + mix(static_cast<std::uint64_t>(address.j)))));
}

}  // namespace ridgecast::mesh
