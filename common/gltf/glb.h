#pragma once
// A mesh of leaves as one binary glTF file (.glb), plain or compressed by Draco.
//
// One glTF node a leaf, empty ones included (those have no mesh):
//   node.extras        {level, i, j, side}: the leaf's address, side in metres
//   node.translation   the leaf's corner (least x and z, y 0) in metres relative to the corner of the file's 4,096 m cell
//   POSITION           metres relative to that corner; all are multiples of 1/256 m and exact in a float, compressed or not
//   NORMAL             unit; compressed: within half a degree
//   COLOR_0            linear, 16 bits; compressed: 8 bits (see kColourBits)
//   asset.extras       cellX, cellZ (the cell, integers: metres / 4,096), latticeStep (metres) and what the caller adds
// Triangles are counter-clockwise seen from above. A camera is the only node of a scene of its own, the second one, so that the nodes of
// the first have translations alone; its rotation is yaw, then pitch. Equal documents give equal bytes. Pure functions; any thread.
// What Draco cannot shrink: a leaf takes some 600 bytes of JSON (a node with its extras, a mesh, four accessors, a buffer view), compressed or
// not, and Draco's own description of a mesh with three attributes 230. Against the plain file: a box of many triangles a fifth, a pose at 0.3
// pixels 0.23; the default pose at 0.6 pixels 0.35, since 989 of its 1,476 leaves are grids of eight triangles. There the JSON alone is 0.16 and
// the 325 leaves with detail 0.13, so 0.30 if the small leaves took no bytes at all (compare the sizes of snapshot.glb?x=0&z=0&altitude=120&
// yaw=0&pitch=-10 with and without compression=draco). Tried on that file: Draco's sequential coding (281 kB for the small leaves, 275 now),
// its other speeds (2 % either way), seven bits for normals and colours (0.33). Accessors are not shared between leaves, although glTF
// allows it: several importers, tinygltf among them, keep what Draco decoded by accessor. Extras stay at their nodes, where readers look.
// tinygltf stays in glb.cpp, Draco in draco_primitive.cpp.

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

inline constexpr int kColourBits = 8;  // of a channel where Draco compresses

enum class Compression { kNone, kDraco };

struct Leaf {
  const mesh::LeafMesh* mesh = nullptr;               // canonical; lives as long as the document
  std::vector<std::array<float, 3>> normals;          // of every vertex, or none
  std::vector<std::array<std::uint16_t, 3>> colours;  // linear, 65535 is 1; of every vertex, or none
};

struct Document {
  lattice::Point origin;  // the file's cell is the one that holds it
  std::vector<Leaf> leaves;
  std::optional<camera::Camera> camera;
  std::string extras = "{}";  // JSON object, added to asset.extras
};

// Calls its body for every index below the count, in whatever order, by as many threads as there are; returns when all are done.
using ForEach = std::function<void(std::size_t count, const std::function<void(std::size_t)>& body)>;

// `forEach`: leaves are compressed by it; none: one after the other. Equal bytes either way.
// Errors: the mesh is too large for a .glb (4 GiB), a leaf's coordinates are not exact in a float (they reach 65 km), or `stop` was
// requested.
Outcome<std::string> writeGlb(const Document& document, Compression compression, std::stop_token stop = {}, const ForEach& forEach = {});

}  // namespace ridgecast::gltf
