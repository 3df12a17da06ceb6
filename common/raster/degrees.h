#pragma once
// Height maps in degrees, and the plane that they are laid on.
//
// The plane touches WGS 84 (a = 6,378,137 m, f = 1 / 298.257223563) at the map's middle; x points east, -z north. A place of longitude l
// and latitude p lies at
//
//   x     = N cos p sin(l - l0)
//   north = N (1 - e2) sin p cos p0 + e2 N0 sin p0 cos p0 - N cos p sin p0 cos(l - l0)
//
// with e2 = f (2 - f), N = a / sqrt(1 - e2 sin2 p), and l0, p0, N0 of the middle (the orthographic projection; PROJ: +proj=ortho). Heights
// stay as they are, above the ellipsoid or the sea: the curve of the Earth is left out. Lengths away from the middle are short by their
// share d^2 / (2 R^2): at 100 km by 1 m in 8 km.
//
// The samples on the plane are bicubic (Catmull-Rom) between the file's, on the largest rectangle around the middle that the file covers.
// Samples spaced as the file's would smooth it, by metres in mountains; at a quarter of that spacing, by some thirty times less. So unless
// pitch= says otherwise they are kCloser times as dense as the file's denser ones, half of that or as dense, as kMaxCloser allows.

#include <cstdint>
#include <optional>
#include <string>

#include "common/outcome/outcome.h"
#include "common/raster/samples.h"

namespace ridgecast::raster {

// Rows from the north, columns from the west; degrees.
struct DegreeGrid {
  double west = 0, north = 0;   // of the first sample
  double stepX = 0, stepY = 0;  // from one sample to the next, positive
};

// The EPSG number of the UTM zone, or of the polar one, at a place; degrees, longitudes also beyond 180.
int utmZone(double longitude, double latitude);

// The refusal of a map that is to be in metres; names the UTM zone of its middle.
Error inDegrees(const std::string& name, const DegreeGrid& grid, std::uint32_t width, std::uint32_t height);

inline constexpr std::uint32_t kCloser = 4;
inline constexpr std::uint64_t kMaxCloser = std::uint64_t{1} << 24;  // samples that are closer than the file's

struct OnPlane {
  Samples samples;       // the middle one lies at the map's middle
  double pitch;          // metres
  double error;          // metres: the most that the ground on the plane differs from the file's samples
  std::uint64_t beyond;  // of the file's samples, that lie outside the rectangle
  std::string crs;       // for PROJ
};

// `pitch`: metres between samples; empty: by the file. Error: the map is wider than 10 degrees, reaches a pole, or is too small; no room.
Outcome<OnPlane> onPlane(const std::string& name, const Samples& source, const DegreeGrid& grid, std::optional<double> pitch,
                         std::uint64_t inMemory, std::uint64_t most);

}  // namespace ridgecast::raster
