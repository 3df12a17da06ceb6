#pragma once
// The mesh held as an uncompressed binary glTF file (.glb): one node for each leaf, empty ones included.
//   node.extras        {level, i, j, side}: the leaf's address, side in metres
//   node.translation   the leaf's corner (least x and z, y 0) in metres relative to the corner of the camera's 4,096 m cell
//   POSITION           metres relative to that corner; all are multiples of 1/256 m and exact in a float
//   asset.extras       cellX, cellZ (the camera's cell, integers: metres / 4,096), terrain, seed, latticeStep (metres)
// Triangles are counter-clockwise seen from above; a leaf without triangles is a node without a mesh.

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

#include "client/scene/scene.h"
#include "common/camera/camera.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

struct ExportInfo {
  std::string terrain;
  std::uint32_t seed = 0;
};

// Error: the mesh is too large for a .glb (4 GiB), a height or extent is not exact in a float (65 km), or the file cannot be written.
Outcome<void> writeGlb(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves, const camera::Pose& pose, const ExportInfo& info,
                       const std::filesystem::path& file);

}  // namespace ridgecast::evaluation
