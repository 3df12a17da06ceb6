#include "client/evaluation/gltf_export.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
#include <tiny_gltf.h>
#pragma GCC diagnostic pop

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

namespace ridgecast::evaluation {
namespace {

double metres(lattice::Step steps) { return static_cast<double>(steps) * lattice::kMetresPerStep; }

// tinygltf's integers have 32 bits; leaf numbers may have 38, which a double holds exactly and JSON writes without a fraction.
tinygltf::Value number(std::int64_t v) {
  if (v >= std::numeric_limits<std::int32_t>::min() && v <= std::numeric_limits<std::int32_t>::max())
    return tinygltf::Value(static_cast<int>(v));
  return tinygltf::Value(static_cast<double>(v));
}

int addView(tinygltf::Model& model, const void* data, std::size_t bytes, int target) {
  std::vector<unsigned char>& buffer = model.buffers[0].data;
  tinygltf::BufferView view;
  view.buffer = 0;
  view.byteOffset = buffer.size();
  view.byteLength = bytes;
  view.target = target;
  const auto* first = static_cast<const unsigned char*>(data);
  buffer.insert(buffer.end(), first, first + bytes);
  buffer.resize((buffer.size() + 3) / 4 * 4);
  model.bufferViews.push_back(std::move(view));
  return static_cast<int>(model.bufferViews.size() - 1);
}

int addAccessor(tinygltf::Model& model, tinygltf::Accessor accessor) {
  model.accessors.push_back(std::move(accessor));
  return static_cast<int>(model.accessors.size() - 1);
}

// Every coordinate of a leaf, in steps, must be an exact float.
bool isExact(const mesh::LeafMesh& leaf) {
  constexpr std::int32_t kExact = 1 << 24;
  return std::ranges::all_of(leaf.vertices, [](const mesh::LocalVertex& v) {
    return std::abs(v.x) <= kExact && std::abs(v.z) <= kExact && std::abs(v.y) <= kExact;
  });
}

int addPositions(tinygltf::Model& model, const mesh::LeafMesh& leaf) {
  std::vector<float> positions;
  positions.reserve(leaf.vertices.size() * 3);
  std::vector<double> low(3, std::numeric_limits<double>::max()), high(3, std::numeric_limits<double>::lowest());
  for (const mesh::LocalVertex& v : leaf.vertices) {
    const double p[3] = {metres(v.x), metres(v.y), metres(v.z)};
    for (std::size_t c = 0; c < 3; ++c) {
      positions.push_back(static_cast<float>(p[c]));
      low[c] = std::min(low[c], p[c]);
      high[c] = std::max(high[c], p[c]);
    }
  }
  tinygltf::Accessor accessor;
  accessor.bufferView = addView(model, positions.data(), positions.size() * sizeof(float), TINYGLTF_TARGET_ARRAY_BUFFER);
  accessor.componentType = TINYGLTF_COMPONENT_TYPE_FLOAT;
  accessor.type = TINYGLTF_TYPE_VEC3;
  accessor.count = leaf.vertices.size();
  accessor.minValues = std::move(low);
  accessor.maxValues = std::move(high);
  return addAccessor(model, std::move(accessor));
}

int addIndices(tinygltf::Model& model, const mesh::LeafMesh& leaf) {
  tinygltf::Accessor accessor;
  accessor.type = TINYGLTF_TYPE_SCALAR;
  accessor.count = leaf.triangles.size() * 3;
  if (leaf.vertices.size() < 65535) {  // 65535 itself is glTF's primitive restart
    std::vector<std::uint16_t> indices;
    indices.reserve(accessor.count);
    for (const mesh::Triangle& t : leaf.triangles)
      for (const std::uint32_t index : t) indices.push_back(static_cast<std::uint16_t>(index));
    accessor.bufferView = addView(model, indices.data(), indices.size() * sizeof(std::uint16_t), TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
    accessor.componentType = TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  } else {
    accessor.bufferView =
        addView(model, leaf.triangles.data(), leaf.triangles.size() * sizeof(mesh::Triangle), TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
    accessor.componentType = TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  }
  return addAccessor(model, std::move(accessor));
}

}  // namespace

Outcome<void> writeGlb(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves, const camera::Pose& pose, const ExportInfo& info,
                       const std::filesystem::path& file) {
  const lattice::Step cellX = lattice::floorTo(pose.x, lattice::kCellBits), cellZ = lattice::floorTo(pose.z, lattice::kCellBits);
  tinygltf::Model model;
  model.asset.version = "2.0";
  model.asset.generator = "Ridgecast";
  model.asset.extras = tinygltf::Value(tinygltf::Value::Object{{"cellX", number(cellX >> lattice::kCellBits)},
                                                               {"cellZ", number(cellZ >> lattice::kCellBits)},
                                                               {"terrain", tinygltf::Value(info.terrain)},
                                                               {"seed", number(info.seed)},
                                                               {"latticeStep", tinygltf::Value(lattice::kMetresPerStep)}});
  model.buffers.emplace_back();
  tinygltf::Material material;  // rock, until someone brings their own
  material.name = "terrain";
  material.pbrMetallicRoughness.baseColorFactor = {0.5, 0.5, 0.5, 1.0};
  material.pbrMetallicRoughness.metallicFactor = 0;
  material.pbrMetallicRoughness.roughnessFactor = 1;
  model.materials.push_back(std::move(material));
  tinygltf::Scene scene;
  for (const auto& [address, held] : leaves) {
    const mesh::LeafMesh& leaf = *held.mesh;
    if (!isExact(leaf)) return Error{"a leaf of the mesh reaches further than 65,536 m from its corner, which a .glb cannot hold exactly"};
    tinygltf::Node node;
    node.translation = {metres(address.x() - cellX), 0.0, metres(address.z() - cellZ)};
    node.extras = tinygltf::Value(tinygltf::Value::Object{{"level", number(address.level)},
                                                          {"i", number(address.i)},
                                                          {"j", number(address.j)},
                                                          {"side", tinygltf::Value(metres(address.side()))}});
    if (!leaf.triangles.empty()) {
      tinygltf::Primitive primitive;
      primitive.mode = TINYGLTF_MODE_TRIANGLES;
      primitive.material = 0;
      primitive.attributes["POSITION"] = addPositions(model, leaf);
      primitive.indices = addIndices(model, leaf);
      tinygltf::Mesh mesh;
      mesh.primitives.push_back(std::move(primitive));
      model.meshes.push_back(std::move(mesh));
      node.mesh = static_cast<int>(model.meshes.size() - 1);
    }
    scene.nodes.push_back(static_cast<int>(model.nodes.size()));
    model.nodes.push_back(std::move(node));
    if (model.buffers[0].data.size() > 0xf0000000u)
      return Error{"the mesh is larger than the 4 GiB that a .glb can hold: ask for a smaller --budget"};
  }
  if (model.meshes.empty()) {  // glTF knows no empty buffers, meshes or materials
    model.buffers.clear();
    model.materials.clear();
  }
  model.scenes.push_back(std::move(scene));
  model.defaultScene = 0;

  std::ofstream out(file, std::ios::binary);
  tinygltf::TinyGLTF writer;
  const bool written = out && writer.WriteGltfSceneToStream(&model, out, false, true);
  out.close();
  if (!written || !out) return Error{"cannot write " + file.string() + ": choose a folder that exists, may be written and has room"};
  return {};
}

}  // namespace ridgecast::evaluation
