#include "common/mesh/leaf_mesh.h"

#include <algorithm>
#include <cstdlib>
#include <tuple>

#include "common/outcome/contract.h"

namespace ridgecast::mesh {

void canonicalize(LeafMesh& leaf) {
  // Static for its memory: a server does this for every leaf that changes.
  struct Placed {
    std::uint64_t key;  // x, then z, as an unsigned number
    std::uint32_t vertex;
  };
  thread_local std::vector<char> used;
  thread_local std::vector<Placed> order;
  thread_local std::vector<std::uint32_t> place, start;
  thread_local std::vector<LocalVertex> vertices;
  thread_local std::vector<Triangle> triangles;

  used.assign(leaf.vertices.size(), 0);
  for (const Triangle& t : leaf.triangles)
    for (std::uint32_t v : t) {
      expects(v < used.size(), "triangles name vertices that are there");
      used[v] = 1;
    }
  order.clear();
  const auto ascending = [](std::int32_t v) { return static_cast<std::uint32_t>(v) ^ 0x80000000u; };
  for (std::uint32_t v = 0; v < leaf.vertices.size(); ++v)
    if (used[v]) order.push_back({std::uint64_t{ascending(leaf.vertices[v].x)} << 32 | ascending(leaf.vertices[v].z), v});
  std::sort(order.begin(), order.end(), [&](const Placed& a, const Placed& b) {
    return a.key != b.key ? a.key < b.key : leaf.vertices[a.vertex].y < leaf.vertices[b.vertex].y;
  });

  place.resize(leaf.vertices.size());
  vertices.clear();
  for (const Placed& p : order) {
    const LocalVertex& v = leaf.vertices[p.vertex];
    if (vertices.empty() || vertices.back() != v) vertices.push_back(v);
    place[p.vertex] = static_cast<std::uint32_t>(vertices.size() - 1);
  }
  leaf.vertices.assign(vertices.begin(), vertices.end());

  // Counting sort by the first vertex, which few triangles share.
  start.assign(vertices.size() + 1, 0);
  for (Triangle& t : leaf.triangles) {
    t = rotated({place[t[0]], place[t[1]], place[t[2]]});
    ++start[t[0] + 1];
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) start[v + 1] += start[v];
  triangles.resize(leaf.triangles.size());
  for (const Triangle& t : leaf.triangles) triangles[start[t[0]]++] = t;  // now start[v] is where the triangles of v end
  for (std::size_t v = 0, first = 0; v < vertices.size(); first = start[v++]) {
    const auto begin = triangles.begin() + static_cast<std::ptrdiff_t>(first), end = triangles.begin() + start[v];
    if (end - begin > 1) std::sort(begin, end);
  }
  std::copy(triangles.begin(), triangles.end(), leaf.triangles.begin());
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

LeafMesh gather(lattice::LeafAddress address, std::span<const LeafMesh* const> sources) {
  constexpr std::int64_t kReach = std::int64_t{1} << 27;
  LeafMesh out{.address = address, .vertices = {}, .triangles = {}};
  std::vector<std::uint32_t> place;
  for (const LeafMesh* source : sources) {
    const std::int64_t dx = source->address.x() - address.x(), dz = source->address.z() - address.z();
    place.assign(source->vertices.size(), 0);  // 1 + index in out
    for (const Triangle& t : source->triangles) {
      lattice::Step sumX = 3 * source->address.x(), sumZ = 3 * source->address.z();
      bool near = true;
      for (std::uint32_t v : t) {
        expects(v < source->vertices.size(), "triangles name vertices that are there");
        const std::int64_t x = source->vertices[v].x, z = source->vertices[v].z;
        sumX += x;
        sumZ += z;
        near = near && std::abs(x + dx) <= kReach && std::abs(z + dz) <= kReach;
      }
      if (!near || !address.containsCentroid(sumX, sumZ)) continue;
      Triangle here;
      for (std::size_t c = 0; c < 3; ++c) {
        std::uint32_t& at = place[t[c]];
        if (at == 0) {
          const LocalVertex& v = source->vertices[t[c]];
          out.vertices.push_back({static_cast<std::int32_t>(v.x + dx), static_cast<std::int32_t>(v.z + dz), v.y});
          at = static_cast<std::uint32_t>(out.vertices.size());
        }
        here[c] = at - 1;
      }
      out.triangles.push_back(here);
    }
  }
  canonicalize(out);
  return out;
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
      expects(t[k] < leaf.vertices.size(), "triangles name vertices that are there");
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
