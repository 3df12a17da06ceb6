#include "common/gltf/glb.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
#include <tiny_gltf.h>
#pragma GCC diagnostic pop

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

#include "common/gltf/draco_primitive.h"
#include "common/outcome/contract.h"

namespace ridgecast::gltf {
namespace {

constexpr char kDraco[] = "KHR_draco_mesh_compression", kFeatures[] = "EXT_mesh_features", kMetadata[] = "EXT_structural_metadata";
constexpr char kMaterial[] = "_FEATURE_ID_0";
constexpr std::size_t kMaxBytes = 0xf0000000u;
constexpr double kNear = 0.5, kFar = 40'000;  // metres, of the camera

using lattice::metres;

// Every coordinate of a leaf, in steps, must be an exact float.
bool isExact(const mesh::LeafMesh& leaf) {
  const auto exact = [](std::int32_t v) { return static_cast<double>(static_cast<float>(v)) == v; };
  return std::ranges::all_of(leaf.vertices, [&](const mesh::LocalVertex& v) { return exact(v.x) && exact(v.z) && exact(v.y); });
}

// Integers without ".0", and without glTF's defaults: tinygltf writes both, and a file may have thousands of leaves.
void thin(nlohmann::json& value) {
  if (value.is_number_float()) {
    const double number = value.get<double>();
    if (number == std::floor(number) && std::abs(number) < 9e15) value = static_cast<std::int64_t>(number);
  } else if (value.is_structured()) {
    for (auto& inner : value) thin(inner);
  }
}

// The values of many accessors, one after another in one buffer view.
struct Store {
  std::vector<unsigned char> bytes;
  int view = -1;
  std::size_t stride = 0;  // 0: indices
};

class Writer {
 public:
  Writer(const Document& document, Compression compression) : document_(document), compression_(compression) {
    stores_[kPositions].stride = stores_[kNormals].stride = 12;
    stores_[kColours].stride = stores_[kPlaces].stride = 8;
    stores_[kMaterials].stride = 4;
    model_.asset.version = "2.0";
    model_.asset.generator = "Ridgecast";
    scene_.name = "terrain";
  }

  Outcome<std::string> write(const std::stop_token& stop, const ForEach& forEach) {
    expects(!document_.texture || compression_ == Compression::kNone, "a texture is of a plain file");
    for (const Leaf& leaf : document_.leaves) {
      expects(leaf.mesh != nullptr, "a leaf has a mesh");
      const auto isOfAll = [&](std::size_t count) { return count == 0 || count == leaf.mesh->vertices.size(); };
      expects(isOfAll(leaf.normals.size()) && isOfAll(leaf.colours.size()) && isOfAll(leaf.materials.size()),
              "all vertices have normals, colours and materials, or none has");
      expects(std::ranges::all_of(leaf.materials, [&](std::uint8_t m) { return m < document_.materialNames.size(); }),
              "materials have names");
    }
    if (compression_ == Compression::kDraco) {
      packed_.resize(document_.leaves.size());
      const std::function<void(std::size_t)> pack = [&](std::size_t k) {
        const Leaf& leaf = document_.leaves[k];
        if (!stop.stop_requested() && !leaf.mesh->triangles.empty() && isExact(*leaf.mesh)) packed_[k] = compress(leaf);
      };
      if (forEach)
        forEach(packed_.size(), pack);
      else
        for (std::size_t k = 0; k < packed_.size(); ++k) pack(k);
    }
    for (std::size_t k = 0; k < document_.leaves.size(); ++k) {
      if (stop.stop_requested()) return Error{"nobody waits for the file any more"};
      if (auto added = add(k); !added) return added.error();
    }
    addCamera();
    finish();
    std::ostringstream out;
    tinygltf::TinyGLTF writer;
    if (!writer.WriteGltfSceneToStream(&model_, out, false, true) || !out) return Error{"the file could not be written"};
    model_ = {};
    return Outcome<std::string>(boost::system::in_place_value, finished(out.view()));
  }

 private:
  enum { kPositions, kNormals, kColours, kPlaces, kMaterials, kShort, kLong, kStores };

  Outcome<void> add(std::size_t k) {
    const Leaf& leaf = document_.leaves[k];
    if (!isExact(*leaf.mesh))
      return Error{"a leaf of the mesh reaches further than 65,536 m from its corner, which a .glb cannot hold exactly"};
    tinygltf::Node node;
    node.name = leaf.name;
    node.translation = {metres(leaf.mesh->address.x() - corner_.x), 0.0, metres(leaf.mesh->address.z() - corner_.z)};
    if (!leaf.mesh->triangles.empty()) {
      tinygltf::Mesh mesh;
      mesh.name = leaf.name;
      mesh.primitives.push_back(primitiveOf(leaf, packed_.empty() ? std::nullopt : std::exchange(packed_[k], {})));
      model_.meshes.push_back(std::move(mesh));
      node.mesh = static_cast<int>(model_.meshes.size() - 1);
    }
    scene_.nodes.push_back(static_cast<int>(model_.nodes.size()));
    model_.nodes.push_back(std::move(node));
    std::size_t bytes = compressed_.size();
    for (const Store& s : stores_) bytes += s.bytes.size();
    if (bytes > kMaxBytes) return Error{"the mesh is larger than the 4 GiB that a .glb can hold: ask for less"};
    return {};
  }

  tinygltf::Primitive primitiveOf(const Leaf& leaf, const std::optional<DracoPrimitive>& draco) {
    tinygltf::Primitive primitive;
    primitive.mode = TINYGLTF_MODE_TRIANGLES;
    primitive.material = 0;
    if (!leaf.materials.empty()) primitive.extensions[kFeatures] = featuresOf(leaf.materials);
    if (!draco) {
      addPlain(leaf, primitive);
      return primitive;
    }
    tinygltf::BufferView view;
    view.buffer = 0;
    view.byteOffset = compressed_.size();
    view.byteLength = draco->bytes.size();
    compressed_.insert(compressed_.end(), draco->bytes.begin(), draco->bytes.end());
    compressed_.resize((compressed_.size() + 3) / 4 * 4);
    model_.bufferViews.push_back(std::move(view));
    tinygltf::Accessor positions = described(TINYGLTF_TYPE_VEC3, TINYGLTF_COMPONENT_TYPE_FLOAT, draco->points);
    bound(*leaf.mesh, positions);
    tinygltf::Value::Object ids;
    const auto attribute = [&](const char* name, int id, tinygltf::Accessor accessor) {
      if (id < 0) return;
      primitive.attributes[name] = addAccessor(std::move(accessor));
      ids[name] = tinygltf::Value(id);
    };
    attribute("POSITION", draco->position, std::move(positions));
    attribute("NORMAL", draco->normal, described(TINYGLTF_TYPE_VEC3, TINYGLTF_COMPONENT_TYPE_FLOAT, draco->points));
    attribute("COLOR_0", draco->colour, described(TINYGLTF_TYPE_VEC3, TINYGLTF_COMPONENT_TYPE_FLOAT, draco->points));
    attribute(kMaterial, draco->material, described(TINYGLTF_TYPE_SCALAR, TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE, draco->points));
    primitive.indices = addAccessor(described(TINYGLTF_TYPE_SCALAR, indexType(draco->points), std::size_t{3} * draco->triangles));
    primitive.extensions[kDraco] = tinygltf::Value(tinygltf::Value::Object{
        {"bufferView", tinygltf::Value(static_cast<int>(model_.bufferViews.size() - 1))}, {"attributes", tinygltf::Value(std::move(ids))}});
    return primitive;
  }

  // The vertices' rows of the table; 0: it is not said.
  static tinygltf::Value featuresOf(const std::vector<std::uint8_t>& materials) {
    std::set<std::uint8_t> said(materials.begin(), materials.end());
    said.erase(0);
    const auto number = [](std::size_t v) { return tinygltf::Value(static_cast<int>(v)); };
    return object(
        {{"featureIds", tinygltf::Value(tinygltf::Value::Array{object({{"featureCount", number(std::max<std::size_t>(1, said.size()))},
                                                                       {"nullFeatureId", number(0)},
                                                                       {"attribute", number(0)},
                                                                       {"propertyTable", number(0)}})})}});
  }
  static tinygltf::Value object(tinygltf::Value::Object members) { return tinygltf::Value(std::move(members)); }

  static int indexType(std::size_t vertices) {  // 65535 itself is glTF's primitive restart
    return vertices < 65535 ? TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT : TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  }

  static void bound(const mesh::LeafMesh& leaf, tinygltf::Accessor& accessor) {
    std::vector<double> low(3, std::numeric_limits<double>::max()), high(3, std::numeric_limits<double>::lowest());
    for (const mesh::LocalVertex& v : leaf.vertices) {
      const double p[3] = {metres(v.x), metres(v.y), metres(v.z)};
      for (std::size_t c = 0; c < 3; ++c) {
        low[c] = std::min(low[c], p[c]);
        high[c] = std::max(high[c], p[c]);
      }
    }
    accessor.minValues = std::move(low);
    accessor.maxValues = std::move(high);
  }

  void addPlain(const Leaf& leaf, tinygltf::Primitive& primitive) {
    std::vector<std::array<float, 3>> positions;
    for (const mesh::LocalVertex& v : leaf.mesh->vertices)
      positions.push_back({static_cast<float>(metres(v.x)), static_cast<float>(metres(v.y)), static_cast<float>(metres(v.z))});
    tinygltf::Accessor accessor = stored(kPositions, positions, TINYGLTF_TYPE_VEC3, TINYGLTF_COMPONENT_TYPE_FLOAT);
    bound(*leaf.mesh, accessor);
    primitive.attributes["POSITION"] = addAccessor(std::move(accessor));
    if (!leaf.normals.empty())
      primitive.attributes["NORMAL"] = addAccessor(stored(kNormals, leaf.normals, TINYGLTF_TYPE_VEC3, TINYGLTF_COMPONENT_TYPE_FLOAT));
    if (!leaf.colours.empty()) {
      std::vector<std::array<std::uint16_t, 4>> padded;
      for (const auto& c : leaf.colours) padded.push_back({c[0], c[1], c[2], 0});
      tinygltf::Accessor colours = stored(kColours, padded, TINYGLTF_TYPE_VEC3, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT);
      colours.normalized = true;
      primitive.attributes["COLOR_0"] = addAccessor(std::move(colours));
    }
    if (!leaf.materials.empty()) {
      std::vector<std::array<std::uint8_t, 4>> padded;
      for (const std::uint8_t material : leaf.materials) padded.push_back({material});
      primitive.attributes[kMaterial] =
          addAccessor(stored(kMaterials, padded, TINYGLTF_TYPE_SCALAR, TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE));
    }
    if (document_.texture)
      primitive.attributes["TEXCOORD_0"] =
          addAccessor(stored(kPlaces, placesOn(*document_.texture, *leaf.mesh), TINYGLTF_TYPE_VEC2, TINYGLTF_COMPONENT_TYPE_FLOAT));
    const int type = indexType(leaf.mesh->vertices.size());
    std::vector<std::array<std::uint16_t, 3>> narrow;
    if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT)
      for (const mesh::Triangle& t : leaf.mesh->triangles)
        narrow.push_back({static_cast<std::uint16_t>(t[0]), static_cast<std::uint16_t>(t[1]), static_cast<std::uint16_t>(t[2])});
    tinygltf::Accessor indices = narrow.empty() ? stored(kLong, leaf.mesh->triangles, TINYGLTF_TYPE_SCALAR, type)
                                                : stored(kShort, narrow, TINYGLTF_TYPE_SCALAR, type);
    indices.count *= 3;
    primitive.indices = addAccessor(std::move(indices));
  }

  static std::vector<std::array<float, 2>> placesOn(const Texture& texture, const mesh::LeafMesh& leaf) {
    std::vector<std::array<float, 2>> places;
    const auto share = [](lattice::Step at, lattice::Step low, lattice::Step high) {
      return static_cast<float>(static_cast<double>(at - low) / static_cast<double>(high - low));
    };
    for (const mesh::LocalVertex& v : leaf.vertices)
      places.push_back(
          {share(leaf.address.x() + v.x, texture.low.x, texture.high.x), share(leaf.address.z() + v.z, texture.low.z, texture.high.z)});
    return places;
  }

  static tinygltf::Accessor described(int type, int component, std::size_t count) {
    tinygltf::Accessor accessor;
    accessor.type = type;
    accessor.componentType = component;
    accessor.count = count;
    return accessor;
  }

  // The buffer view is known only when everything is stored. Until then the accessor names -2 - store.
  template <class T>
  tinygltf::Accessor stored(int store, const std::vector<T>& values, int type, int component) {
    tinygltf::Accessor accessor = described(type, component, values.size());
    std::vector<unsigned char>& bytes = stores_[static_cast<std::size_t>(store)].bytes;
    accessor.bufferView = -2 - store;
    accessor.byteOffset = bytes.size();
    const auto* first = reinterpret_cast<const unsigned char*>(values.data());
    bytes.insert(bytes.end(), first, first + values.size() * sizeof(T));
    bytes.resize((bytes.size() + 3) / 4 * 4);
    return accessor;
  }

  int addAccessor(tinygltf::Accessor accessor) {
    model_.accessors.push_back(std::move(accessor));
    return static_cast<int>(model_.accessors.size() - 1);
  }

  void addCamera() {
    if (!document_.camera) return;
    const auto& [pose, projection] = *document_.camera;
    tinygltf::Camera camera;
    camera.type = "perspective";
    camera.perspective.yfov = projection.verticalFov;
    camera.perspective.aspectRatio = projection.aspect();
    camera.perspective.znear = kNear;
    camera.perspective.zfar = kFar;
    model_.cameras.push_back(std::move(camera));
    tinygltf::Node node;
    node.name = "camera";
    node.camera = 0;
    node.translation = {metres(pose.x - corner_.x) + pose.remainderX * lattice::kMetresPerStep, pose.y,
                        metres(pose.z - corner_.z) + pose.remainderZ * lattice::kMetresPerStep};
    const double yaw = std::remainder(pose.yaw, 2 * 3.14159265358979323846) / 2, pitch = pose.pitch / 2;
    node.rotation = {std::cos(yaw) * std::sin(pitch), std::sin(yaw) * std::cos(pitch), -std::sin(yaw) * std::sin(pitch),
                     std::cos(yaw) * std::cos(pitch)};
    model_.nodes.push_back(std::move(node));
  }

  void finish() {
    std::vector<unsigned char> data = std::move(compressed_);
    for (Store& s : stores_) {
      if (s.bytes.empty()) continue;
      tinygltf::BufferView view;
      view.buffer = 0;
      view.byteOffset = data.size();
      view.byteLength = s.bytes.size();
      view.byteStride = s.stride;
      view.target = s.stride ? TINYGLTF_TARGET_ARRAY_BUFFER : TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER;
      data.insert(data.end(), s.bytes.begin(), s.bytes.end());
      s.bytes = {};
      s.view = static_cast<int>(model_.bufferViews.size());
      model_.bufferViews.push_back(std::move(view));
    }
    const auto addView = [&](std::string_view bytes) {
      data.resize(aligned(data.size()));
      tinygltf::BufferView view;
      view.buffer = 0;
      view.byteOffset = data.size();
      view.byteLength = bytes.size();
      data.insert(data.end(), bytes.begin(), bytes.end());
      data.resize(aligned(data.size()));
      model_.bufferViews.push_back(std::move(view));
      return tinygltf::Value(static_cast<int>(model_.bufferViews.size() - 1));
    };
    if (hasMaterials()) addNames(addView);
    if (document_.texture) addView(document_.texture->png);  // the last
    for (tinygltf::Accessor& a : model_.accessors)
      if (a.bufferView <= -2) a.bufferView = stores_[static_cast<std::size_t>(-2 - a.bufferView)].view;
    if (!model_.meshes.empty()) {  // glTF does not allow empty buffers, meshes or materials
      model_.buffers.emplace_back();
      model_.buffers[0].data = std::move(data);
      tinygltf::Material material;
      material.name = "terrain";
      const bool coloured =
          document_.texture || std::ranges::any_of(document_.leaves, [](const Leaf& leaf) { return !leaf.colours.empty(); });
      const double grey = coloured ? 1.0 : 0.5;  // rock, unless the file has colours
      material.pbrMetallicRoughness.baseColorFactor = {grey, grey, grey, 1.0};
      material.pbrMetallicRoughness.metallicFactor = 0;
      material.pbrMetallicRoughness.roughnessFactor = 1;
      model_.materials.push_back(std::move(material));
      if (std::ranges::any_of(model_.meshes, [](const tinygltf::Mesh& m) { return m.primitives[0].extensions.contains(kDraco); }))
        model_.extensionsUsed = model_.extensionsRequired = {kDraco};
      if (hasMaterials()) model_.extensionsUsed.insert(model_.extensionsUsed.end(), {kFeatures, kMetadata});
    }
    model_.scenes.push_back(std::move(scene_));
    if (document_.camera) {
      tinygltf::Scene second;
      second.name = "camera";
      second.nodes.push_back(static_cast<int>(model_.nodes.size() - 1));
      model_.scenes.push_back(std::move(second));
    }
    model_.defaultScene = 0;
  }

  // EXT_structural_metadata aligns chunks and views to 8 bytes.
  std::size_t aligned(std::size_t size) const { return document_.materialNames.empty() ? (size + 3) / 4 * 4 : (size + 7) / 8 * 8; }
  bool hasMaterials() const { return !document_.materialNames.empty() && !model_.meshes.empty(); }

  // The table of names, a row for each number.
  template <class AddView>
  void addNames(const AddView& addView) {
    std::string text;
    std::vector<std::uint32_t> offsets{0};
    for (const std::string& name : document_.materialNames) offsets.push_back(static_cast<std::uint32_t>((text += name).size()));
    text.resize(std::max<std::size_t>(1, text.size()), ' ');  // a view has a byte
    tinygltf::Value values = addView(text);
    tinygltf::Value places = addView({reinterpret_cast<const char*>(offsets.data()), offsets.size() * sizeof offsets[0]});
    const auto word = [](const char* of) { return tinygltf::Value(std::string(of)); };
    tinygltf::Value name = object({{"type", word("STRING")}, {"description", word("what the ground is made of; empty: it is not said")}});
    model_.extensions[kMetadata] = object(
        {{"schema", object({{"id", word("ridgecast")},
                            {"classes", object({{"material", object({{"properties", object({{"name", std::move(name)}})}})}})}})},
         {"propertyTables",
          tinygltf::Value(tinygltf::Value::Array{object(
              {{"class", word("material")},
               {"count", tinygltf::Value(static_cast<int>(document_.materialNames.size()))},
               {"properties", object({{"name", object({{"values", std::move(values)}, {"stringOffsets", std::move(places)}})}})}})})}});
  }

  // tinygltf's file with extras, whose integers would have 32 bits there, and with thinner JSON.
  std::string finished(std::string_view glb) const {
    constexpr std::size_t kText = 20;  // header, chunk's length and name
    std::uint32_t length = 0;
    std::memcpy(&length, &glb[12], sizeof length);
    nlohmann::json json = nlohmann::json::parse(glb.substr(kText, length));
    nlohmann::json& extras = json["asset"]["extras"] = nlohmann::json::parse(document_.extras);
    extras["origin"] = {{"x", metres(corner_.x)}, {"z", metres(corner_.z)}};
    if (!document_.atOrigin) {
      extras["cellX"] = lattice::cellOf(corner_.x);
      extras["cellZ"] = lattice::cellOf(corner_.z);
    }
    extras["latticeStep"] = lattice::kMetresPerStep;
    for (std::size_t k = 0; k < document_.leaves.size(); ++k) {
      const lattice::LeafAddress& a = document_.leaves[k].mesh->address;
      json["nodes"][k]["extras"] = {{"level", a.level}, {"i", a.i}, {"j", a.j}, {"side", metres(a.side())}};
    }
    thin(json);
    if (json.contains("meshes"))
      for (auto& mesh : json["meshes"]) mesh["primitives"][0].erase("mode");  // triangles
    if (document_.texture && json.contains("materials")) {                    // tinygltf would pack the picture again
      json["images"][0] = {{"bufferView", json["bufferViews"].size() - 1}, {"mimeType", "image/png"}};
      json["samplers"][0] = {{"wrapS", TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE}, {"wrapT", TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE}};
      json["textures"][0] = {{"source", 0}, {"sampler", 0}};
      json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0}};
    }
    std::string text = json.dump();
    text.resize(aligned(kText + text.size()) - kText, ' ');
    std::string out;
    out.reserve(kText + text.size() + glb.size() - length);
    out.append(glb.substr(0, kText)).append(text).append(glb.substr(kText + length));
    const std::array lengths{static_cast<std::uint32_t>(out.size()), static_cast<std::uint32_t>(text.size())};
    std::memcpy(&out[8], lengths.data(), sizeof lengths);
    return out;
  }

  const Document& document_;
  const Compression compression_;
  const lattice::Point corner_ = originOf(document_);
  tinygltf::Model model_;
  tinygltf::Scene scene_;
  std::array<Store, kStores> stores_;
  std::vector<std::optional<DracoPrimitive>> packed_;  // by leaf, until it is added; empty: plain
  std::vector<unsigned char> compressed_;
};

}  // namespace

lattice::Point originOf(const Document& document) {
  if (document.atOrigin) return document.origin;
  return {lattice::floorTo(document.origin.x, lattice::kCellBits), lattice::floorTo(document.origin.z, lattice::kCellBits)};
}

Outcome<std::string> writeGlb(const Document& document, Compression compression, std::stop_token stop, const ForEach& forEach) {
  return Writer(document, compression).write(stop, forEach);
}

}  // namespace ridgecast::gltf
