#pragma once
// A leaf's mesh <-> its payload on the wire, without loss: decoding returns exactly what was encoded.
//
// The payload (for authors of clients: PROTOCOL.md, Leaf payload):
//   1 byte    form: 0x10 plain, 0x11 Draco (the high half is the version of the payload, 1)
//   2 bytes   shifts, little-endian: bits 0-4 of x, 5-9 of z, 10-14 of y, bit 15 zero; each 0..28
//   varints   least x, least z, least y of the vertices, zigzag
//   body      of the values q = (value - least) >> shift, which divides without remainder
// The plain form is a varint list, smaller for a few triangles; the Draco form is an edgebreaker stream of one integer attribute.
// Pure functions; any thread.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/outcome.h"

namespace ridgecast::codec {

// x and z of a leaf's vertices lie within this many steps of its corner; y within lattice::kMaxHeight.
inline constexpr std::int32_t kMaxOffset = std::int32_t{1} << 27;
bool isInRange(const mesh::LocalVertex& v);

// A decoder's limits. Decoding needs at most about 400 bytes of memory for each announced triangle.
struct Limits {
  std::uint32_t maxTriangles = 1u << 20;
  std::size_t maxPayloadBytes = std::size_t{64} << 20;
};

// The largest payload of this many triangles. Longer ones are refused unread.
constexpr std::size_t largestPayload(std::uint32_t triangles) { return 256 + std::size_t{64} * triangles; }

// `leaf` must be canonical, its triangles counter-clockwise with positive area, its coordinates in range (see kMaxOffset).
// An empty leaf has an empty payload.
std::vector<std::uint8_t> encodeLeaf(const mesh::LeafMesh& leaf);

// `vertices` and `triangles` are the counts announced with the payload. The result is canonical and in range, and every triangle is
// counter-clockwise with positive area. Otherwise: an error that says what is wrong. Does not check that the triangles (their centroids)
// belong to the leaf.
Outcome<mesh::LeafMesh> decodeLeaf(std::span<const std::uint8_t> payload, lattice::LeafAddress address, std::uint32_t vertices,
                                   std::uint32_t triangles, const Limits& limits = {});

}  // namespace ridgecast::codec
