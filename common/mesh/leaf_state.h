#pragma once
// What is known of a leaf's mesh without the mesh.

#include <cstdint>

#include "common/lattice/lattice.h"

namespace ridgecast::mesh {

struct LeafState {
  lattice::LeafAddress address;
  std::uint64_t version = 0;  // grows whenever the leaf's triangles change; never reused for other content
  std::uint64_t hash = 0;     // mesh::hashLeaf of its content
  std::uint32_t triangles = 0;
};

}  // namespace ridgecast::mesh
