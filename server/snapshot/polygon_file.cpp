#include "server/snapshot/polygon_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <vector>

#include "common/outcome/contract.h"

namespace ridgecast::snapshot {
namespace {

using lattice::Step;

static_assert(std::endian::native == std::endian::little);

struct Vertex {
  Step x, z;  // from the file's origin
  std::int32_t y;
  std::uint32_t leaf, index;
};

// The document's vertices, each once, and its triangles by their numbers.
struct Welded {
  std::vector<Vertex> vertices;
  std::vector<std::vector<std::uint32_t>> numbers;  // by leaf and vertex
  std::uint64_t triangles = 0;
  bool normals = false, colours = false;
};

Outcome<Welded> weld(const gltf::Document& document) {
  Welded out;
  const lattice::Point origin = gltf::originOf(document);
  std::vector<Vertex> all;
  for (std::uint32_t l = 0; l < document.leaves.size(); ++l) {
    const auto& [leaf, normals, colours, materials, name] = document.leaves[l];
    const mesh::LeafMesh& mesh = *leaf;
    for (const std::size_t count : {normals.size(), colours.size()})
      expects(count == 0 || count == mesh.vertices.size(), "each vertex has its normal and colour, or none has");
    out.triangles += mesh.triangles.size();
    out.normals = out.normals || !document.leaves[l].normals.empty();
    out.colours = out.colours || !document.leaves[l].colours.empty();
    out.numbers.emplace_back(mesh.vertices.size());
    for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v)
      all.push_back(
          {mesh.address.x() + mesh.vertices[v].x - origin.x, mesh.address.z() + mesh.vertices[v].z - origin.z, mesh.vertices[v].y, l, v});
  }
  if (all.size() > std::numeric_limits<std::uint32_t>::max() || out.triangles > std::numeric_limits<std::uint32_t>::max())
    return Error{"the mesh has more vertices than such a file can count: ask for less"};
  std::ranges::sort(all, [](const Vertex& a, const Vertex& b) {
    return a.z != b.z ? a.z < b.z : a.x != b.x ? a.x < b.x : a.leaf < b.leaf;
  });
  for (const Vertex& v : all) {
    if (out.vertices.empty() || out.vertices.back().x != v.x || out.vertices.back().z != v.z) out.vertices.push_back(v);
    out.numbers[v.leaf][v.index] = static_cast<std::uint32_t>(out.vertices.size() - 1);
  }
  return out;
}

using lattice::metres;

double srgb(std::uint16_t linear) {
  const double v = linear / 65535.0;
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
}

// The metadata, each line behind `mark`.
std::string comments(const gltf::Document& document, bool isZUp, const char* mark) {
  std::string out = std::string(mark) + " Ridgecast: metres, " + (isZUp ? "+Z up, x east, y north" : "+Y up, x east, -z north") + "\n";
  out += std::string(mark) + " " + document.extras + "\n";
  return out;
}

template <class T>
std::array<T, 3> axes(const std::array<T, 3>& v, bool isZUp) {
  return isZUp ? std::array<T, 3>{v[0], T{0} - v[2], v[1]} : v;  // no -0
}

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

void putNumber(std::string& out, double value) {
  char text[40];
  out.append(" ").append(text, std::to_chars(text, text + sizeof text, value, std::chars_format::fixed).ptr);
}

std::string plyHead(const gltf::Document& document, bool isZUp, const Welded& welded, bool narrow) {
  std::string out = "ply\nformat binary_little_endian 1.0\n" + comments(document, isZUp, "comment");
  out += "element vertex " + std::to_string(welded.vertices.size()) + "\n";
  for (const char* name : {"x", "y", "z"}) out += std::string("property ") + (narrow ? "float " : "double ") + name + "\n";
  if (welded.normals) out += "property float nx\nproperty float ny\nproperty float nz\n";
  if (welded.colours) out += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  return out + "element face " + std::to_string(welded.triangles) + "\nproperty list uchar uint vertex_indices\nend_header\n";
}

constexpr std::size_t kPatience = 1 << 16;  // vertices between two looks at `stop`
const Error kStopped{"nobody waits for the file any more"};

}  // namespace

Outcome<std::string> writePly(const gltf::Document& document, bool isZUp, const std::stop_token& stop) {
  const auto welded = weld(document);
  if (!welded) return welded.error();
  constexpr Step kExact = Step{1} << 24;
  const bool narrow =
      std::ranges::all_of(welded->vertices, [](const Vertex& v) { return std::abs(v.x) <= kExact && std::abs(v.z) <= kExact; });
  std::string out = plyHead(document, isZUp, *welded, narrow);
  std::size_t written = 0;
  for (const Vertex& v : welded->vertices) {
    if (++written % kPatience == 0 && stop.stop_requested()) return kStopped;
    const gltf::Leaf& leaf = document.leaves[v.leaf];
    for (const double p : axes(std::array{metres(v.x), metres(v.y), metres(v.z)}, isZUp))
      narrow ? put(out, static_cast<float>(p)) : put(out, p);
    if (welded->normals)
      for (const float n : axes(leaf.normals[v.index], isZUp)) put(out, n);
    if (welded->colours)
      for (const std::uint16_t c : leaf.colours[v.index]) put(out, static_cast<std::uint8_t>(std::lround(srgb(c) * 255)));
  }
  for (std::size_t l = 0; l < document.leaves.size(); ++l)
    for (const mesh::Triangle& t : document.leaves[l].mesh->triangles) {
      put(out, std::uint8_t{3});
      for (const std::uint32_t v : t) put(out, welded->numbers[l][v]);
    }
  return {boost::system::in_place_value, std::move(out)};
}

Outcome<std::string> writeObj(const gltf::Document& document, bool isZUp, const std::stop_token& stop) {
  const auto welded = weld(document);
  if (!welded) return welded.error();
  std::string out = comments(document, isZUp, "#"), normals;
  std::size_t written = 0;
  for (const Vertex& v : welded->vertices) {
    if (++written % kPatience == 0 && stop.stop_requested()) return kStopped;
    const gltf::Leaf& leaf = document.leaves[v.leaf];
    out += "v";
    for (const double p : axes(std::array{metres(v.x), metres(v.y), metres(v.z)}, isZUp)) putNumber(out, p);
    if (welded->colours)
      for (const std::uint16_t c : leaf.colours[v.index]) putNumber(out, std::round(srgb(c) * 10'000) / 10'000);
    out += "\n";
    if (!welded->normals) continue;
    normals += "vn";
    for (const float n : axes(leaf.normals[v.index], isZUp)) putNumber(normals, std::round(n * 10'000.0) / 10'000);
    normals += "\n";
  }
  out += normals;
  for (std::size_t l = 0; l < document.leaves.size(); ++l)
    for (const mesh::Triangle& t : document.leaves[l].mesh->triangles) {
      out += "f";
      for (const std::uint32_t v : t) {
        const std::string number = std::to_string(welded->numbers[l][v] + std::uint64_t{1});
        out.append(" ").append(number);
        if (welded->normals) out.append("//").append(number);
      }
      out += "\n";
    }
  return {boost::system::in_place_value, std::move(out)};
}

}  // namespace ridgecast::snapshot
