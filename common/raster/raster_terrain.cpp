#include "common/raster/raster_terrain.h"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/raster/classes.h"
#include "common/raster/degrees.h"
#include "common/raster/detail.h"
#include "common/raster/drape.h"
#include "common/raster/ranges.h"
#include "common/raster/raster_file.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using terrain::kTileSide;

std::string inMegabytes(std::uint64_t bytes) { return std::to_string((bytes + 999'999) / 1'000'000) + " MB"; }

// What lies on a map.
struct Laid {
  std::optional<Drape> drape;
  std::optional<Classes> classes;
  std::uint64_t bytes() const { return (drape ? drape->bytes() : 0) + (classes ? classes->bytes() : 0); }
};

// What terrains of one file with the same options share.
struct Map {
  Samples samples;
  Ranges ranges;
  terrain::RasterShape shape;
  Edge edge;
  std::int32_t constant;
  terrain::RasterOrigin origin;
  Laid laid;
  std::vector<std::filesystem::path> sources;  // RasterHeader
  std::uint64_t bytes() const { return samples.bytes() + ranges.bytes() + laid.bytes(); }
};

class RasterTerrain final : public terrain::Terrain, public terrain::Raster {
 public:
  RasterTerrain(std::string name, std::uint32_t seed, std::shared_ptr<const Map> map)
      : name_(std::move(name)), source_(terrain::rasterSource(map->shape)), seed_(seed), map_(std::move(map)), shape_(map_->shape) {}
  std::string_view name() const override { return name_; }
  std::string_view source() const override { return source_; }
  std::uint32_t seed() const override { return seed_; }
  const terrain::Raster* raster() const override { return this; }
  terrain::Colours colours() const override {
    if (!map_->laid.drape) return terrain::rasterColours(shape_);
    return [map = map_, own = terrain::rasterColours(shape_)](const Step* x, const Step* z, const float* height,
                                                              const std::array<float, 3>* normal, float footprint,
                                                              std::array<float, 3>* out, std::size_t count, std::uint32_t seed) {
      own(x, z, height, normal, footprint, out, count, seed);
      for (std::size_t k = 0; k < count; ++k) {
        const Drape::Light light = map->laid.drape->at(x[k], z[k], footprint);
        for (std::size_t c = 0; c < 3; ++c) out[k][c] = out[k][c] * (1 - light.alpha) + light.colour[c];
      }
    };
  }
  std::span<const std::string> ownMaterials() const override {
    return map_->laid.classes ? std::span<const std::string>(map_->laid.classes->ownMaterials()) : std::span<const std::string>();
  }
  void materials(std::span<const Step> x, std::span<const Step> z, std::span<std::uint8_t> out) const override {
    if (!map_->laid.classes) return Terrain::materials(x, z, out);
    expects(x.size() == out.size() && z.size() == out.size(), "each place has its material");
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = map_->laid.classes->at(x[k], z[k]);
  }
  const terrain::RasterShape& shape() const override { return shape_; }
  terrain::RasterOrigin origin() const override { return map_->origin; }

  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override {
    expects(x.size() == out.size() && z.size() == out.size(), "each place has its height");
    std::array<std::int32_t, 16> around;
    thread_local terrain::CubicPlaces places;
    for (std::size_t begin = 0; begin < out.size(); begin += terrain::CubicPlaces::kMax) {
      const std::size_t count = std::min<std::size_t>(out.size() - begin, terrain::CubicPlaces::kMax);
      for (std::size_t k = 0; k < count; ++k) {
        const terrain::Between bx = shape_.x.at(x[begin + k]), bz = shape_.z.at(z[begin + k]);
        samples(bx.sample - 1, bz.sample - 1, 4, 4, around.data());
        places.set(k, around, bx.steps(), bz.steps());
      }
      terrain::cubicHeights(places, static_cast<int>(count), shape_.x.inverse(), shape_.z.inverse(), &out[begin]);
    }
  }

  terrain::Relief relief() const override {
    const terrain::RasterBounds bounds = terrain::boundsOf(shape_);
    return {terrain::Relief::Known::kProven, bounds.lowest, bounds.highest};
  }
  Range range(std::int64_t x, std::int64_t z, std::int64_t columns, std::int64_t rows) const override {
    const auto along = [edge = map_->edge](std::int64_t from, std::int64_t count, std::uint32_t n) -> std::optional<Along> {
      const std::int64_t last = std::int64_t{n} - 1, to = from + count - 1;
      if (from >= 0 && to <= last) return Along{static_cast<std::uint32_t>(from), static_cast<std::uint32_t>(to)};
      if (edge == Edge::kConstant && (to < 0 || from > last)) return std::nullopt;
      if (edge == Edge::kClamp || edge == Edge::kConstant)
        return Along{static_cast<std::uint32_t>(std::clamp<std::int64_t>(from, 0, last)),
                     static_cast<std::uint32_t>(std::clamp<std::int64_t>(to, 0, last))};
      // One period of the continuation, or all.
      const std::uint32_t a = *folded(from, n, edge), b = *folded(to, n, edge);
      const bool isWhole = count >= last || (edge == Edge::kRepeat ? a > b : std::max(a, b) - std::min(a, b) != count - 1);
      return isWhole ? Along{0, n - 1} : Along{std::min(a, b), std::max(a, b)};
    };
    const Samples& held = map_->samples;
    const auto acrossX = along(x, columns, held.width()), acrossZ = along(z, rows, held.height());
    if (!acrossX || !acrossZ) return {map_->constant, map_->constant};
    Range out = map_->ranges.of(held, acrossX->first, acrossZ->first, acrossX->last, acrossZ->last);
    if (map_->edge == Edge::kConstant) {
      const auto isWithin = [](std::int64_t from, std::int64_t count, std::uint32_t n) { return from >= 0 && from + count <= n; };
      if (!isWithin(x, columns, held.width()) || !isWithin(z, rows, held.height()))
        out = {std::min(out.lowest, map_->constant), std::max(out.highest, map_->constant)};
    }
    return out;
  }

  void tile(terrain::TileAddress address, terrain::Tile& out) const override {
    samples(address.i * kTileSide, address.j * kTileSide, kTileSide, kTileSide, out.data());
  }
  std::vector<std::uint8_t> tileColours(terrain::TileAddress address) const override {
    return map_->laid.drape ? map_->laid.drape->tile(shape_, address) : std::vector<std::uint8_t>();
  }
  void samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const override {
    const Samples& held = map_->samples;
    if (x >= 0 && z >= 0 && x + columns <= std::int64_t{held.width()} && z + rows <= std::int64_t{held.height()}) {
      for (std::int32_t j = 0; j < rows; ++j, out += columns)
        std::copy_n(&held.at(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(z + j)), columns, out);
      return;
    }
    expects(columns <= kTileSide, "samples are asked for by a tile at most");
    std::array<std::optional<std::uint32_t>, kTileSide> column;
    for (std::int32_t k = 0; k < columns; ++k) column[static_cast<std::size_t>(k)] = folded(x + k, held.width(), map_->edge);
    for (std::int32_t j = 0; j < rows; ++j) {
      const auto row = folded(z + j, held.height(), map_->edge);
      for (std::int32_t k = 0; k < columns; ++k) {
        const auto at = column[static_cast<std::size_t>(k)];
        *out++ = row && at ? held.at(*at, *row) : map_->constant;
      }
    }
  }

 private:
  struct Along {
    std::uint32_t first, last;  // samples of the map
  };
  std::string name_, source_;
  std::uint32_t seed_;
  std::shared_ptr<const Map> map_;
  const terrain::RasterShape& shape_;
};

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

// `used`: bytes of the other maps in use.
Outcome<std::shared_ptr<const Map>> read(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
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

// The maps in use, by file and options.
class Maps {
 public:
  Outcome<std::shared_ptr<const Map>> open(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
                                           const std::stop_token& stop) {
    const Key key{path, options, versionOf(path), versionOf(options.drape), versionOf(options.classes)};
    const std::lock_guard lock(mutex_);
    std::uint64_t used = 0;
    for (const Entry& entry : inUse()) {
      auto map = entry.map.lock();
      if (!map) continue;
      if (entry.key == key && entry.sources == versionsOf(*map)) return map;
      used += map->bytes();
    }
    auto made = read(path, options, limits, used, stop);
    if (made) entries_.push_back({key, *made, versionsOf(**made)});
    return made;
  }
  std::vector<std::filesystem::path> sourcesOf(const std::filesystem::path& path) {
    const std::lock_guard lock(mutex_);
    for (const Entry& entry : inUse())
      if (const auto map = entry.key.path == path ? entry.map.lock() : nullptr) return map->sources;
    return {};
  }
  std::uint64_t bytes() {
    const std::lock_guard lock(mutex_);
    std::uint64_t sum = 0;
    for (const Entry& entry : inUse())
      if (const auto map = entry.map.lock()) sum += map->bytes();
    return sum;
  }

 private:
  using Version = std::array<std::int64_t, 6>;  // of the file: another if it was replaced or written
  struct Key {
    std::filesystem::path path;
    RasterOptions options;
    Version version, drape, classes;
    friend bool operator==(const Key&, const Key&) = default;
  };
  struct Entry {
    Key key;
    std::weak_ptr<const Map> map;
    std::vector<Version> sources;
  };
  static std::vector<Version> versionsOf(const Map& map) {
    std::vector<Version> out;
    for (const auto& source : map.sources) out.push_back(versionOf(source));
    return out;
  }
  static Version versionOf(const std::filesystem::path& path) {
    struct stat s {};
    if (stat(path.c_str(), &s) != 0) return {};  // opening it says why
    return {static_cast<std::int64_t>(s.st_dev),
            static_cast<std::int64_t>(s.st_ino),
            s.st_size,
            s.st_mtim.tv_sec,
            s.st_mtim.tv_nsec,
            s.st_ctim.tv_nsec};
  }
  const std::vector<Entry>& inUse() {
    std::erase_if(entries_, [](const Entry& entry) { return entry.map.expired(); });
    return entries_;
  }

  std::mutex mutex_;
  std::vector<Entry> entries_;
};

Maps& maps() {
  static Maps all;
  return all;
}

}  // namespace

std::optional<std::uint32_t> folded(std::int64_t k, std::uint32_t n, Edge edge) {
  assert(n >= 2);
  const auto size = static_cast<std::int64_t>(n);
  if (k >= 0 && k < size) return static_cast<std::uint32_t>(k);
  const auto modulo = [k](std::int64_t period) { return ((k % period) + period) % period; };
  switch (edge) {
    case Edge::kClamp:
      return k < 0 ? 0u : n - 1;
    case Edge::kRepeat:
      return static_cast<std::uint32_t>(modulo(size));
    case Edge::kMirror: {
      const std::int64_t m = modulo(2 * (size - 1));
      return static_cast<std::uint32_t>(std::min(m, 2 * (size - 1) - m));
    }
    case Edge::kConstant:
      break;
  }
  return std::nullopt;
}

Outcome<std::shared_ptr<const terrain::Terrain>> loadRaster(const std::filesystem::path& path, const RasterOptions& options,
                                                            std::uint32_t seed, const MapLimits& limits, const std::stop_token& stop) {
  auto map = maps().open(path, options, limits, stop);
  if (!map) return map.error();
  return std::shared_ptr<const terrain::Terrain>(std::make_shared<RasterTerrain>(path.stem().string(), seed, std::move(*map)));
}

std::string describe(const terrain::Raster& map) {
  const terrain::RasterShape& shape = map.shape();
  const terrain::RasterOrigin origin = map.origin();
  const auto metres = [](double steps) { return text::rounded(steps * lattice::kMetresPerStep, 9); };
  const auto pitch = [](const terrain::RasterAxis& axis) { return text::rounded(axis.metres(), 8); };
  const auto side = [](const terrain::RasterAxis& axis, std::uint32_t samples) { return text::rounded((samples - 1) * axis.metres(), 8); };
  std::string out = std::to_string(shape.width) + " x " + std::to_string(shape.height) + " samples, " + pitch(shape.x) +
                    (shape.x.pitch == shape.z.pitch ? "" : " x " + pitch(shape.z)) + " m apart (" + side(shape.x, shape.width) + " x " +
                    side(shape.z, shape.height) + " m), " + metres(shape.lowest) + " to " + metres(shape.highest) + " m high";
  if (!origin.crs.empty()) out += ", " + origin.crs;
  if (origin.easting)
    out += ", middle at easting " + text::rounded(*origin.easting, 12) + ", northing " + text::rounded(*origin.northing, 12);
  out += ", edge " + origin.edge;
  if (!origin.drape.empty()) out += ", draped with " + origin.drape;
  if (!origin.classes.empty()) out += ", classes of " + origin.classes;
  return origin.read.empty() ? out : out + "; " + origin.read;
}

std::vector<std::filesystem::path> otherFilesOf(const std::filesystem::path& map) { return maps().sourcesOf(map); }

std::uint64_t bytesOfMaps() { return maps().bytes(); }

}  // namespace ridgecast::raster
