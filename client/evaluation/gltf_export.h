#pragma once
// The mesh held as an uncompressed binary glTF file (.glb): one node for each leaf, empty ones included.
// see common/gltf/glb.h. The file's cell is the camera's; asset.extras has terrain and seed beside what every file has.

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
Outcome<void> writeGlb(const scene::Leaves& leaves, const camera::Pose& pose, const ExportInfo& info, const std::filesystem::path& file);

}  // namespace ridgecast::evaluation
