#pragma once
// What a snapshot can request: a live camera, a pose, or a box at an error. Converts URL parameters to values within limits, or to one
// sentence that says which limit was exceeded and what would fit. Metres and degrees outside, steps and radians inside. Pure functions.
//
//   camera=ID                                                exactly the mesh that this camera's client holds
//   x z altitude yaw pitch [fov width height threshold colour_error]
//                                                            refined until it settles; y instead of altitude: absolute height
//   x0 z0 x1 z1 error                                        covered exactly, at most `error` metres off vertically
//   box=X0,Z0,X1,Z1 error                                    the same
//   box=WEST,SOUTH,EAST,NORTH crs error                      of a map that says where it lies, by longitudes and latitudes (crs=lonlat) or
//                                                            a CRS (crs=EPSG:N): the least box of the world around that one
//   box=all error                                            the whole height map
//   a box and spacing=METRES                                 of a .tif: samples so far apart, from the box's first corner; without it
//                                                            those of the height map that lie in the box
//   a box, layer=heights|colours, zoom, at=LON,LAT           of a .pmtiles: the finest level, by default as fine as the map's samples, and
//                                                            where the world's origin lies, by default where the map says
//   at=LON,LAT[,HEIGHT]                                      of a box in tiles: where on WGS84 its middle lies, degrees and metres
//   compression=draco|none, normals=0|1, colours=0|1         for all; default none, 1 and 1
//   materials=0|1                                            of a .glb and tiles: what the ground is made of, by vertex (glb.h); default 0
//   origin=cell|centre|world                                 where the file's coordinates begin: the corner of the 4,096 m cell of the
//                                                            camera or of the box's first corner (default), the camera or the middle of
//                                                            the box, or the world's own origin
//   up=y|z                                                   of a PLY or OBJ file: y (default), as in glTF, or z, with y north
// Any other parameter is an error, so that a misspelt one is not silently ignored.

#include <array>
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
#include "server/map/mercator.h"
#include "server/map/sheet.h"
#include "server/snapshot/attributes.h"
#include "server/tileset/tile.h"
#include "server/tileset/tileset.h"

namespace ridgecast::snapshot {

struct Limits {
  std::uint32_t triangles = 2'000'000;
  double seconds = 60;
  double share = 0.1;                // of all cores, while cameras work
  double boxSide = 32'768;           // metres, the longest
  std::uint32_t samples = 1u << 24;  // of a grid
  int partBits = 12;                 // larger boxes of a height map are meshed in parts, lattice squares of at most 2^12 samples a side
  double leastError = 0.02;          // metres, of a box
  double mostError = 1'000;
  std::uint32_t leastTexture = 16, mostTexture = 4'096;  // pixels
  double leastThreshold = 0.05, mostThreshold = 1'000;   // pixels
  double leastSpacing = 0.01, mostSpacing = 1'000;       // metres
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
struct OfGrid {
  map::Sheet sheet;                                  // the middles of its pixels
  std::optional<std::array<std::int64_t, 2>> first;  // sample of the height map, along x and z, whose own these are; none: others
};
struct OfMapTiles {
  lattice::Area part;
  std::optional<map::Place> at;  // of the world's origin; none: where the map says
  std::optional<int> finest;     // none: as the map's samples
  bool colours = false;          // or heights
};

class Parameters;

enum class Origin { kCell, kCentre, kWorld };
enum class Format { kGlb, kPly, kObj, kTiff, kTiles, kArchive };

struct Question {
  std::variant<OfCamera, OfPose, OfBox, OfTile, OfGrid, OfMapTiles> of;
  Format format = Format::kGlb;  // by the name of the file, not by a parameter
  earth::Where where;            // of kTiles
  Origin origin = Origin::kCell;
  bool isZUp = false;         // kPly, kObj
  std::uint32_t texture = 0;  // pixels; 0: none
  gltf::Compression compression = gltf::Compression::kNone;
  Attributes attributes;
};

// `query` is the part of a URL after the ?, still percent-encoded; `map`: the terrain's, if it is a height map.
Outcome<Question> parse(std::string_view query, const Limits& limits, const terrain::Raster* map = nullptr, Format format = Format::kGlb);

// By its ending: .glb, .ply, .obj, .tif or .pmtiles. Tiles are no file.
std::optional<Format> formatOf(std::string_view file);

// Takes compression, normals, colours and materials.
void readForm(Parameters& parameters, Question& out);
// Takes at and heights, which by default count from the sea, or from the ellipsoid if `at` has a height.
earth::Where readWhere(Parameters& parameters);

// Equal questions give equal text, however they were spelt. For an ETag.
std::string canonical(const Question& question);

}  // namespace ridgecast::snapshot
