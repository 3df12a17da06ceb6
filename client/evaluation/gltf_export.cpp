#include "client/evaluation/gltf_export.h"

#include <nlohmann/json.hpp>

#include "client/evaluation/text_file.h"
#include "common/gltf/glb.h"

namespace ridgecast::evaluation {

Outcome<void> writeGlb(const scene::Leaves& leaves, const camera::Pose& pose, const ExportInfo& info, const std::filesystem::path& file) {
  gltf::Document document;
  document.origin = {pose.x, pose.z};
  document.extras = nlohmann::json{{"terrain", info.terrain}, {"seed", info.seed}}.dump();
  for (const auto& [address, held] : leaves) document.leaves.push_back({held.mesh.get(), {}, {}});
  const auto bytes = gltf::writeGlb(document, gltf::Compression::kNone);
  if (!bytes) return bytes.error();
  return writeText(file, {bytes->data(), bytes->size()});
}

}  // namespace ridgecast::evaluation
