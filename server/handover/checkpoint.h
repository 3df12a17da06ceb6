#pragma once
// A camera's mesh as bytes, for the server that goes on with it.
//
// Triangles are a function of the vertices and heights one of the terrain, so neither is in it: leaves, the vertices' places and levels,
// and where edits have raised the ground, by how much (both servers know the unedited one). About 2.2 bytes a vertex.
//
//   1 byte    form: 0x40
//   8 each    the world's content hash, the last edit that the mesh knows, the mesh's hash, the effective threshold; little-endian
//   4 each    lengths of the next two
//   ...       leaves; the vertices' places (common/points, from nothing); their levels and rises
//   8         a hash of all before
//
// Pure functions; any thread.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/pipeline/pipeline.h"

namespace ridgecast::handover {

inline constexpr std::size_t kMaxBytes = std::size_t{1} << 20;  // a mesh of some 900,000 triangles
inline constexpr std::size_t kMaxLeaves = 65'536;

struct Checkpoint {
  std::uint64_t contentHash = 0;  // of the world
  std::uint64_t edit = 0;         // the last that the mesh knows
  std::uint64_t meshHash = 0;
  pipeline::MeshState mesh;
};

// Nothing: it would have more than kMaxBytes. `ground`: the mesh's.
std::optional<std::string> encode(const Checkpoint& checkpoint, const terrain::Terrain& ground);
// `ground`: of the same world, with any edits. Error: one sentence; these are not the bytes of a checkpoint, or of another world, or more
// than `maxVertices`. Whether there is such a mesh, restoring it tells.
Outcome<Checkpoint> decode(std::string_view bytes, std::uint64_t contentHash, const terrain::Terrain& ground, std::size_t maxVertices);

}  // namespace ridgecast::handover
