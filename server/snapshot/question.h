#pragma once
// What a snapshot can request: a live camera, a pose, or a box at an error. Converts URL parameters to values within limits, or to one
// sentence that says which limit was exceeded and what would fit. Metres and degrees outside, steps and radians inside. Pure functions.
//
//   camera=ID                                                exactly the mesh that this camera's client holds
//   x z altitude yaw pitch [fov width height threshold colour_error]
//                                                            refined until it settles; y instead of altitude: absolute height
//   x0 z0 x1 z1 error                                        covered exactly, at most `error` metres off vertically
//   box=all error                                            the same for the whole height map
//   texture=SIZE                                             of a box in a .glb, instead of colours of vertices: a picture of the terrain's
//                                                            colours with so many pixels along the longer side; sharp shores and rivers
//   at=LON,LAT[,HEIGHT]                                      of a box in tiles: where on WGS84 its middle lies, degrees and metres
//   compression=draco|none, normals=0|1, colours=0|1         for all; default none, 1 and 1
//   origin=cell|centre|world                                 where the file's coordinates begin: the corner of the 4,096 m cell of the
//                                                            camera or of the box's first corner (default), the camera or the middle of
//                                                            the box, or the world's own origin
//   up=y|z                                                   of a PLY or OBJ file: y (default), as in glTF, or z, with y north
// Any other parameter is an error, so that a misspelt one is not silently ignored.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "common/camera/camera.h"
#include "common/gltf/glb.h"
#include "common/outcome/outcome.h"
#include "common/terrain/raster.h"
#include "server/box/box_mesh.h"
#include "server/tileset/tile.h"
#include "server/tileset/tileset.h"

namespace ridgecast::snapshot {

struct Limits {
  std::uint32_t triangles = 2'000'000;
  double seconds = 60;
  double share = 0.1;        // of all cores, while cameras work
  double boxSide = 32'768;   // metres, the longest
  int partBits = 12;         // larger boxes of a height map are meshed in parts, lattice squares of at most 2^12 samples a side
  double leastError = 0.02;  // metres, of a box
  double mostError = 1'000;
  std::uint32_t leastTexture = 16, mostTexture = 4'096;  // pixels
  double leastThreshold = 0.05, mostThreshold = 1'000;   // pixels
};

struct OfCamera {
  std::uint64_t id = 0;
};
struct OfPose {
  camera::Camera camera;  // pose.y is the altitude above the ground if aboveGround
  bool aboveGround = true;
  double threshold = 0.6;  // pixels
  double colourError = 0;  // as of settings::Settings
};
using OfBox = box::Box;
using OfTile = tileset::Wanted;

class Parameters;

enum class Origin { kCell, kCentre, kWorld };
enum class Format { kGlb, kPly, kObj, kTiles };

struct Question {
  std::variant<OfCamera, OfPose, OfBox, OfTile> of;
  Format format = Format::kGlb;  // by the name of the file, not by a parameter
  earth::Where where;            // of kTiles
  Origin origin = Origin::kCell;
  bool isZUp = false;         // kPly, kObj
  std::uint32_t texture = 0;  // pixels; 0: none
  gltf::Compression compression = gltf::Compression::kNone;
  bool normals = true, colours = true;
};

// `query` is the part of a URL after the ?, still percent-encoded; `map`: the terrain's, if it is a height map.
Outcome<Question> parse(std::string_view query, const Limits& limits, const terrain::Raster* map = nullptr, Format format = Format::kGlb);

// By its ending: .glb, .ply or .obj. Tiles are no file.
std::optional<Format> formatOf(std::string_view file);

// Takes compression, normals and colours.
void readForm(Parameters& parameters, Question& out);
// Takes at and heights, which by default count from the sea, or from the ellipsoid if `at` has a height.
earth::Where readWhere(Parameters& parameters);

// Equal questions give equal text, however they were spelt. For an ETag.
std::string canonical(const Question& question);

}  // namespace ridgecast::snapshot
