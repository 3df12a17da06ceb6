#pragma once
// Tiles of web maps over a world that has no longitude: where on Earth its origin lies is the viewer's choice.
//
// A place of the world is laid on the Web Mercator plane (EPSG:3857; sphere of radius R = 6,378,137 m) by one scale, that of the origin:
//
//   X = X0 + x / cos(latitude0),  Y = Y0 - z / cos(latitude0)      X0, Y0: Mercator metres of the origin; x east, -z north
//   X = R longitude,  Y = R ln tan(pi / 4 + latitude / 2)
//
// So a tile is a square of the world, and a metre of the world is a metre of Earth along the origin's parallel; a viewer shows it
// cos(latitude) / cos(latitude0) times as long on others (at 47 degrees 1.6 % a degree). A map whose file says where it lies needs no
// choice: there each corner of 32 x 32 pixels lies where its longitude and latitude do on the map's grid. Level z divides Earth into 2^z x
// 2^z tiles, x from longitude -180, y from latitude 85.05 southwards: a higher level is finer here, unlike a leaf's.

#include <cstdint>
#include <optional>
#include <string_view>

#include "common/lattice/lattice.h"
#include "common/terrain/raster.h"
#include "server/map/sheet.h"

namespace ridgecast::map {

inline constexpr int kFinestTileLevel = 24;  // pixels of 1 cm
inline constexpr std::uint32_t kTilePixels = 256;
inline constexpr double kMaxLatitude = 85;  // degrees, of an origin

struct Place {
  double longitude = 0, latitude = 0;  // degrees
};

// LON,LAT: longitude within 180, latitude within kMaxLatitude. Empty: anything else.
std::optional<Place> placeOf(std::string_view text);

struct TileAddress {
  int level = 0;               // 0..kFinestTileLevel
  std::uint32_t x = 0, y = 0;  // below 2^level
  bool isValid() const { return level >= 0 && level <= kFinestTileLevel && x >> level == 0 && y >> level == 0; }
};

// The pixels of a tile. `origin`: where the world's x 0, z 0 lies. A map laid there keeps the rotation from north that its grid has at its
// own place.
Sheet sheetOf(const TileAddress& tile, const Place& origin, const terrain::Raster* map = nullptr);

// The same where the map itself says that it lies; empty: it does not, or its CRS does not reach the tile.
std::optional<Sheet> sheetOf(const TileAddress& tile, const terrain::Raster& map);

// The rectangle of longitudes and latitudes around a part of the world, laid at `origin` or where its map says that it lies, in degrees;
// all longitudes where it lies across the 180th meridian. Empty: as above.
struct Bounds {
  double west = -180, south = -85.051129, east = 180, north = 85.051129;
};
std::optional<Bounds> boundsOf(const lattice::Area& part, const terrain::Raster* map, const std::optional<Place>& origin);
// The tiles of a level that it meets.
struct TileRange {
  std::uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // with both ends
  std::uint64_t count() const { return std::uint64_t{x1 - x0 + 1} * (y1 - y0 + 1); }
};
TileRange tilesOf(const Bounds& bounds, int level);

// The coarsest level whose pixels are as fine as the map's samples.
int finestLevelOf(const terrain::RasterShape& map, double latitude);

// Whether all of the pixels lie outside the map's samples.
bool isBeside(const Sheet& sheet, const terrain::RasterShape& map);

// Terrarium: height = red * 256 + green + blue / 256 - 32,768 metres. Rounded to the nearest 1/256 m; clamped to what the encoding holds.
void terrarium(float height, std::uint8_t* rgb);

}  // namespace ridgecast::map
