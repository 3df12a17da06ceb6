#pragma once
// A leaf's mesh <-> its payload on the wire, without loss: what is decoded is bit for bit what was encoded.
//
// The payload, byte by byte (PROTOCOL.md, Leaf payload, says the same for people who write a client):
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

// What a decoder accepts. Memory needed to decode is bounded by about 400 bytes a triangle announced.
struct Limits {
  std::uint32_t maxTriangles = 1u << 20;
  std::size_t maxPayloadBytes = std::size_t{64} << 20;
};

// Most bytes that a payload of this many triangles can have; longer ones are refused unread.
constexpr std::size_t largestPayload(std::uint32_t triangles) { return 256 + std::size_t{64} * triangles; }

// `leaf` must be canonical, its triangles counter-clockwise with positive area, its coordinates in range (see kMaxOffset).
// An empty leaf has an empty payload.
std::vector<std::uint8_t> encodeLeaf(const mesh::LeafMesh& leaf);

// `vertices` and `triangles` are the counts that were announced beside the payload. The result is canonical, in range and every triangle
// is counter-clockwise with positive area, or: an error that says what is wrong with the payload. Whether the triangles belong to the
// leaf (their centroids) is not judged.
Outcome<mesh::LeafMesh> decodeLeaf(std::span<const std::uint8_t> payload, lattice::LeafAddress address, std::uint32_t vertices,
                                   std::uint32_t triangles, const Limits& limits = {});

}  // namespace ridgecast::codec
