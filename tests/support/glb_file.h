#pragma once
// A .glb read back with a JSON parser, the container's layout and Draco's own decoder: it shares nothing with who wrote it.

#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::testing_support {

struct GlbLeaf {
  mesh::LeafMesh mesh;                                              // canonical; every position was a whole number of steps
  std::array<double, 3> translation{};                              // metres
  std::map<lattice::Point, std::array<float, 3>> normals, colours;  // by position relative to the leaf's corner
  std::map<lattice::Point, std::string> materials;                  // their names, likewise
  bool compressed = false;
};

struct GlbFile {
  nlohmann::json json;
  std::vector<GlbLeaf> leaves;  // in the order of the first scene's nodes
  std::size_t triangles() const;
  std::vector<mesh::LeafMesh> meshes() const;
};

// Throws std::runtime_error that says what is wrong.
GlbFile readGlb(std::string_view bytes);

}  // namespace ridgecast::testing_support
