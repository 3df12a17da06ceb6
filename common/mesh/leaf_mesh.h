#pragma once
// A leaf's share of a mesh, as sent, held and drawn: the triangles whose centroid lies in the leaf's square.
//
// Positions are in steps, x and z relative to the leaf's corner (least x and z; they may be negative or exceed the side, since
// triangles straddle borders), y absolute. Triangles are counter-clockwise seen from above.
//
// Canonical order, which each side reaches by itself, so it costs no bytes:
//   vertices    ascending by x, then z; no two have the same x and z; every vertex is used
//   triangles   rotated so that the smallest index comes first; ascending by (first, second, third)
//
// The hash depends only on positions, never on indices:
//   vertex      v = mix(x + mix(z + mix(y))), whole lattice positions as two's complement 64-bit integers
//   triangle    mix(v0 + mix(v1 + mix(v2))), v0 the corner that is smallest by x, then z, the others following counter-clockwise
//   leaf        sum of its triangles, modulo 2^64
//   mesh        sum over its leaves of mix(leaf hash + mix(level + mix(i + mix(j)))), so that empty leaves count too
// with mix the finaliser in common/lattice.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"

namespace ridgecast::mesh {

struct LocalVertex {
  std::int32_t x = 0;
  std::int32_t z = 0;
  std::int32_t y = 0;
  friend constexpr auto operator<=>(const LocalVertex&, const LocalVertex&) = default;
};
using Triangle = std::array<std::uint32_t, 3>;

struct LeafMesh {
  lattice::LeafAddress address;
  std::vector<LocalVertex> vertices;
  std::vector<Triangle> triangles;
  friend bool operator==(const LeafMesh&, const LeafMesh&) = default;
};

// What is known of a leaf's mesh without the mesh.
struct LeafState {
  lattice::LeafAddress address;
  std::uint64_t version = 0;  // grows whenever the leaf's triangles change; never reused for other content
  std::uint64_t hash = 0;     // hashLeaf of its content
  std::uint32_t triangles = 0;
  std::uint64_t points = 0;  // version of the vertices that lie in its square
};

// Twice the area of (a, b, c), positive if counter-clockwise seen from above. Exact for vertices within 2^28 steps of their corner.
constexpr std::int64_t orientation(const LocalVertex& a, const LocalVertex& b, const LocalVertex& c) {
  const std::int64_t bx = std::int64_t{b.x} - a.x, bz = std::int64_t{b.z} - a.z, cx = std::int64_t{c.x} - a.x, cz = std::int64_t{c.z} - a.z;
  return bz * cx - bx * cz;
}

// With the smallest index first.
constexpr Triangle rotated(Triangle t) {
  if (t[1] < t[0] && t[1] < t[2]) return {t[1], t[2], t[0]};
  if (t[2] < t[0] && t[2] < t[1]) return {t[2], t[0], t[1]};
  return t;
}

// Sorts vertices and triangles into canonical order, merges equal vertices and drops unused ones. Indices must be in range.
void canonicalize(LeafMesh& leaf);
bool isCanonical(const LeafMesh& leaf);

// What a leaf starts with after a split or merge: the triangles of `sources` whose centroid lies in the square of `address`, in its frame
// and in canonical order. The sources are the ancestors and descendants held before. Skips triangles with a vertex more than 2^27 steps
// from the new corner; sound leaves have none.
LeafMesh gather(lattice::LeafAddress address, std::span<const LeafMesh* const> sources);

// A vertex's v; and a triangle's hash from those of its corners, beginning with the smallest by x, then z.
constexpr std::uint64_t hashVertex(const lattice::Vertex& v) {
  using lattice::mix;
  return mix(static_cast<std::uint64_t>(v.x) + mix(static_cast<std::uint64_t>(v.z) + mix(static_cast<std::uint64_t>(std::int64_t{v.y}))));
}
constexpr std::uint64_t hashMixed(std::uint64_t v0, std::uint64_t v1, std::uint64_t v2) {
  return lattice::mix(v0 + lattice::mix(v1 + lattice::mix(v2)));
}
std::uint64_t hashTriangle(const lattice::Vertex& a, const lattice::Vertex& b, const lattice::Vertex& c);
std::uint64_t hashLeaf(const LeafMesh& leaf);
// One leaf's term of the mesh's hash; the mesh's hash is the sum of these.
std::uint64_t hashTerm(lattice::LeafAddress address, std::uint64_t leafHash);

}  // namespace ridgecast::mesh
