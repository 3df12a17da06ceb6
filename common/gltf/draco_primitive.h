#pragma once
// One leaf's triangles for KHR_draco_mesh_compression. Positions are lossless: they are quantised by a power of two of the lattice's step,
// which a decoder multiplies back exactly. Private to the room.

#include <cstdint>
#include <optional>
#include <vector>

#include "common/gltf/glb.h"

namespace ridgecast::gltf {

struct DracoPrimitive {
  std::vector<std::uint8_t> bytes;
  std::uint32_t points = 0, triangles = 0;                     // as a decoder sees them: points where triangles only touch may be doubled
  int position = -1, normal = -1, colour = -1, material = -1;  // ids of the attributes; -1: none
};

// Returns nothing if Draco cannot hold this leaf.
std::optional<DracoPrimitive> compress(const Leaf& leaf);

}  // namespace ridgecast::gltf
