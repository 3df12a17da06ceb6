#include "common/raster/drape.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "common/outcome/contract.h"
#include "common/raster/ramp.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;

using Light = Drape::Light;

void add(Light& sum, const Light& other, float weight) {
  for (std::size_t c = 0; c < 3; ++c) sum.colour[c] += weight * other.colour[c];
  sum.alpha += weight * other.alpha;
}

float linear(float srgb) { return srgb <= 0.04045f ? srgb / 12.92f : std::pow((srgb + 0.055f) / 1.055f, 2.4f); }
std::uint8_t byteOf(float linear) {
  const float srgb = linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::lround(std::min(srgb, 1.0f) * 255));
}

Light lightOf(std::int32_t pixel) {
  static const std::array<float, 256> kLinear = [] {
    std::array<float, 256> out{};
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = linear(static_cast<float>(k) / 255);
    return out;
  }();
  const auto bits = static_cast<std::uint32_t>(pixel);
  const float alpha = static_cast<float>(bits >> 24) / 255;
  return {{alpha * kLinear[bits & 255], alpha * kLinear[bits >> 8 & 255], alpha * kLinear[bits >> 16 & 255]}, alpha};
}

std::int32_t pixelOf(const Light& light) {
  std::uint32_t bits = static_cast<std::uint32_t>(std::lround(light.alpha * 255)) << 24;
  for (std::size_t c = 0; light.alpha > 0 && c < 3; ++c) bits |= std::uint32_t{byteOf(light.colour[c] / light.alpha)} << 8 * c;
  return static_cast<std::int32_t>(bits);
}

// Transparent beyond the picture.
Light lightAt(const Samples& level, std::int64_t x, std::int64_t z) {
  if (x < 0 || z < 0 || x >= level.width() || z >= level.height()) return {};
  return lightOf(level.at(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(z)));
}

Light bilinear(const Samples& level, double x, double z) {
  const double left = std::floor(x), top = std::floor(z);
  if (!(left >= -1 && top >= -1 && left < level.width() && top < level.height())) return {};
  const auto i = static_cast<std::int64_t>(left), j = static_cast<std::int64_t>(top);
  const auto u = static_cast<float>(x - left), v = static_cast<float>(z - top);
  Light out;
  add(out, lightAt(level, i, j), (1 - u) * (1 - v));
  add(out, lightAt(level, i + 1, j), u * (1 - v));
  add(out, lightAt(level, i, j + 1), (1 - u) * v);
  add(out, lightAt(level, i + 1, j + 1), u * v);
  return out;
}

void halve(const Samples& from, Samples& to) {
  for (std::uint32_t j = 0; j < to.height(); ++j)
    for (std::uint32_t i = 0; i < to.width(); ++i) to.row(j)[i] = pixelOf(bilinear(from, 2.0 * i + 0.5, 2.0 * j + 0.5));
}

Outcome<void> readPixels(const std::string& name, RasterFile& file, const std::stop_token& stop, Samples& pixels) {
  const RasterHeader& header = file.header();
  std::vector<double> values(std::size_t{header.width} * header.bands);
  double brightest = 0;
  for (std::uint32_t j = 0; j < header.height; ++j) {
    if (stop.stop_requested()) return Error{name + ": stopped"};
    if (auto read = file.row(values); !read) return read.error();
    for (std::uint32_t i = 0; i < header.width; ++i) {
      const double* const v = &values[std::size_t{i} * header.bands];
      const double white = header.isPremultiplied ? std::max(v[3], 1.0) : header.white;
      const auto byte = [&](std::size_t band) {
        return static_cast<std::uint32_t>(std::lround(std::min(v[band] / (band < 3 ? white : header.white), 1.0) * 255));
      };
      for (std::size_t band = 0; band < 3; ++band) brightest = std::max(brightest, v[band]);
      const bool isMissing = header.noData && std::all_of(v, v + 3, [&](double band) { return band == *header.noData; });
      const std::uint32_t alpha = isMissing ? 0 : header.hasAlpha ? byte(3) : 255;
      pixels.row(j)[i] = static_cast<std::int32_t>(byte(0) | byte(1) << 8 | byte(2) << 16 | alpha << 24);
    }
  }
  if (header.white > 255 && brightest > 0 && brightest < header.white / 8)
    return Error{name + ": its brightest pixel is " + text::rounded(brightest, 6) + " of " + text::rounded(header.white, 6) +
                 ", nearly black: spread its values (gdal_translate -scale 0 " + text::rounded(brightest, 6) + " 0 255 -ot Byte)"};
  return {};
}

}  // namespace

Outcome<Drape> Drape::read(const std::filesystem::path& path, const Samples& samples, const RasterHeader& map,
                           const terrain::RasterShape& shape, std::uint64_t inMemory, std::uint64_t most, const std::stop_token& stop) {
  expects(shape.width == samples.width() && shape.height == samples.height(), "a map has its shape");
  const bool ofHeights = isRamp(path);
  auto file = ofHeights ? openRamp(path, samples, map) : openLaid(path, Content::kColours, stop);
  if (!file) return file.error();
  const RasterHeader& header = (*file)->header();
  const std::string name = path.string();
  // Of heights: by the map's samples, so that both lie together where the pitch is another than the file's.
  const auto grid = ofHeights ? Outcome<PixelGrid>(gridOfSamples(shape)) : gridOn(shape, map, header, name, "a picture");
  if (!grid) return grid.error();
  const auto sideAt = [](std::uint32_t side, int level) { return ((side - 1) >> level) + 1; };
  const int levels = std::bit_width(std::max(header.width, header.height) - 1) + 1;
  std::uint64_t bytes = 0;
  for (int level = 0; level < levels; ++level) bytes += std::uint64_t{4} * sideAt(header.width, level) * sideAt(header.height, level);
  if (auto fits = judgeSize(bytes, most, name, "picture"); !fits) return fits.error();
  Drape out;
  for (int level = 0; level < levels; ++level) {
    auto made = Samples::create(sideAt(header.width, level), sideAt(header.height, level), bytes <= inMemory ? bytes : 0);
    if (!made) return Error{name + ": " + made.error().message};
    out.levels_.push_back(std::move(*made));
  }
  if (auto pixels = readPixels(name, **file, stop, out.levels_[0]); !pixels) return pixels.error();
  for (std::size_t level = 1; level < out.levels_.size(); ++level) halve(out.levels_[level - 1], out.levels_[level]);
  out.grid_ = *grid;
  out.content_ = out.grid_.mixedInto(out.levels_[0].hash());
  out.name_ = path.filename().string();
  return out;
}

Light Drape::at(Step x, Step z, float footprint) const {
  const double pixels = footprint * lattice::kStepsPerMetre * std::max(grid_.x.perStep, grid_.z.perStep);
  const double level = std::clamp(std::log2(std::max(pixels, 1.0)), 0.0, static_cast<double>(levels_.size() - 1));
  const auto finer = static_cast<std::size_t>(level);
  const auto part = static_cast<float>(level - static_cast<double>(finer));
  const double u = grid_.x.at(x) + 0.5, v = grid_.z.at(z) + 0.5;  // from the picture's corner
  Light out;
  const auto addLevel = [&](std::size_t k, float weight) {
    const double scale = std::ldexp(1.0, -static_cast<int>(k));
    add(out, bilinear(levels_[k], u * scale - 0.5, v * scale - 0.5), weight);
  };
  addLevel(finer, 1 - part);
  if (part > 0) addLevel(finer + 1, part);
  return out;
}

std::vector<std::uint8_t> Drape::tile(const terrain::RasterShape& shape, terrain::TileAddress address) const {
  std::vector<std::uint8_t> out;
  bool isEmpty = true;
  const auto footprint = static_cast<float>(shape.finest() * lattice::kMetresPerStep);
  for (std::int64_t j = address.j * terrain::kTileSide; j < (address.j + 1) * terrain::kTileSide; ++j)
    for (std::int64_t i = address.i * terrain::kTileSide; i < (address.i + 1) * terrain::kTileSide; ++i) {
      const Light light = at(shape.x.of(i), shape.z.of(j), footprint);
      for (const float c : light.colour) out.push_back(c > 0 ? byteOf(c) : 0);
      out.push_back(static_cast<std::uint8_t>(std::lround(light.alpha * 255)));
      isEmpty = isEmpty && out.back() == 0;
    }
  return isEmpty ? std::vector<std::uint8_t>() : out;
}

std::uint64_t Drape::bytes() const {
  std::uint64_t sum = 0;
  for (const Samples& level : levels_) sum += level.bytes();
  return sum;
}

std::string Drape::describe() const {
  return name_ + ", " + std::to_string(levels_[0].width()) + " x " + std::to_string(levels_[0].height()) + " pixels, " +
         text::rounded(lattice::kMetresPerStep / grid_.x.perStep, 6) + " m wide";
}

}  // namespace ridgecast::raster
