#pragma once
// What changed inside a leaf: one leaf's mesh -> another over the same square, in a few bytes for each new vertex.
//
// A delta names the base's triangles to remove and fills the holes they leave, from the edges inwards. Each new triangle is a known edge
// and an apex, which mostly follows from the neighbouring edges. Only new vertices carry a position, relative to the edge they were reached
// from. Everything is coded bit by bit with adaptive probabilities (range_coder.h). For authors of clients: PROTOCOL.md, Delta payload.
//
//   1 byte    form: 0x20
//   varints   triangles removed, triangles added, new vertices
//   4 bytes   check: the low half of the hash of the new leaf, little-endian
//   rest      the coded bits
// An empty payload means: nothing changed. The base is in the frame of the leaf that is decoded (see mesh::gather for leaves that were
// not held before). Pure functions; any thread.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/codec/codec.h"

namespace ridgecast::codec {

struct DeltaCounts {
  std::uint32_t removed = 0, added = 0;  // triangles
  std::uint32_t fresh = 0;               // vertices that the base does not have
};

// Both canonical, in range, of the same address. `targetHash` is mesh::hashLeaf(target). Nothing: the change is too intricate for a
// delta, or too large to gain; send the leaf whole.
std::optional<std::vector<std::uint8_t>> encodeDelta(const mesh::LeafMesh& base, const mesh::LeafMesh& target, std::uint64_t targetHash);

// The counts that a payload announces, checked against its length and the base's triangles; what decoding allocates is bounded by them.
Outcome<DeltaCounts> deltaCounts(std::span<const std::uint8_t> payload, std::size_t baseTriangles, const Limits& limits = {});

struct Changed {
  mesh::LeafMesh leaf;
  std::uint64_t hash = 0;  // mesh::hashLeaf(leaf)
};
// The result is canonical, in range, all triangles counter-clockwise, and its hash has the announced low half, or: an error that says
// what is wrong. `baseHash` is mesh::hashLeaf(base).
Outcome<Changed> decodeDelta(std::span<const std::uint8_t> payload, const mesh::LeafMesh& base, std::uint64_t baseHash,
                             const Limits& limits = {});

}  // namespace ridgecast::codec
