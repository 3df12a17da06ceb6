#pragma once
// A mesh of leaves as one binary glTF file (.glb), plain or compressed by Draco.
//
// One glTF node a leaf, or square with small leaves that the caller joined; empty ones included (those have no mesh):
//   node.extras        {level, i, j, side}: the leaf's address, side in metres
//   node.name          of leaves that have a name; also of its mesh
//   node.translation   the leaf's corner (least x and z, y 0) in metres relative to the file's origin
//   POSITION           metres relative to that corner; all are multiples of 1/256 m and exact in a float, compressed or not
//   NORMAL             unit; compressed: within half a degree
//   COLOR_0            linear, 16 bits; compressed: 8 bits (see kColourBits)
//   TEXCOORD_0         with a texture alone: 0, 0 at its least x and z
//   _FEATURE_ID_0      what the ground is made of (terrain/materials.h), a row of the file's table of names (EXT_mesh_features,
//                      EXT_structural_metadata)
//   asset.extras       origin {x, z} (metres to add to a coordinate of the file), latticeStep (metres), what the caller adds, and
//                      cellX, cellZ if the origin is the corner of a 4,096 m cell (integers: metres / 4,096)
// Triangles are counter-clockwise seen from above. A camera is the only node of the second scene, so that the first scene's nodes have
// translations alone; its rotation is yaw, then pitch. Equal documents give equal bytes. Pure functions; any thread.
//
// Size: a leaf takes some 600 bytes of JSON (a node with its extras, a mesh, four accessors, a buffer view), compressed or not, and Draco's
// description of three attributes takes 230: callers join small leaves. Compressed against plain: 0.18 to 0.23 for poses, 1/5 for a box of
// many triangles. Leaves do not share accessors, although glTF allows it: several importers, tinygltf among them, cache Draco's output by
// accessor. tinygltf stays in glb.cpp, Draco in draco_primitive.cpp.

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/outcome.h"

namespace ridgecast::gltf {

inline constexpr int kColourBits = 8;  // of a channel compressed by Draco

enum class Compression { kNone, kDraco };

struct Leaf {
  const mesh::LeafMesh* mesh = nullptr;               // lives as long as the document
  std::vector<std::array<float, 3>> normals;          // of every vertex, or empty
  std::vector<std::array<std::uint16_t, 3>> colours;  // linear, 65535 is 1; of every vertex, or empty
  std::vector<std::uint8_t> materials;                // of every vertex, or empty
  std::string name = {};
};

// A picture laid upon the mesh from above, instead of colours.
struct Texture {
  std::string png;
  lattice::Point low, high;  // steps: what it covers; its first row lies at the least z
};

struct Document {
  lattice::Point origin;  // the file's origin is the corner of the 4,096 m cell that contains it...
  bool atOrigin = false;  // ...or this point itself
  std::vector<Leaf> leaves;
  std::optional<Texture> texture;          // of a plain file
  std::vector<std::string> materialNames;  // by their numbers, the first empty; none: no leaf has materials
  std::optional<camera::Camera> camera;
  std::string extras = "{}";  // JSON object, added to asset.extras
};

lattice::Point originOf(const Document& document);  // where the file's coordinates begin

// Calls its body for every index below the count, in any order, on any number of threads; returns when all are done.
using ForEach = std::function<void(std::size_t count, const std::function<void(std::size_t)>& body)>;

// `forEach` compresses the leaves; without it, one after another. The bytes are equal either way. Errors: the mesh is too large for a .glb
// (4 GiB), a leaf's coordinates are not exact in a float (odd numbers of steps reach 65 km), or `stop` was requested.
Outcome<std::string> writeGlb(const Document& document, Compression compression, std::stop_token stop = {}, const ForEach& forEach = {});

}  // namespace ridgecast::gltf
