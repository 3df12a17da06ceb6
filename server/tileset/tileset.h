#pragma once
// Tilesets of 3D Tiles 1.1 (OGC 22-025r4) over the lattice's quadtree, as JSON.
//
// The root tileset covers what is asked for with squares of one level; each is a tileset of its own, which has three levels of tiles and
// refers to the tilesets of the fourth, down to the finest level. All are explicit, and refine by replacing. A tile's geometricError is
// the error that it keeps (tile.h) and, on the globe, dropOf. Every tile has its own frame (frameOf) and a `transform` into its parent's,
// in doubles, so that coordinates stay small. On the globe each tile lies on the plane that touches it at the tile's middle
// (earth::Placement): a vertex is then off by at most dropOf, 0.4 of the error of a server's tiles that are 131 km wide and 0.003 of it at
// 1 km. Vertices that neighbours share are the same bits in the world's coordinates; on the globe they part by height x side / radius,
// 0.5 m at 3,000 m above the ellipsoid and 1 km a side, which skirts cover.
//
// Axes: 3D Tiles has z up; viewers turn glTF's (x, y, z) to (x, -z, y). So here x is east, y is north (-z of the lattice), z is up.
//
// Boxes hold a tile with its skirt. Those of a terrain do not wait for the tile's mesh: each square of the tileset's last level has
// 33 x 33 samples, and its heights are theirs, widened by the largest bound in the square of what lies between samples. box::Samples says
// how that is known: by measured second differences with a margin of four, and by proof where the samples are as close as the posts of a
// height map. Over a map the box keeps to the map's own range.
//
// Pure functions; any thread.

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"
#include "server/earth/earth.h"

namespace ridgecast::tileset {

inline constexpr int kLevels = 3;                                                       // of tiles in a tileset
inline constexpr double kUsualReach = 200'000, kMinReach = 100, kMaxReach = 1'000'000;  // metres

struct Question {
  lattice::Point middle;       // lies at the place, with height 0 at the place's height
  earth::Where where;          // without `at` and a map that says where: the root's axes are the terrain's own, relative to `middle`
  bool isPrivate = false;      // where the map lies is not told
  double reach = kUsualReach;  // metres: covered in all four directions, at least
};

// What a tileset says of a tile.
struct Known {
  lattice::Point low, high;        // steps: what it covers
  double lowest = 0, highest = 0;  // metres, with the skirt
  double error = 0;                // metres
  void include(const Known& other);
};

// Tiles down to a level, wherever their heights are known from.
struct Pyramid {
  std::function<std::optional<Known>(lattice::LeafAddress)> tile;  // empty: there is none
  int finest = 0;
  std::string query;                               // behind each URI's name
  std::optional<earth::Placement> placement = {};  // empty: the world stays a plane
};

struct Root {
  std::vector<lattice::LeafAddress> squares;  // of one level
  lattice::Point origin;                      // of the root's axes: x east, y north, z up
  double error = 0;         // metres: the root shows nothing, so it is refined while any of it is larger than a few pixels
  std::string extras = {};  // JSON object, of the asset
};

// JSON. URIs of the root are relative to the tilesets' folder: LEVEL/I/J.json?QUERY, or .glb at the finest level. The tileset of a tile
// lies at LEVEL/I/J.json below that folder; its URIs: ../../LEVEL/I/J.glb?QUERY or .json?QUERY
std::string rootTileset(const Pyramid& pyramid, const Root& root);
std::string tilesetOf(const Pyramid& pyramid, lattice::LeafAddress square);

// The same of a terrain, down to level 0.
std::string rootTileset(const terrain::Terrain& terrain, const Question& question, std::string_view query);
std::string tilesetOf(const terrain::Terrain& terrain, const Question& question, lattice::LeafAddress square, std::string_view query);

}  // namespace ridgecast::tileset
