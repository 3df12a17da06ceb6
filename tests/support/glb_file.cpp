#include "tests/support/glb_file.h"

#include <draco/compression/decode.h>
#include <draco/mesh/mesh.h>

#include <cmath>
#include <cstring>
#include <stdexcept>

namespace ridgecast::testing_support {
namespace {

using Json = nlohmann::json;

void demand(bool condition, const std::string& what) {
  if (!condition) throw std::runtime_error("bad .glb: " + what);
}

struct Reader {
  const Json& json;
  std::string_view bin;

  const Json& accessor(const Json& index) const { return json.at("accessors").at(index.get<std::size_t>()); }
  std::string_view view(const Json& index) const {
    const Json& v = json.at("bufferViews").at(index.get<std::size_t>());
    const std::size_t at = v.value("byteOffset", std::size_t{0}), length = v.at("byteLength").get<std::size_t>();
    demand(at + length <= bin.size(), "a buffer view beyond the buffer");
    return bin.substr(at, length);
  }
  template <class T>
  std::vector<T> values(const Json& index, std::size_t width) const {
    const Json& a = accessor(index);
    const Json& v = json.at("bufferViews").at(a.at("bufferView").get<std::size_t>());
    const std::string_view data = view(a.at("bufferView"));
    const std::size_t count = a.at("count").get<std::size_t>(), stride = v.value("byteStride", width * sizeof(T)),
                      first = a.value("byteOffset", std::size_t{0});
    demand(count > 0 && first + (count - 1) * stride + width * sizeof(T) <= data.size(), "an accessor beyond its view");
    std::vector<T> out(count * width);
    for (std::size_t k = 0; k < count; ++k) std::memcpy(&out[k * width], data.data() + first + k * stride, width * sizeof(T));
    return out;
  }
};

template <class T, int kWidth>
std::vector<T> decoded(const draco::Mesh& mesh, std::uint32_t id) {
  const draco::PointAttribute* attribute = mesh.GetAttributeByUniqueId(id);
  demand(attribute != nullptr && attribute->num_components() == kWidth, "a Draco attribute is missing");
  std::vector<T> out(kWidth * mesh.num_points());
  for (std::uint32_t p = 0; p < mesh.num_points(); ++p)
    demand(attribute->ConvertValue<T, kWidth>(attribute->mapped_index(draco::PointIndex(p)), &out[kWidth * p]), "a Draco attribute's type");
  return out;
}

// The names in the table that the features of a primitive are rows of.
std::vector<std::string> namesOf(const Reader& reader, const Json& features) {
  const Json& set = features.at("featureIds").at(0);
  demand(set.at("attribute") == 0 && set.at("nullFeatureId") == 0, "features that are no attribute");
  const Json& table =
      reader.json.at("extensions").at("EXT_structural_metadata").at("propertyTables").at(set.at("propertyTable").get<std::size_t>());
  const Json& property = table.at("properties").at("name");
  const std::string_view text = reader.view(property.at("values")), offsets = reader.view(property.at("stringOffsets"));
  for (const char* of : {"values", "stringOffsets"})
    demand(reader.json.at("bufferViews").at(property.at(of).get<std::size_t>()).value("byteOffset", 0) % 8 == 0,
           "a table off its alignment");
  const auto offset = [&](std::size_t k) {
    std::uint32_t v = 0;
    demand(4 * k + 4 <= offsets.size(), "a table that ends early");
    std::memcpy(&v, &offsets[4 * k], 4);
    return v;
  };
  std::vector<std::string> out;
  for (std::size_t k = 0; k < table.at("count").get<std::size_t>(); ++k) {
    demand(offset(k) <= offset(k + 1) && offset(k + 1) <= text.size(), "a name beyond its view");
    out.emplace_back(text.substr(offset(k), offset(k + 1) - offset(k)));
  }
  return out;
}

std::int32_t steps(double metres) {
  const double s = metres * 256;
  demand(s == std::round(s), "a position off the lattice, " + std::to_string(s) + " steps");
  return static_cast<std::int32_t>(s);
}

void readPrimitive(const Reader& reader, const Json& primitive, GlbLeaf& leaf) {
  const Json& attributes = primitive.at("attributes");
  std::vector<float> positions, normals, colours;
  std::vector<std::uint8_t> materials;
  std::vector<std::uint32_t> indices;
  const Json extensions = primitive.value("extensions", Json::object());
  if (extensions.contains("KHR_draco_mesh_compression")) {
    leaf.compressed = true;
    const Json& extension = extensions.at("KHR_draco_mesh_compression");
    const std::string_view bytes = reader.view(extension.at("bufferView"));
    draco::DecoderBuffer buffer;
    buffer.Init(bytes.data(), bytes.size());
    draco::Decoder decoder;
    auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
    demand(mesh.ok(), "Draco cannot decode it");
    const Json& ids = extension.at("attributes");
    positions = decoded<float, 3>(*mesh.value(), ids.at("POSITION").get<std::uint32_t>());
    if (ids.contains("NORMAL")) normals = decoded<float, 3>(*mesh.value(), ids.at("NORMAL").get<std::uint32_t>());
    if (ids.contains("COLOR_0")) colours = decoded<float, 3>(*mesh.value(), ids.at("COLOR_0").get<std::uint32_t>());
    if (ids.contains("_FEATURE_ID_0")) materials = decoded<std::uint8_t, 1>(*mesh.value(), ids.at("_FEATURE_ID_0").get<std::uint32_t>());
    for (std::uint32_t f = 0; f < mesh.value()->num_faces(); ++f)
      for (int c = 0; c < 3; ++c) indices.push_back(mesh.value()->face(draco::FaceIndex(f))[c].value());
    demand(reader.accessor(attributes.at("POSITION")).at("count") == mesh.value()->num_points(), "an accessor's count is not Draco's");
    demand(reader.accessor(primitive.at("indices")).at("count") == indices.size(), "the indices' count is not Draco's");
  } else {
    positions = reader.values<float>(attributes.at("POSITION"), 3);
    if (attributes.contains("NORMAL")) normals = reader.values<float>(attributes.at("NORMAL"), 3);
    if (attributes.contains("COLOR_0"))
      for (const std::uint16_t c : reader.values<std::uint16_t>(attributes.at("COLOR_0"), 3)) colours.push_back(c / 65535.0f);
    if (attributes.contains("_FEATURE_ID_0")) materials = reader.values<std::uint8_t>(attributes.at("_FEATURE_ID_0"), 1);
    if (reader.accessor(primitive.at("indices")).at("componentType") == 5123)
      for (const std::uint16_t i : reader.values<std::uint16_t>(primitive.at("indices"), 1)) indices.push_back(i);
    else
      indices = reader.values<std::uint32_t>(primitive.at("indices"), 1);
  }
  demand(indices.size() % 3 == 0, "indices that are no triangles");
  const auto names = materials.empty() ? std::vector<std::string>() : namesOf(reader, extensions.at("EXT_mesh_features"));
  for (std::size_t k = 0; k < positions.size(); k += 3) {
    const mesh::LocalVertex v{steps(positions[k]), steps(positions[k + 2]), steps(positions[k + 1])};
    leaf.mesh.vertices.push_back(v);
    if (!normals.empty()) leaf.normals[{v.x, v.z}] = {normals[k], normals[k + 1], normals[k + 2]};
    if (!colours.empty()) leaf.colours[{v.x, v.z}] = {colours[k], colours[k + 1], colours[k + 2]};
    if (!materials.empty()) leaf.materials[{v.x, v.z}] = names.at(materials[k / 3]);
  }
  for (std::size_t k = 0; k < indices.size(); k += 3) {
    demand(std::max({indices[k], indices[k + 1], indices[k + 2]}) < leaf.mesh.vertices.size(), "an index beyond the vertices");
    leaf.mesh.triangles.push_back({indices[k], indices[k + 1], indices[k + 2]});
  }
  mesh::canonicalize(leaf.mesh);
}

}  // namespace

std::size_t GlbFile::triangles() const {
  std::size_t sum = 0;
  for (const GlbLeaf& leaf : leaves) sum += leaf.mesh.triangles.size();
  return sum;
}

std::vector<mesh::LeafMesh> GlbFile::meshes() const {
  std::vector<mesh::LeafMesh> out;
  for (const GlbLeaf& leaf : leaves) out.push_back(leaf.mesh);
  return out;
}

GlbFile readGlb(std::string_view bytes) {
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v = 0;
    demand(at + 4 <= bytes.size(), "it ends early");
    std::memcpy(&v, bytes.data() + at, 4);
    return v;
  };
  demand(bytes.substr(0, 4) == "glTF" && u32(4) == 2 && u32(8) == bytes.size() && bytes.substr(16, 4) == "JSON", "its container");
  GlbFile out;
  const std::uint32_t length = u32(12);
  out.json = Json::parse(bytes.substr(20, length));
  std::string_view bin;
  if (20 + length < bytes.size()) bin = bytes.substr(28 + length, u32(20 + length));
  const Reader reader{out.json, bin};
  const Json& extras = out.json.at("asset").at("extras");
  const auto originX = extras.at("origin").at("x").get<double>() * 256, originZ = extras.at("origin").at("z").get<double>() * 256;
  if (extras.contains("cellX"))
    demand(extras.at("cellX").get<double>() * (1 << 20) == originX && extras.at("cellZ").get<double>() * (1 << 20) == originZ, "its cell");
  for (const Json& index : out.json.at("scenes").at(0).at("nodes")) {
    const Json& node = out.json.at("nodes").at(index.get<std::size_t>());
    GlbLeaf leaf;
    const Json& e = node.at("extras");
    leaf.mesh.address = {e.at("level").get<int>(), static_cast<std::int64_t>(e.at("i").get<double>()),
                         static_cast<std::int64_t>(e.at("j").get<double>())};
    leaf.translation = node.value("translation", std::array<double, 3>{});
    demand(!node.contains("rotation") && !node.contains("matrix") && !node.contains("scale"), "a leaf that is not only moved");
    demand(e.at("side").get<double>() * 256 == static_cast<double>(leaf.mesh.address.side()), "a leaf's side");
    demand(leaf.translation[0] * 256 + originX == static_cast<double>(leaf.mesh.address.x()) &&
               leaf.translation[2] * 256 + originZ == static_cast<double>(leaf.mesh.address.z()),
           "a leaf that does not lie at its address");
    if (node.contains("mesh")) {
      const Json& primitives = out.json.at("meshes").at(node.at("mesh").get<std::size_t>()).at("primitives");
      demand(primitives.size() == 1, "more than one primitive");
      readPrimitive(reader, primitives[0], leaf);
    }
    out.leaves.push_back(std::move(leaf));
  }
  return out;
}

}  // namespace ridgecast::testing_support
