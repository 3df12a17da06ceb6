#pragma once
// Places on the ellipsoid WGS84, planes laid on it, and the grids of maps.
//
// Matrices are 4 x 4, by columns, from metres of a plane (x east, y north, z up) to the Earth's axes (EPSG:4978).

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/terrain/raster.h"

namespace ridgecast::earth {

using Matrix = std::array<double, 16>;

struct Place {
  double longitude = 0, latitude = 0, height = 0;  // radians, metres above the ellipsoid
};

// The vertical datum of a world's heights.
enum class Heights { kEllipsoid, kSea };

// What a question says of where a world lies.
struct Where {
  std::optional<Place> at;  // empty: where the map says
  Heights heights = Heights::kSea;
};

// Metres of the mean sea (EGM96) above the ellipsoid at a place; empty: PROJ's grid is not installed (Debian: proj-data).
std::optional<double> seaLevel(const Place& place);

// LON,LAT or LON,LAT,HEIGHT: degrees within 360 and 90, metres within 10,000,000. Empty: anything else.
std::optional<Place> placeOf(std::string_view text);

// The plane that touches the ellipsoid at a place. With a = 6,378,137 m, e^2 = f (2 - f), f = 1 / 298.257223563,
// N = a / sqrt(1 - e^2 sin^2 lat):
//   east  = (-sin lon, cos lon, 0)
//   north = (-sin lat cos lon, -sin lat sin lon, cos lat)
//   up    = (cos lat cos lon, cos lat sin lon, sin lat)
//   place = ((N + h) cos lat cos lon, (N + h) cos lat sin lon, (N (1 - e^2) + h) sin lat)
Matrix eastNorthUp(const Place& place);

// The grid of a projected CRS, EPSG:N or +proj=..., by PROJ, with the best transformation to WGS84 that needs only installed grids. One
// thread.
class Grid {
 public:
  // With the transformation that is best `about` a place on it. Each thread keeps the last kKeptGrids: making one takes tens of
  // milliseconds.
  // Null: PROJ does not know it, or not as projected.
  static constexpr std::size_t kKeptGrids = 4;
  static const Grid* of(const std::string& crs, const terrain::GridPlace& about);
  // A map's, about the world's origin; null also: the map does not say where it lies.
  static const Grid* of(const terrain::Raster& map);
  ~Grid();
  // Metres of EPSG:4978, and from degrees; empty: there is no such place.
  std::optional<std::array<double, 3>> onEarth(const terrain::GridPlace& at) const;
  std::optional<terrain::GridPlace> at(double longitude, double latitude) const;
  std::optional<std::array<double, 2>> degrees(const terrain::GridPlace& at) const;  // longitude, latitude

 private:
  struct Projection;
  Grid(const std::string& crs, const terrain::GridPlace& about);
  std::unique_ptr<Projection> projection_;
};

// The plane of a grid around one of its places: it touches the ellipsoid there, turned and scaled as the grid is, by its CRS as
// terrain::RasterOrigin has it, and metres. Empty: PROJ does not know the CRS, or it has no such place.
std::optional<Matrix> onEarth(const std::string& crs, const terrain::GridPlace& about, const terrain::GridPlace& at);

// By how much a map's grid is turned against true east at a place of the world, northwards. Empty: the map does not say where it lies.
struct Turn {
  double cosine = 1, sine = 0;
};
std::optional<Turn> turnOf(const terrain::Raster& map, lattice::Point origin);

// Places of a world as people have them: longitudes and latitudes (WGS84), or eastings and northings of a CRS. A value; one thread at a
// time.
class Coordinates {
 public:
  // `crs`: lonlat or EPSG:N. Error, one sentence: another, one that PROJ does not know as projected, or a map that does not say where it
  // lies (null: there is none, or it is private).
  static Outcome<Coordinates> of(const terrain::Raster* map, std::string_view crs);
  // Metres of the world, x and z; empty: the map's CRS does not reach there.
  std::optional<std::array<double, 2>> world(double first, double second);
  // Its inverse, near what was asked first.
  std::optional<std::array<double, 2>> fromWorld(double x, double z) const;
  // North at a place, as a unit vector of the world: x and z.
  std::optional<std::array<double, 2>> north(double first, double second);

 private:
  std::string crs_, mapCrs_;
  terrain::GridPlace origin_;                // of the world, on the map's grid
  std::optional<terrain::GridPlace> about_;  // of what is asked first
};

// a, then b.
Matrix product(const Matrix& b, const Matrix& a);
Matrix inverse(const Matrix& affine);

// How a world, which is a plane, lies on the globe: where the map's grid has it or, at a chosen place, by distance and azimuth from there
// (PROJ: aeqd), turned from north as the map's grid is at its own place. Each place has its own plane, so nothing hangs above the curve of
// the Earth. Heights count from the ellipsoid, or from the sea (EGM96), which lies up to 100 m below or above it.
class Placement {
 public:
  // `origin` lies at `at`, if that is given. Empty: neither that nor the map says where.
  static std::optional<Placement> of(const terrain::Raster* map, lattice::Point origin, const Where& where);
  // From metres of x east, y north, z up of a place of the world to EPSG:4978; empty: the CRS does not reach there.
  std::optional<Matrix> at(lattice::Point place) const;
  Heights heights() const { return heights_; }  // the ellipsoid's also where the sea's are not known

 private:
  std::string crs_;
  terrain::GridPlace grid_;  // of origin_
  lattice::Point origin_;
  Turn turn_;  // from the grid's east to x
  double height_ = 0;
  Heights heights_ = Heights::kEllipsoid;
};

}  // namespace ridgecast::earth
