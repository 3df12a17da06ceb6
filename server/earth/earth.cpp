#include "server/earth/earth.h"

#include <proj.h>

#include <algorithm>
#include <cmath>
#include <list>
#include <memory>
#include <numbers>
#include <string>
#include <tuple>

#include "common/text/text.h"

namespace ridgecast::earth {

namespace {

constexpr double kRadius = 6'378'137, kFlattening = 1 / 298.257223563, kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kRadians = std::numbers::pi / 180;

// Where the normal of a plane leaves the ellipsoid.
Place belowOf(const Matrix& plane) { return {std::atan2(plane[9], plane[8]), std::asin(std::clamp(plane[10], -1.0, 1.0))}; }

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

  PJ_COORD forward(const Object& way, const terrain::GridPlace& at) const {
    return proj_trans(way.get(), PJ_FWD, proj_coord(at.easting / unit, at.northing / unit, 0, HUGE_VAL));
  }

  Projection(const std::string& crs, const terrain::GridPlace& about) {
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
      Object way(plain ? proj_normalize_for_visualization(c, plain.get()) : nullptr);
      if (!way) return way;
      // Of the ways that there are, one for the whole map: the best where it lies. Elsewhere another might be better, by a hundred metres.
      forward(way, about);
      Object best(proj_trans_get_last_used_operation(way.get()));
      return best ? std::move(best) : std::move(way);
    };
    earth = to("EPSG:4978");
    degrees = to("EPSG:4326");
  }
};

Grid::Grid(const std::string& crs, const terrain::GridPlace& about) : projection_(std::make_unique<Projection>(crs, about)) {}
Grid::~Grid() = default;

const Grid* Grid::of(const std::string& crs, const terrain::GridPlace& about) {
  using Asked = std::tuple<std::string, double, double>;
  using Kept = std::pair<Asked, std::unique_ptr<Grid>>;
  thread_local std::list<Kept> kept;  // the last first
  Asked asked(crs, about.easting, about.northing);
  if (const auto found = std::ranges::find(kept, asked, &Kept::first); found != kept.end()) {
    kept.splice(kept.begin(), kept, found);
  } else {
    kept.emplace_front(std::move(asked), std::unique_ptr<Grid>(new Grid(crs, about)));
    if (kept.size() > kKeptGrids) kept.pop_back();
  }
  const Grid* const grid = kept.front().second.get();
  return grid->projection_->earth && grid->projection_->degrees ? grid : nullptr;
}

const Grid* Grid::of(const terrain::Raster& map) {
  const auto origin = terrain::onGrid(map, {});
  return origin ? of(map.origin().crs, *origin) : nullptr;
}

std::optional<std::array<double, 3>> Grid::onEarth(const terrain::GridPlace& at) const {
  const PJ_COORD out = projection_->forward(projection_->earth, at);
  if (!std::isfinite(out.xyz.x) || !std::isfinite(out.xyz.y) || !std::isfinite(out.xyz.z)) return std::nullopt;
  return std::array{out.xyz.x, out.xyz.y, out.xyz.z};
}

std::optional<terrain::GridPlace> Grid::at(double longitude, double latitude) const {
  const PJ_COORD out = proj_trans(projection_->degrees.get(), PJ_INV, proj_coord(longitude, latitude, 0, HUGE_VAL));
  if (!std::isfinite(out.xy.x) || !std::isfinite(out.xy.y)) return std::nullopt;
  return terrain::GridPlace{out.xy.x * projection_->unit, out.xy.y * projection_->unit};
}

std::optional<std::array<double, 2>> Grid::degrees(const terrain::GridPlace& at) const {
  const PJ_COORD out = projection_->forward(projection_->degrees, at);
  if (!std::isfinite(out.xy.x) || !std::isfinite(out.xy.y)) return std::nullopt;
  return std::array{out.xy.x, out.xy.y};
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

std::optional<Matrix> onEarth(const std::string& crs, const terrain::GridPlace& about, const terrain::GridPlace& at) {
  constexpr double kAround = 1000;  // metres, either way
  const Grid* const grid = crs.empty() ? nullptr : Grid::of(crs, about);
  if (!grid) return std::nullopt;
  const auto beside = [&](double x, double y) { return grid->onEarth({at.easting + x, at.northing + y}); };
  const auto here = beside(0, 0), west = beside(-kAround, 0), east = beside(kAround, 0), south = beside(0, -kAround),
             north = beside(0, kAround);
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

std::optional<Turn> turnOf(const terrain::Raster& map, lattice::Point origin) {
  const auto grid = terrain::onGrid(map, origin);
  const auto plane = grid ? onEarth(map.origin().crs, *grid, *grid) : std::nullopt;
  if (!plane) return std::nullopt;
  const Matrix here = eastNorthUp(belowOf(*plane));
  double east = 0, north = 0;  // of the grid's own east
  for (std::size_t k = 0; k < 3; ++k) {
    east += (*plane)[k] * here[k];
    north += (*plane)[k] * here[4 + k];
  }
  const double length = std::hypot(east, north);
  return Turn{east / length, north / length};
}

Outcome<Coordinates> Coordinates::of(const terrain::Raster* map, std::string_view crs) {
  Coordinates out;
  out.crs_ = crs;
  const std::string_view number = crs.starts_with("EPSG:") ? crs.substr(5) : std::string_view();
  const bool isNumber = number.size() <= 6 && text::number<unsigned>(number);
  if (crs != "lonlat" && !isNumber)
    return Error{"crs is lonlat, for longitudes and latitudes in degrees, or EPSG:N, for eastings and northings."};
  if (isNumber && !Grid::of(out.crs_, {}))
    return Error{out.crs_ + " is no projected CRS that PROJ knows; for longitudes and latitudes say lonlat."};
  if (!map || !Grid::of(*map)) return Error{"This terrain does not say where on Earth it lies: ask in metres of the world, without crs."};
  out.mapCrs_ = map->origin().crs;
  out.origin_ = *terrain::onGrid(*map, {});
  return out;
}

std::optional<std::array<double, 2>> Coordinates::world(double first, double second) {
  std::optional<terrain::GridPlace> place(std::in_place, first, second);
  if (crs_ != mapCrs_) {
    if (!about_) about_ = place;
    std::optional<std::array<double, 2>> degrees{{first, second}};
    if (crs_ != "lonlat") {
      const Grid* const theirs = Grid::of(crs_, *about_);
      degrees = theirs ? theirs->degrees(*place) : std::nullopt;
    }
    const Grid* const ours = Grid::of(mapCrs_, origin_);
    place = degrees ? ours->at((*degrees)[0], (*degrees)[1]) : std::nullopt;
  }
  if (!place) return std::nullopt;
  return std::array{place->easting - origin_.easting, origin_.northing - place->northing};
}

std::optional<std::array<double, 2>> Coordinates::fromWorld(double x, double z) const {
  const terrain::GridPlace place{origin_.easting + x, origin_.northing - z};
  if (crs_ == mapCrs_) return std::array{place.easting, place.northing};
  const auto degrees = Grid::of(mapCrs_, origin_)->degrees(place);
  if (!degrees || crs_ == "lonlat") return degrees;
  const Grid* const theirs = Grid::of(crs_, about_.value_or(terrain::GridPlace()));
  const auto there = theirs ? theirs->at((*degrees)[0], (*degrees)[1]) : std::nullopt;
  if (!there) return std::nullopt;
  return std::array{there->easting, there->northing};
}

std::optional<std::array<double, 2>> Coordinates::north(double first, double second) {
  const double beside = crs_ == "lonlat" ? 1e-4 : 10;  // degrees or metres: some metres
  const auto south = world(first, second - beside), north = world(first, second + beside);
  if (!south || !north) return std::nullopt;
  const double x = (*north)[0] - (*south)[0], z = (*north)[1] - (*south)[1], length = std::hypot(x, z);
  return std::array{x / length, z / length};
}

Matrix product(const Matrix& b, const Matrix& a) {
  Matrix out{};
  for (std::size_t column = 0; column < 4; ++column)
    for (std::size_t row = 0; row < 4; ++row)
      for (std::size_t k = 0; k < 4; ++k) out[4 * column + row] += b[4 * k + row] * a[4 * column + k];
  return out;
}

Matrix inverse(const Matrix& m) {
  const auto minor = [&](std::size_t a, std::size_t b, std::size_t c, std::size_t d) { return m[a] * m[b] - m[c] * m[d]; };
  Matrix out{};
  out[0] = minor(5, 10, 6, 9), out[1] = minor(2, 9, 1, 10), out[2] = minor(1, 6, 2, 5);
  out[4] = minor(6, 8, 4, 10), out[5] = minor(0, 10, 2, 8), out[6] = minor(2, 4, 0, 6);
  out[8] = minor(4, 9, 5, 8), out[9] = minor(1, 8, 0, 9), out[10] = minor(0, 5, 1, 4);
  const double determinant = m[0] * out[0] + m[4] * out[1] + m[8] * out[2];
  for (double& v : out) v /= determinant;
  for (std::size_t row = 0; row < 3; ++row) out[12 + row] = -(out[row] * m[12] + out[4 + row] * m[13] + out[8 + row] * m[14]);
  out[15] = 1;
  return out;
}

std::optional<double> seaLevel(const Place& place) {
  struct Sea {
    PJ_CONTEXT* const context = proj_context_create();
    PJ* shift = nullptr;
    Sea() {
      proj_log_level(context, PJ_LOG_NONE);
      shift = proj_create(context, "+proj=vgridshift +grids=egm96_15.gtx +multiplier=1");
    }
    Sea(const Sea&) = delete;
    Sea& operator=(const Sea&) = delete;
    ~Sea() {
      proj_destroy(shift);
      proj_context_destroy(context);
    }
  };
  thread_local const Sea sea;
  if (!sea.shift) return std::nullopt;
  const PJ_COORD out = proj_trans(sea.shift, PJ_FWD, proj_coord(place.longitude, place.latitude, 0, HUGE_VAL));
  if (!std::isfinite(out.lpz.z)) return std::nullopt;
  return out.lpz.z;
}

std::optional<Placement> Placement::of(const terrain::Raster* map, lattice::Point origin, const Where& where) {
  const std::optional<Place>& at = where.at;
  Placement out;
  if (where.heights == Heights::kSea && seaLevel({})) out.heights_ = Heights::kSea;
  out.origin_ = origin;
  const auto turn = map ? turnOf(*map, origin) : std::nullopt;
  if (!at) {
    if (!turn) return std::nullopt;
    out.crs_ = map->origin().crs;
    out.grid_ = *terrain::onGrid(*map, origin);
    return out;
  }
  out.crs_ = "+proj=aeqd +lat_0=" + text::rounded(at->latitude / kRadians, 17) + " +lon_0=" + text::rounded(at->longitude / kRadians, 17) +
             " +datum=WGS84 +units=m";
  out.height_ = at->height;
  out.turn_ = turn.value_or(Turn());
  return out;
}

std::optional<Matrix> Placement::at(lattice::Point place) const {
  const double x = lattice::metres(place.x - origin_.x), y = -lattice::metres(place.z - origin_.z);
  const auto [cosine, sine] = turn_;
  const auto plane = onEarth(crs_, grid_, {grid_.easting + cosine * x - sine * y, grid_.northing + sine * x + cosine * y});
  if (!plane) return std::nullopt;
  Matrix out = *plane;
  const double height = height_ + (heights_ == Heights::kSea ? seaLevel(belowOf(out)).value_or(0) : 0);
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = cosine * (*plane)[k] + sine * (*plane)[4 + k];
    out[4 + k] = cosine * (*plane)[4 + k] - sine * (*plane)[k];
    out[12 + k] += height * out[8 + k];
  }
  return out;
}

}  // namespace ridgecast::earth
