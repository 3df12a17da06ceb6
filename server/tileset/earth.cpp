#include "server/tileset/earth.h"

#include <cmath>
#include <numbers>
#include <string>

#include "common/text/text.h"

namespace ridgecast::tileset {

namespace {

constexpr double kRadius = 6'378'137, kFlattening = 1 / 298.257223563, kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kRadians = std::numbers::pi / 180;

// UTM, the other way (Karney 2011, equations 11, 15 and 19 to 21, to the fourth order: better than a millimetre in a zone). x, y: metres
// from the central meridian and the equator.
Place fromTransverseMercator(double meridian, double x, double y) {
  constexpr double n = kFlattening / (2 - kFlattening), n2 = n * n, n3 = n2 * n, n4 = n2 * n2;
  constexpr double scale = 0.9996 * kRadius / (1 + n) * (1 + n2 / 4 + n4 / 64);
  constexpr std::array beta{n / 2 - 2 * n2 / 3 + 37 * n3 / 96 - n4 / 360, n2 / 48 + n3 / 15 - 437 * n4 / 1440,
                            17 * n3 / 480 - 37 * n4 / 840, 4397 * n4 / 161'280};
  const double xi = y / scale, eta = x / scale;
  double xi1 = xi, eta1 = eta;
  for (std::size_t k = 0; k < beta.size(); ++k) {
    const double j = 2.0 * static_cast<double>(k + 1);
    xi1 -= beta.at(k) * std::sin(j * xi) * std::cosh(j * eta);
    eta1 -= beta.at(k) * std::cos(j * xi) * std::sinh(j * eta);
  }
  const double conformal = std::sin(xi1) / std::hypot(std::sinh(eta1), std::cos(xi1)), e = std::sqrt(kEccentricity2);
  double tangent = conformal;  // of the latitude, by Newton's method
  for (int k = 0; k < 5; ++k) {
    const double root = std::hypot(1, tangent), sigma = std::sinh(e * std::atanh(e * tangent / root));
    const double off = tangent * std::hypot(1, sigma) - sigma * root;
    tangent += (conformal - off) / std::hypot(1, off) * (1 + (1 - kEccentricity2) * tangent * tangent) / ((1 - kEccentricity2) * root);
  }
  return {meridian + std::atan2(std::sinh(eta1), std::cos(xi1)), std::atan(tangent)};
}

// The plane whose axes go where the grid's do: `at` tells places around.
template <class F>
Matrix planeOf(F&& at) {
  const Matrix here = eastNorthUp(at(0, 0));
  Matrix out = here;
  const auto along = [&](double x, double y, std::size_t column) {
    const Matrix one = eastNorthUp(at(x, y)), other = eastNorthUp(at(-x, -y));
    for (std::size_t k = 0; k < 3; ++k) out[4 * column + k] = (one[12 + k] - other[12 + k]) / (2 * std::hypot(x, y));
  };
  along(1000, 0, 0);
  along(0, 1000, 1);
  return out;
}

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
  const auto code = valueOf(crs, "EPSG:");
  if (!code) return std::nullopt;
  const int family = static_cast<int>(*code) / 100, zone = static_cast<int>(*code) % 100;
  if ((family != 326 && family != 327 && family != 258) || zone < 1 || zone > 60) return std::nullopt;
  const double meridian = (6 * zone - 183) * kRadians, equator = family == 327 ? 10'000'000 : 0;
  return planeOf([&](double x, double y) { return fromTransverseMercator(meridian, easting + x - 500'000, northing + y - equator); });
}

}  // namespace ridgecast::tileset
