#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "common/raster/degrees.h"
#include "common/raster/detail.h"
#include "common/raster/map.h"
#include "common/raster/raster_file.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;

// Missing samples become kMissing. Error: the file's, or a height beyond the limits.
struct Missing {
  std::uint64_t count = 0;
  std::uint32_t x = 0, z = 0;  // the first
};
Outcome<Missing> readSamples(const std::string& name, RasterFile& file, const RasterOptions& options, const std::stop_token& stop,
                             Samples& samples) {
  const RasterHeader& header = file.header();
  const std::optional<double> noData = options.missing ? options.missing : header.noData;
  const double scale = options.scale == 1 ? header.heightUnit : options.scale;
  Missing missing;
  std::vector<double> values(header.width);
  for (std::uint32_t z = 0; z < header.height; ++z) {
    if (stop.stop_requested()) return Error{name + ": stopped"};
    if (auto read = file.row(values); !read) return read.error();
    const std::span<std::int32_t> row = samples.row(z);
    for (std::uint32_t x = 0; x < header.width; ++x) {
      const double v = values[x];
      if (std::isnan(v) || (noData && v == *noData)) {
        if (missing.count++ == 0) missing.x = x, missing.z = z;
        row[x] = kMissing;
        continue;
      }
      const double steps = std::floor((v * scale + options.offset) * lattice::kStepsPerMetre + 0.5);
      if (!(std::abs(steps) <= terrain::kMaxSample))
        return Error{name + ": the sample at column " + std::to_string(x) + ", row " + std::to_string(z) + " is " +
                     text::rounded(v * scale + options.offset, 6) +
                     " m high; heights lie within 32,768 m of 0: correct --raster scale= or offset=, or, where " + text::rounded(v, 9) +
                     " says that a sample is missing, say missing=" + text::rounded(v, 9)};
      row[x] = static_cast<std::int32_t>(steps);
    }
  }
  return missing;
}

Outcome<void> replace(const std::string& name, const Missing& missing, const RasterOptions& options, Samples& samples) {
  if (missing.count == 0) return {};
  if (options.fill) {
    if (fillMissing(samples)) return {};
    return Error{name + ": all its samples are missing (NoData), so there is nothing to fill them from"};
  }
  if (!options.noData)
    return Error{name + ": " + std::to_string(missing.count) + " samples are missing (NoData), the first at column " +
                 std::to_string(missing.x) + ", row " + std::to_string(missing.z) +
                 ": say what stands there with --raster nodata=METRES, or fill them from their neighbours with nodata=fill"};
  const auto instead = static_cast<std::int32_t>(std::llround(*options.noData * lattice::kStepsPerMetre));
  for (std::uint32_t z = 0; z < samples.height(); ++z) std::ranges::replace(samples.row(z), kMissing, instead);
  return {};
}

struct Found {
  std::int32_t lowest = terrain::kMaxSample, highest = -terrain::kMaxSample;
  std::uint64_t hash = 0;
};
Found measure(Samples& samples) {
  Found found;
  for (std::uint32_t z = 0; z < samples.height(); ++z)
    for (const std::int32_t v : samples.row(z)) {
      found.lowest = std::min(found.lowest, v);
      found.highest = std::max(found.highest, v);
      found.hash = (found.hash ^ static_cast<std::uint32_t>(v)) * 0x9e3779b97f4a7c15ull;
      found.hash ^= found.hash >> 32;
    }
  return found;
}

// Everything but the samples' range and content.
Outcome<terrain::RasterShape> shapeOf(const std::string& name, const RasterHeader& header, const RasterOptions& options) {
  terrain::RasterShape shape;
  shape.width = header.width;
  shape.height = header.height;
  if (header.degrees && !options.pitch && !options.project) return inDegrees(name, *header.degrees, header.width, header.height);
  if (header.degrees && options.geographic)
    return Error{name +
                 ": it lies in degrees, so it has no easting and northing: leave --raster place=geo out, or project it (gdalwarp -t_srs)"};
  for (const auto& [axis, metres] :
       {std::pair(&shape.x, header.pitch.value_or(1.0)), std::pair(&shape.z, header.pitch ? header.pitchDown : 1.0)}) {
    const double pitch = options.pitch.value_or(metres), parts = std::round(pitch * terrain::kPartsPerMetre);
    if (!(parts >= terrain::kMinPitch && parts <= terrain::kMaxPitch))
      return Error{name + ": its samples are " + text::rounded(pitch, 9) +
                   " m apart; that must be 0.0625 to 1024 m: say --raster pitch=METRES"};
    axis->pitch = static_cast<terrain::Pitch>(parts);
  }
  if (options.geographic) {
    if (!header.easting) return Error{name + ": it does not say where it lies: leave --raster place=geo out"};
    const double x = std::round(*header.easting * lattice::kStepsPerMetre), z = std::round(-*header.northing * lattice::kStepsPerMetre);
    constexpr double kMax = static_cast<double>(lattice::kMaxPosition);
    if (!(std::abs(x) <= kMax && std::abs(z) <= kMax))
      return Error{name + ": it says that it lies beyond 4.39e12 m: leave --raster place=geo out"};
    shape.x.origin = static_cast<Step>(x);
    shape.z.origin = static_cast<Step>(z);
  } else {
    shape.x.origin = -shape.x.of(header.width / 2);
    shape.z.origin = -shape.z.of(header.height / 2);
  }
  return shape;
}

terrain::RasterOrigin originOf(const RasterHeader& header, const RasterOptions& options, const terrain::RasterShape& shape) {
  static constexpr std::array<const char*, 3> kEdges{"clamp", "mirror", "repeat"};
  terrain::RasterOrigin origin;
  origin.edge = options.edge == Edge::kConstant ? text::rounded(options.constant, 9) : kEdges.at(static_cast<std::size_t>(options.edge));
  origin.read = header.read;
  origin.crs = header.epsg != 0 ? "EPSG:" + std::to_string(header.epsg) : header.crs;
  if (header.easting) {
    origin.easting = *header.easting + (shape.width - 1) * shape.x.metres() / 2;
    origin.northing = *header.northing - (shape.height - 1) * shape.z.metres() / 2;
  }
  return origin;
}

// `crs`: empty: the header's. `taken`: bytes in use.
Outcome<std::shared_ptr<const Map>> finished(const std::string& name, Samples samples, terrain::RasterShape shape,
                                             const RasterHeader& header, const std::string& crs, const RasterOptions& options,
                                             const MapLimits& limits, std::uint64_t taken, Laid laid) {
  if (options.detail) {
    auto detailed = withDetail(name, samples, shape, options, limits.inMemory - std::min(taken, limits.inMemory),
                               limits.total - std::min(taken, limits.total));
    if (!detailed) return detailed.error();
    RasterOptions done = options;
    done.detail.reset();
    return finished(name, std::move(detailed->samples), detailed->shape, header, crs, done, limits, taken, std::move(laid));
  }
  terrain::RasterOrigin origin = originOf(header, options, shape);
  if (!crs.empty()) origin.crs = crs;
  const Found found = measure(samples);
  const auto constant = static_cast<std::int32_t>(std::llround(options.constant * lattice::kStepsPerMetre));
  const bool isConstant = options.edge == Edge::kConstant;
  shape.lowest = isConstant ? std::min(found.lowest, constant) : found.lowest;
  shape.highest = isConstant ? std::max(found.highest, constant) : found.highest;
  shape.content =
      lattice::mix(found.hash ^ lattice::mix(static_cast<std::uint64_t>(options.edge) + 4 * static_cast<std::uint64_t>(constant)));
  shape.draped = laid.drape.has_value();
  if (laid.drape) {
    shape.content = lattice::mix(shape.content ^ laid.drape->content());
    origin.drape = laid.drape->describe();
  }
  if (laid.classes) {
    shape.content = lattice::mix(shape.content ^ laid.classes->content());
    origin.classes = laid.classes->describe();
  }
  Ranges ranges(samples);
  return std::shared_ptr<const Map>(std::make_shared<Map>(
      Map{std::move(samples), std::move(ranges), shape, options.edge, constant, std::move(origin), std::move(laid), header.sources}));
}

// To what the start line says of how a map was read.
void addNote(std::string& read, const std::string& note) {
  if (!read.empty()) read += "; ";
  read += note;
}

}  // namespace

Outcome<std::shared_ptr<const Map>> readMap(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
                                            std::uint64_t used, const std::stop_token& stop) {
  auto file = openRaster(path, options, stop);
  if (!file) return file.error();
  RasterHeader header = (*file)->header();
  const std::string name = path.string();
  if (options.classes.empty() && !options.named.empty())
    return Error{name + ": --raster class= says what values of --classes FILE stand for: give that file, or leave it out"};
  if (options.project && !header.degrees)
    return Error{name + ": --raster project=local is for maps in degrees, and this one does not say that it is: leave it out"};
  auto shape = shapeOf(name, header, options);
  if (!shape) return shape.error();
  const std::uint64_t bytes = std::uint64_t{header.width} * header.height * sizeof(std::int32_t);
  if (used + bytes > limits.total)
    return Error{name + ": the height map takes " + inMegabytes(bytes) + "; with it the height maps in use would take more than " +
                 inMegabytes(limits.total) + ", the most"};
  auto samples = Samples::create(header.width, header.height, limits.inMemory - std::min(used, limits.inMemory));
  if (!samples) return Error{name + ": " + samples.error().message};
  const auto missing = readSamples(name, **file, options, stop, *samples);
  if (!missing) return missing.error();
  if (const std::uint64_t mixed = missing->count == 0 ? 0 : dropMixed(*samples))
    addNote(header.read,
            std::to_string(mixed) + " samples beside missing ones were interpolated with the NoData value, and count as missing");
  if (auto replaced = replace(name, *missing, options, *samples); !replaced) return replaced.error();
  const std::uint64_t taken = used + bytes;
  const auto finish = [&](Samples all, const std::string& crs, std::uint64_t before) -> Outcome<std::shared_ptr<const Map>> {
    Laid laid;
    const auto inMemory = [&] { return limits.inMemory - std::min(before + laid.bytes(), limits.inMemory); };
    const auto most = [&] { return limits.total - before - laid.bytes(); };
    if (!options.drape.empty()) {
      auto picture = Drape::read(options.drape, all, header, *shape, inMemory(), most(), stop);
      if (!picture) return picture.error();
      laid.drape = std::move(*picture);
    }
    if (!options.classes.empty()) {
      auto classes = Classes::read(options, header, *shape, inMemory(), most(), stop);
      if (!classes) return classes.error();
      laid.classes.emplace(std::move(*classes));
    }
    const std::uint64_t with = before + laid.bytes();
    return finished(name, std::move(all), *shape, header, crs, options, limits, with, std::move(laid));
  };
  if (!options.project) return finish(std::move(*samples), {}, taken);

  auto made =
      onPlane(name, *samples, *header.degrees, options.pitch, limits.inMemory - std::min(taken, limits.inMemory), limits.total - taken);
  if (!made) return made.error();
  RasterHeader ofPlane;
  ofPlane.read = header.read;
  addNote(ofPlane.read,
          "laid on a plane, within " + text::rounded(std::ceil(100 * made->error) / 100, 7) + " m of its samples" +
              (made->beyond == 0 ? "" : "; " + std::to_string(made->beyond) + " of them lie beyond its rectangle and are left out"));
  ofPlane.sources = header.sources;
  header = std::move(ofPlane);
  header.width = made->samples.width();
  header.height = made->samples.height();
  header.pitch = header.pitchDown = made->pitch;
  header.easting = -*header.pitch * (header.width - 1) / 2;  // the plane's middle is its origin
  header.northing = header.pitchDown * (header.height - 1) / 2;
  shape = shapeOf(name, header, options);
  if (!shape) return shape.error();
  const std::uint64_t all = taken + made->samples.bytes();
  return finish(std::move(made->samples), made->crs, all);
}

}  // namespace ridgecast::raster
