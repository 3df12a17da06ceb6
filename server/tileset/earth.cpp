#include "server/tileset/earth.h"

#include <proj.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>

#include "common/text/text.h"

namespace ridgecast::tileset {

namespace {

constexpr double kRadius = 6'378'137, kFlattening = 1 / 298.257223563, kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kRadians = std::numbers::pi / 180;

// A projected CRS on Earth. PROJ's objects belong to it.
class Projection {
 public:
  explicit Projection(const std::string& crs) : context_(proj_context_create()) {
    proj_log_level(context_, PJ_LOG_NONE);
    Object from(proj_create(context_, crs.c_str())), to(proj_create(context_, "EPSG:4978"));
    if (!from.get() || !to.get() || proj_get_type(from.get()) != PJ_TYPE_PROJECTED_CRS) return;
    const Object axes(proj_crs_get_coordinate_system(context_, from.get()));
    proj_cs_get_axis_info(context_, axes.get(), 0, nullptr, nullptr, nullptr, &unit_, nullptr, nullptr, nullptr);
    const Object plain(proj_create_crs_to_crs_from_pj(context_, from.get(), to.get(), nullptr, nullptr));
    if (plain.get()) way_.reset(proj_normalize_for_visualization(context_, plain.get()));
  }
  Projection(const Projection&) = delete;
  Projection& operator=(const Projection&) = delete;
  ~Projection() {
    way_.reset();
    proj_context_destroy(context_);
  }

  // Metres on the grid to metres of EPSG:4978; empty: there is no such place.
  std::optional<std::array<double, 3>> at(double easting, double northing) const {
    if (!way_) return std::nullopt;
    const PJ_COORD out = proj_trans(way_.get(), PJ_FWD, proj_coord(easting / unit_, northing / unit_, 0, HUGE_VAL));
    if (!std::isfinite(out.xyz.x) || !std::isfinite(out.xyz.y) || !std::isfinite(out.xyz.z)) return std::nullopt;
    return std::array{out.xyz.x, out.xyz.y, out.xyz.z};
  }

 private:
  struct Destroy {
    void operator()(PJ* p) const { proj_destroy(p); }
  };
  using Object = std::unique_ptr<PJ, Destroy>;
  PJ_CONTEXT* context_;
  Object way_;
  double unit_ = 1;  // metres
};

std::optional<double> valueOf(std::string_view text, std::string_view name) {
  const auto at = text.find(name);
  if (at == std::string_view::npos) return std::nullopt;
  text.remove_prefix(at + name.size());
  return text::number<double>(text::takePart(text, ' '));
}

}  // namespace

std::optional<Place> placeOf(std::string_view text) {
  std::array<double, 3> n{};
  for (std::size_t k = 0; k < n.size() && (k < 2 || !text.empty()); ++k) {
    const auto read = text::number<double>(text::takePart(text, ','));
    if (!read) return std::nullopt;
    n.at(k) = *read;
  }
  if (!text.empty() || std::abs(n[0]) > 360 || std::abs(n[1]) > 90 || std::abs(n[2]) > 1e7) return std::nullopt;
  return Place{n[0] * kRadians, n[1] * kRadians, n[2]};
}

Matrix eastNorthUp(const Place& place) {
  const double sinLon = std::sin(place.longitude), cosLon = std::cos(place.longitude);
  const double sinLat = std::sin(place.latitude), cosLat = std::cos(place.latitude);
  const double normal = kRadius / std::sqrt(1 - kEccentricity2 * sinLat * sinLat), out = (normal + place.height) * cosLat;
  return {-sinLon,
          cosLon,
          0,
          0,
          -sinLat * cosLon,
          -sinLat * sinLon,
          cosLat,
          0,
          cosLat * cosLon,
          cosLat * sinLon,
          sinLat,
          0,
          out * cosLon,
          out * sinLon,
          (normal * (1 - kEccentricity2) + place.height) * sinLat,
          1};
}

std::optional<Matrix> onEarth(std::string_view crs, double easting, double northing) {
  if (crs.starts_with("+proj=ortho ")) {
    const auto latitude = valueOf(crs, "+lat_0="), longitude = valueOf(crs, "+lon_0=");
    if (!latitude || !longitude) return std::nullopt;
    Matrix plane = eastNorthUp({*longitude * kRadians, *latitude * kRadians});
    for (std::size_t k = 0; k < 3; ++k) plane[12 + k] += easting * plane[k] + northing * plane[4 + k];
    return plane;
  }
  if (!crs.starts_with("EPSG:")) return std::nullopt;
  constexpr double kAround = 1000;  // metres, either way
  const Projection projection{std::string(crs)};
  const auto here = projection.at(easting, northing);
  const auto west = projection.at(easting - kAround, northing), east = projection.at(easting + kAround, northing),
             south = projection.at(easting, northing - kAround), north = projection.at(easting, northing + kAround);
  if (!here || !west || !east || !south || !north) return std::nullopt;
  // The ellipsoid's normal: the place lies on it, or on another one that is at most some hundred metres beside it.
  const double longitude = std::atan2((*here)[1], (*here)[0]),
               latitude = std::atan2((*here)[2], (1 - kEccentricity2) * std::hypot((*here)[0], (*here)[1]));
  Matrix out = eastNorthUp({longitude, latitude});
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = ((*east)[k] - (*west)[k]) / (2 * kAround);
    out[4 + k] = ((*north)[k] - (*south)[k]) / (2 * kAround);
    out[12 + k] = (*here)[k];
  }
  return out;
}

std::optional<Matrix> rootOf(const terrain::Raster* map, lattice::Point origin, const std::optional<Place>& at) {
  const auto grid = map ? terrain::onGrid(*map, origin) : std::nullopt;
  const auto own = grid ? onEarth(map->origin().crs, grid->easting, grid->northing) : std::nullopt;
  if (!at) return own;
  const Matrix there = eastNorthUp(*at);
  if (!own) return there;
  // The grid's axes, seen from east, north and up of its own place, and carried over.
  const Matrix& plane = *own;
  const Matrix here = eastNorthUp({std::atan2(plane[9], plane[8]), std::asin(std::clamp(plane[10], -1.0, 1.0))});
  Matrix out = there;
  for (std::size_t column = 0; column < 2; ++column) {
    std::array<double, 3> share{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t k = 0; k < 3; ++k) share[axis] += plane[4 * column + k] * here[4 * axis + k];
    for (std::size_t k = 0; k < 3; ++k) out[4 * column + k] = share[0] * there[k] + share[1] * there[4 + k] + share[2] * there[8 + k];
  }
  return out;
}

}  // namespace ridgecast::tileset
