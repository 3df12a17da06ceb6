#include "client/evaluation/gltf_export.h"

#include <fstream>
#include <nlohmann/json.hpp>

#include "common/gltf/glb.h"

namespace ridgecast::evaluation {

Outcome<void> writeGlb(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves, const camera::Pose& pose, const ExportInfo& info,
                       const std::filesystem::path& file) {
  gltf::Document document;
  document.origin = {pose.x, pose.z};
  document.extras = nlohmann::json{{"terrain", info.terrain}, {"seed", info.seed}}.dump();
  for (const auto& [address, held] : leaves) document.leaves.push_back({held.mesh.get(), {}, {}});
  const auto bytes = gltf::writeGlb(document, gltf::Compression::kNone);
  if (!bytes) return bytes.error();
  std::ofstream out(file, std::ios::binary);
  out.write(bytes->data(), static_cast<std::streamsize>(bytes->size()));
  out.close();
  if (!out) return Error{"cannot write " + file.string() + ": choose a folder that exists, may be written and has room"};
  return {};
}

}  // namespace ridgecast::evaluation
