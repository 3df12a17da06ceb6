#include "server/earth/earth.h"

#include <proj.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>

#include "common/text/text.h"

namespace ridgecast::earth {

namespace {

constexpr double kRadius = 6'378'137, kFlattening = 1 / 298.257223563, kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kRadians = std::numbers::pi / 180;

std::optional<double> valueOf(std::string_view text, std::string_view name) {
  const auto at = text.find(name);
  if (at == std::string_view::npos) return std::nullopt;
  text.remove_prefix(at + name.size());
  return text::number<double>(text::takePart(text, ' '));
}

}  // namespace

struct Grid::Projection {
  struct Destroy {
    void operator()(PJ* p) const { proj_destroy(p); }
    void operator()(PJ_CONTEXT* c) const { proj_context_destroy(c); }
  };
  using Object = std::unique_ptr<PJ, Destroy>;
  std::unique_ptr<PJ_CONTEXT, Destroy> context{proj_context_create()};
  Object earth, degrees;  // from the grid
  double unit = 1;        // metres

  explicit Projection(const std::string& crs) {
    PJ_CONTEXT* const c = context.get();
    proj_log_level(c, PJ_LOG_NONE);
    const Object from(proj_create(c, (crs.starts_with("+proj") ? crs + " +type=crs" : crs).c_str()));
    if (!from) return;
    const Object inside(proj_get_type(from.get()) == PJ_TYPE_BOUND_CRS ? proj_get_source_crs(c, from.get()) : nullptr);  // of +towgs84
    const PJ* const projected = inside ? inside.get() : from.get();
    if (proj_get_type(projected) != PJ_TYPE_PROJECTED_CRS) return;
    const Object axes(proj_crs_get_coordinate_system(c, projected));
    proj_cs_get_axis_info(c, axes.get(), 0, nullptr, nullptr, nullptr, &unit, nullptr, nullptr, nullptr);
    const auto to = [&](const char* other) {
      const Object target(proj_create(c, other));
      const Object plain(target ? proj_create_crs_to_crs_from_pj(c, from.get(), target.get(), nullptr, nullptr) : nullptr);
      return Object(plain ? proj_normalize_for_visualization(c, plain.get()) : nullptr);
    };
    earth = to("EPSG:4978");
    degrees = to("EPSG:4326");
  }
};

Grid::Grid(const std::string& crs) : projection_(std::make_unique<Projection>(crs)) {}
Grid::~Grid() = default;

const Grid* Grid::of(const std::string& crs) {
  thread_local std::string last;
  thread_local std::unique_ptr<Grid> grid;
  if (!grid || last != crs) {
    grid.reset(new Grid(crs));
    last = crs;
  }
  return grid->projection_->earth && grid->projection_->degrees ? grid.get() : nullptr;
}

std::optional<std::array<double, 3>> Grid::onEarth(const terrain::GridPlace& at) const {
  const double unit = projection_->unit;
  const PJ_COORD out = proj_trans(projection_->earth.get(), PJ_FWD, proj_coord(at.easting / unit, at.northing / unit, 0, HUGE_VAL));
  if (!std::isfinite(out.xyz.x) || !std::isfinite(out.xyz.y) || !std::isfinite(out.xyz.z)) return std::nullopt;
  return std::array{out.xyz.x, out.xyz.y, out.xyz.z};
}

std::optional<terrain::GridPlace> Grid::at(double longitude, double latitude) const {
  const PJ_COORD out = proj_trans(projection_->degrees.get(), PJ_INV, proj_coord(longitude, latitude, 0, HUGE_VAL));
  if (!std::isfinite(out.xy.x) || !std::isfinite(out.xy.y)) return std::nullopt;
  return terrain::GridPlace{out.xy.x * projection_->unit, out.xy.y * projection_->unit};
}

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
  constexpr double kAround = 1000;  // metres, either way
  const Grid* const grid = crs.empty() ? nullptr : Grid::of(std::string(crs));
  if (!grid) return std::nullopt;
  const auto at = [&](double x, double y) { return grid->onEarth({easting + x, northing + y}); };
  const auto here = at(0, 0), west = at(-kAround, 0), east = at(kAround, 0), south = at(0, -kAround), north = at(0, kAround);
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

std::array<std::array<double, 3>, 2> axesOf(const Matrix& plane) {
  const Matrix here = eastNorthUp({std::atan2(plane[9], plane[8]), std::asin(std::clamp(plane[10], -1.0, 1.0))});
  std::array<std::array<double, 3>, 2> out{};
  for (std::size_t column = 0; column < 2; ++column)
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t k = 0; k < 3; ++k) out[column][axis] += plane[4 * column + k] * here[4 * axis + k];
  return out;
}

std::optional<Matrix> rootOf(const terrain::Raster* map, lattice::Point origin, const std::optional<Place>& at) {
  const auto grid = map ? terrain::onGrid(*map, origin) : std::nullopt;
  const auto own = grid ? onEarth(map->origin().crs, grid->easting, grid->northing) : std::nullopt;
  if (!at) return own;
  const Matrix there = eastNorthUp(*at);
  if (!own) return there;
  const auto [eastern, northern] = axesOf(*own);
  Matrix out = there;
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = eastern[0] * there[k] + eastern[1] * there[4 + k] + eastern[2] * there[8 + k];
    out[4 + k] = northern[0] * there[k] + northern[1] * there[4 + k] + northern[2] * there[8 + k];
  }
  return out;
}

}  // namespace ridgecast::earth
