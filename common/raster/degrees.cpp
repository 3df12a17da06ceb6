#include "common/raster/degrees.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

constexpr double kAxis = 6'378'137, kFlattening = 1 / 298.257223563, kSquare = kFlattening * (2 - kFlattening);
constexpr double kRadians = std::numbers::pi / 180;
constexpr double kWidest = 10;  // degrees

struct Place {
  double longitude, latitude;  // degrees
};
struct Local {
  double east, north;  // metres
};

double acrossAt(double sine) { return kAxis / std::sqrt(1 - kSquare * sine * sine); }  // the header's N

class Plane {
 public:
  explicit Plane(const Place& middle)
      : longitude_(middle.longitude),
        sine_(std::sin(middle.latitude * kRadians)),
        cosine_(std::cos(middle.latitude * kRadians)),
        across_(acrossAt(sine_)) {}

  Local onto(const Place& p) const {
    const double sine = std::sin(p.latitude * kRadians), cosine = std::cos(p.latitude * kRadians), across = acrossAt(sine);
    const double turn = (p.longitude - longitude_) * kRadians;
    return {across * cosine * std::sin(turn),
            across * (1 - kSquare) * sine * cosine_ + kSquare * across_ * sine_ * cosine_ - across * cosine * sine_ * std::cos(turn)};
  }

  // The inverse: where the plane's normal there meets the ellipsoid. Exact: a quadratic equation.
  Place from(const Local& p) const {
    // In axes turned to the middle's meridian: the point is base + up * normal. The ellipsoid: x2 + y2 + z2 / (1 - e2) = a2.
    const double x = across_ * cosine_ - p.north * sine_, z = across_ * (1 - kSquare) * sine_ + p.north * cosine_;
    constexpr double k = 1 / (1 - kSquare);
    const double a = cosine_ * cosine_ + k * sine_ * sine_, b = x * cosine_ + k * z * sine_,
                 c = x * x + p.east * p.east + k * z * z - kAxis * kAxis;
    const double up = (std::sqrt(std::max(0.0, b * b - a * c)) - b) / a;
    const double px = x + up * cosine_, pz = z + up * sine_;
    return {longitude_ + std::atan2(p.east, px) / kRadians, std::atan2(pz, (1 - kSquare) * std::hypot(px, p.east)) / kRadians};
  }

  // Metres a degree at the middle.
  double perLongitude() const { return across_ * cosine_ * kRadians; }
  double perLatitude() const { return across_ * (1 - kSquare) / (1 - kSquare * sine_ * sine_) * kRadians; }

 private:
  double longitude_, sine_, cosine_, across_;
};

// Catmull-Rom, at share t between the second and the third.
std::array<double, 4> weights(double t) {
  return {((2 - t) * t - 1) * t / 2, ((3 * t - 5) * t * t + 2) / 2, ((4 - 3 * t) * t + 1) * t / 2, (t - 1) * t * t / 2};
}

// Steps, between samples; beyond them as at their rim.
double between(const Samples& samples, double u, double v) {
  u = std::clamp(u, 0.0, samples.width() - 1.0), v = std::clamp(v, 0.0, samples.height() - 1.0);
  const auto column = static_cast<std::int64_t>(u), row = static_cast<std::int64_t>(v);
  const auto wu = weights(u - static_cast<double>(column)), wv = weights(v - static_cast<double>(row));
  double sum = 0;
  for (std::int64_t j = 0; j < 4; ++j) {
    const auto z = static_cast<std::uint32_t>(std::clamp<std::int64_t>(row + j - 1, 0, samples.height() - 1));
    double along = 0;
    for (std::int64_t i = 0; i < 4; ++i)
      along += wu[static_cast<std::size_t>(i)] *
               samples.at(static_cast<std::uint32_t>(std::clamp<std::int64_t>(column + i - 1, 0, samples.width() - 1)), z);
    sum += wv[static_cast<std::size_t>(j)] * along;
  }
  return sum;
}

Place middleOf(const DegreeGrid& g, std::uint32_t width, std::uint32_t height) {
  return {g.west + (width - 1) * g.stepX / 2, g.north - (height - 1) * g.stepY / 2};
}

// From the middle to the sides of the largest rectangle that the map covers.
Local halves(const Plane& plane, const Place& middle, const DegreeGrid& g, std::uint32_t width, std::uint32_t height) {
  const double south = g.north - (height - 1) * g.stepY, east = g.west + (width - 1) * g.stepX;
  const double narrow = std::min(plane.onto({east, g.north}).east, plane.onto({east, south}).east);  // a meridian is widest at its middle
  const double high = std::min(plane.onto({east, g.north}).north, plane.onto({middle.longitude, g.north}).north),
               low = std::min(-plane.onto({east, south}).north, -plane.onto({middle.longitude, south}).north);
  return {narrow, std::min(high, low)};
}

// Samples on the plane: so many on each side of the middle.
struct Raster {
  double pitch = 0;  // metres
  std::uint64_t across = 0, down = 0;
  std::uint64_t width() const { return 2 * across + 1; }
  std::uint64_t height() const { return 2 * down + 1; }
  std::uint64_t count() const { return width() * height(); }
};

Raster rasterOf(const Local& half, double pitch) {
  const auto toSide = [pitch](double length) { return static_cast<std::uint64_t>(std::max(0.0, std::floor(length / pitch))); };
  return {pitch, toSide(half.east), toSide(half.north)};
}

// How samples on the plane follow those of the file: the most that they differ, metres, and how many of these lie beyond them.
struct Fit {
  double error = 0;
  std::uint64_t beyond = 0;
};

Fit fitOf(const Samples& made, const Raster& raster, const Plane& plane, const Samples& source, const DegreeGrid& grid) {
  Fit out;
  for (std::uint32_t j = 0; j < source.height(); ++j)
    for (std::uint32_t i = 0; i < source.width(); ++i) {
      const Local at = plane.onto({grid.west + i * grid.stepX, grid.north - j * grid.stepY});
      const double u = at.east / raster.pitch + static_cast<double>(raster.across),
                   v = static_cast<double>(raster.down) - at.north / raster.pitch;
      if (std::min(u, v) < 0 || u > made.width() - 1.0 || v > made.height() - 1.0)
        ++out.beyond;
      else
        out.error = std::max(out.error, std::abs(between(made, u, v) - source.at(i, j)) * lattice::kMetresPerStep);
    }
  return out;
}

}  // namespace

int utmZone(double longitude, double latitude) {
  if (latitude > 84) return 32661;
  if (latitude < -80) return 32761;
  const double east = longitude + 180 - 360 * std::floor((longitude + 180) / 360);  // of the date line
  return (latitude >= 0 ? 32601 : 32701) + std::min(static_cast<int>(east / 6), 59);
}

Error inDegrees(const std::string& name, const DegreeGrid& grid, std::uint32_t width, std::uint32_t height) {
  const Place middle = middleOf(grid, width, height);
  const int epsg = utmZone(middle.longitude, middle.latitude), zone = epsg % 100;
  const std::string called = zone == 61 ? "the polar zone" : "UTM zone " + std::to_string(zone) + (epsg < 32700 ? " north" : " south");
  return {name + ": its samples are degrees apart, not metres: project it to " + called + " (gdalwarp -t_srs EPSG:" + std::to_string(epsg) +
          "), say --raster project=local to lay it on the plane that touches its middle, or say --raster pitch=METRES"};
}

Outcome<OnPlane> onPlane(const std::string& name, const Samples& source, const DegreeGrid& grid, std::optional<double> pitch,
                         std::uint64_t inMemory, std::uint64_t most) {
  expects(grid.stepX > 0 && grid.stepY > 0, "columns run east and rows south");
  const Place middle = middleOf(grid, source.width(), source.height());
  if (!((source.width() - 1) * grid.stepX <= kWidest && (source.height() - 1) * grid.stepY <= kWidest &&
        std::abs(middle.latitude) + (source.height() - 1) * grid.stepY / 2 < 90))
    return Error{name + ": a map of more than 10 degrees, or one that reaches a pole, is too curved for one plane: cut it (gdalwarp -te)"};
  const Plane plane(middle);
  const Local half = halves(plane, middle, grid, source.width(), source.height());
  const double finest = std::min(grid.stepX * plane.perLongitude(), grid.stepY * plane.perLatitude()) * lattice::kStepsPerMetre;
  const auto pitchAt = [finest](std::uint32_t times) { return std::round(finest / times) * lattice::kMetresPerStep; };
  const auto isValid = [](double metres) {
    return metres * terrain::kPartsPerMetre >= terrain::kMinPitch && metres * terrain::kPartsPerMetre <= terrain::kMaxPitch;
  };
  std::uint32_t times = kCloser;
  while (times > 1 && !(isValid(pitchAt(times)) && rasterOf(half, pitchAt(times)).count() <= kMaxCloser)) times /= 2;
  const double metres = pitch.value_or(pitchAt(times));
  if (!isValid(metres))
    return Error{name + ": its samples are " + text::rounded(metres, 6) +
                 " m apart; that must be 0.0625 to 1024 m: say --raster pitch=METRES"};
  const Raster raster = rasterOf(half, metres);
  if (raster.width() < 3 || raster.height() < 3)
    return Error{name + ": it is too small to be laid on a plane: say a smaller --raster pitch=METRES"};
  if (raster.count() * sizeof(std::int32_t) > most)
    return Error{name + ": on the plane it has " + std::to_string(raster.width()) + " x " + std::to_string(raster.height()) +
                 " samples, more than there is room for: say a larger --raster pitch=METRES"};
  auto made = Samples::create(static_cast<std::uint32_t>(raster.width()), static_cast<std::uint32_t>(raster.height()), inMemory);
  if (!made) return Error{name + ": " + made.error().message};
  for (std::uint32_t j = 0; j < made->height(); ++j) {
    const double north = (static_cast<double>(raster.down) - j) * raster.pitch;
    const auto row = made->row(j);
    for (std::uint32_t i = 0; i < made->width(); ++i) {
      const Place p = plane.from({(i - static_cast<double>(raster.across)) * raster.pitch, north});
      constexpr double kMax = terrain::kMaxSample;
      row[i] = static_cast<std::int32_t>(std::llround(
          std::clamp(between(source, (p.longitude - grid.west) / grid.stepX, (grid.north - p.latitude) / grid.stepY), -kMax, kMax)));
    }
  }
  const Fit fit = fitOf(*made, raster, plane, source, grid);
  return OnPlane{std::move(*made), raster.pitch, fit.error, fit.beyond,
                 "+proj=ortho +lat_0=" + text::rounded(middle.latitude, 12) + " +lon_0=" + text::rounded(middle.longitude, 12) +
                     " +datum=WGS84 +units=m"};
}

}  // namespace ridgecast::raster
