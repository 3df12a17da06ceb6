#include "server/map/mercator.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "server/earth/earth.h"

namespace ridgecast::map {

namespace {

constexpr double kRadius = 6'378'137, kRadians = std::numbers::pi / 180;

// Nodes of a tile, each where `place` puts a node's corner, counted in pixels. Empty: one has no place.
template <class F>
bool bend(Sheet& sheet, F&& place) {
  const std::size_t across = sheet.nodesAcross();
  for (std::size_t j = 0; j < across; ++j)
    for (std::size_t i = 0; i < across; ++i) {
      const std::optional<Sheet::Node> node =
          place(static_cast<double>(i * Sheet::kNodePixels), static_cast<double>(j * Sheet::kNodePixels));
      if (!node) return false;
      sheet.nodes.push_back(*node);
    }
  return true;
}

}  // namespace

std::optional<Place> placeOf(std::string_view text) {
  const auto longitude = text::number<double>(text::takePart(text, ',')), latitude = text::number<double>(text);
  if (!longitude || !latitude || !(std::abs(*longitude) <= 180) || !(std::abs(*latitude) <= kMaxLatitude)) return std::nullopt;
  return Place{*longitude, *latitude};
}

Sheet sheetOf(const TileAddress& tile, const Place& origin, const terrain::Raster* map) {
  expects(tile.isValid(), "a map tile is one of its level's");
  expects(std::abs(origin.latitude) <= kMaxLatitude, "the world's origin lies where the Mercator plane shows it");
  const double latitude = origin.latitude * kRadians, scale = std::cos(latitude) * lattice::kStepsPerMetre;
  const double originX = kRadius * origin.longitude * kRadians, originY = kRadius * std::asinh(std::tan(latitude));
  const double half = kRadius * std::numbers::pi, pixel = std::ldexp(2 * half / kTilePixels, -tile.level);
  Sheet out;
  out.columns = out.rows = kTilePixels;
  out.pitchX = out.pitchZ = pixel * scale;
  const double side = kTilePixels * pixel;
  double west = tile.x * side - half - originX;
  if (tile.level > 0) west -= 2 * half * std::round((west + side / 2) / (2 * half));  // the nearer way round the Earth
  out.x = (west + pixel / 2) * scale;
  out.z = (originY - half + (std::ldexp(tile.y, 8) + 0.5) * pixel) * scale;
  const auto turn = map ? earth::turnOf(*map, {}) : std::nullopt;
  if (!turn) return out;
  const auto [c, s] = *turn;
  const Sheet straight = out;
  bend(out, [&, c = c, s = s](double column, double row) {
    const double east = straight.x + (column - 0.5) * straight.pitchX, south = straight.z + (row - 0.5) * straight.pitchZ;
    return std::optional(Sheet::Node{c * east - s * south, s * east + c * south});
  });
  return out;
}

std::optional<Sheet> sheetOf(const TileAddress& tile, const terrain::Raster& map) {
  expects(tile.isValid(), "a map tile is one of its level's");
  const auto origin = terrain::onGrid(map, {});
  const earth::Grid* const grid = earth::Grid::of(map);
  if (!grid) return std::nullopt;
  Sheet out;
  out.columns = out.rows = kTilePixels;
  constexpr double kFarthest = lattice::kMaxPosition * lattice::kMetresPerStep;
  const bool isThere = bend(out, [&](double column, double row) -> std::optional<Sheet::Node> {
    const double x = std::ldexp(tile.x + column / kTilePixels, 1 - tile.level) - 1,
                 y = 1 - std::ldexp(tile.y + row / kTilePixels, 1 - tile.level);
    const auto at = grid->at(180 * x, std::atan(std::sinh(std::numbers::pi * y)) / kRadians);
    if (!at) return std::nullopt;
    const double east = at->easting - origin->easting, south = origin->northing - at->northing;
    if (!(std::abs(east) <= kFarthest && std::abs(south) <= kFarthest)) return std::nullopt;
    return Sheet::Node{east * lattice::kStepsPerMetre, south * lattice::kStepsPerMetre};
  });
  if (!isThere) return std::nullopt;
  const Sheet::Node &first = out.nodes.front(), &last = out.nodes.back(), &right = out.nodes[out.nodesAcross() - 1];
  out.x = first.x;
  out.z = first.z;
  out.pitchX = std::hypot(right.x - first.x, right.z - first.z) / kTilePixels;
  out.pitchZ = std::hypot(last.x - right.x, last.z - right.z) / kTilePixels;
  return out;
}

std::optional<Bounds> boundsOf(const lattice::Area& part, const terrain::Raster* map, const std::optional<Place>& origin) {
  expects(part.x0 <= part.x1 && part.z0 <= part.z1, "a part of the world begins before it ends");
  constexpr std::int64_t kParts = 16;  // of a side, which may be bent
  const auto grid = map ? terrain::onGrid(*map, {}) : std::nullopt;
  const earth::Grid* const projection = origin || !map ? nullptr : earth::Grid::of(*map);
  if (!origin && !projection) return std::nullopt;
  const auto turn = origin && map ? earth::turnOf(*map, {}).value_or(earth::Turn()) : earth::Turn();
  const auto degrees = [&](double x, double z) -> std::optional<std::array<double, 2>> {  // metres from the origin
    if (projection) return projection->degrees({grid->easting + x, grid->northing - z});
    const double east = turn.cosine * x + turn.sine * z, south = turn.cosine * z - turn.sine * x;
    const double latitude = origin->latitude * kRadians, scale = kRadius * std::cos(latitude);
    return std::array{origin->longitude + east / scale / kRadians,
                      std::atan(std::sinh(std::asinh(std::tan(latitude)) - south / scale)) / kRadians};
  };
  const Bounds all;
  Bounds out{all.east, all.north, all.west, all.south};
  double before = 0;
  bool isCrossed = false;
  const auto along = [](lattice::Step from, lattice::Step to, std::int64_t t) {
    return lattice::metres(from) + lattice::metres(to - from) * static_cast<double>(t) / kParts;
  };
  for (std::int64_t k = 0; k <= 4 * kParts; ++k) {  // once around
    const std::int64_t t = k % kParts, side = k / kParts % 4;
    const auto place = degrees(along(part.x0, part.x1,
                                     side == 0   ? t
                                     : side == 1 ? kParts
                                     : side == 2 ? kParts - t
                                                 : 0),
                               along(part.z0, part.z1,
                                     side == 0   ? 0
                                     : side == 1 ? t
                                     : side == 2 ? kParts
                                                 : kParts - t));
    if (!place) return all;
    const auto [longitude, latitude] = *place;
    isCrossed |= std::abs(longitude) > 180 || (k > 0 && std::abs(longitude - before) > 180);
    before = longitude;
    out = {std::min(out.west, longitude), std::min(out.south, latitude), std::max(out.east, longitude), std::max(out.north, latitude)};
  }
  if (isCrossed) out.west = all.west, out.east = all.east;
  out.south = std::max(out.south, all.south);
  out.north = std::min(out.north, all.north);
  return out;
}

TileRange tilesOf(const Bounds& bounds, int level) {
  expects(level >= 0 && level <= kFinestTileLevel, "a level of map tiles is 0 to 24");
  const double tiles = std::ldexp(1.0, level);
  const auto within = [&](double at) { return static_cast<std::uint32_t>(std::clamp(std::floor(at), 0.0, tiles - 1)); };
  const auto column = [&](double longitude) { return within((longitude / 360 + 0.5) * tiles); };
  const auto row = [&](double latitude) {
    return within((0.5 - std::asinh(std::tan(latitude * kRadians)) / (2 * std::numbers::pi)) * tiles);
  };
  return {column(bounds.west), row(bounds.north), column(bounds.east), row(bounds.south)};
}

int finestLevelOf(const terrain::RasterShape& map, double latitude) {
  expects(std::abs(latitude) < 90, "a map tile does not lie at a pole");
  const double pixel = 2 * std::numbers::pi * kRadius * std::cos(latitude * kRadians) / kTilePixels;  // of level 0, metres
  return std::clamp(static_cast<int>(std::ceil(std::log2(pixel / std::min(map.x.metres(), map.z.metres())))), 0, kFinestTileLevel);
}

bool isBeside(const Sheet& sheet, const terrain::RasterShape& map) {
  double west = sheet.x, east = west + sheet.columns * sheet.pitchX, north = sheet.z, south = north + sheet.rows * sheet.pitchZ;
  if (!sheet.nodes.empty()) {
    west = north = std::numeric_limits<double>::max();
    east = south = std::numeric_limits<double>::lowest();
  }
  for (const Sheet::Node& node : sheet.nodes) {
    west = std::min(west, node.x);
    east = std::max(east, node.x);
    north = std::min(north, node.z);
    south = std::max(south, node.z);
  }
  const lattice::Area all = map.area();
  return east < static_cast<double>(all.x0) || west > static_cast<double>(all.x1) || south < static_cast<double>(all.z0) ||
         north > static_cast<double>(all.z1);
}

void terrarium(float height, std::uint8_t* rgb) {
  const double units = std::clamp(std::floor((double{height} + 32'768) * 256 + 0.5), 0.0, 16'777'215.0);
  const auto v = static_cast<std::uint32_t>(units);
  rgb[0] = static_cast<std::uint8_t>(v >> 16);
  rgb[1] = static_cast<std::uint8_t>(v >> 8 & 255);
  rgb[2] = static_cast<std::uint8_t>(v & 255);
}

}  // namespace ridgecast::map
