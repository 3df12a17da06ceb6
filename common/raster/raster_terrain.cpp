#include "common/raster/raster_terrain.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/raster/map.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using terrain::kTileSide;

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
  auto map = openMap(path, options, limits, stop);
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

}  // namespace ridgecast::raster
