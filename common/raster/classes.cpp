#include "common/raster/classes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <unordered_map>
#include <utility>

#include "common/terrain/materials.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

Outcome<PixelGrid> gridOf(const std::string& name, const RasterHeader& pixels, const RasterHeader& map, const terrain::RasterShape& shape) {
  if (pixels.epsg != 0 || !pixels.crs.empty() || pixels.degrees) return gridOn(shape, map, pixels, name, "a map of classes");
  const bool liesElsewhere = pixels.easting && map.easting && (*pixels.easting != *map.easting || *pixels.northing != *map.northing);
  if (pixels.width == shape.width && pixels.height == shape.height && !liesElsewhere) return gridOfSamples(shape);
  return Error{name + ": it has " + std::to_string(pixels.width) + " x " + std::to_string(pixels.height) +
               " pixels and does not say in which CRS: give a GeoTIFF in the map's CRS, or a pixel for each of the map's " +
               std::to_string(shape.width) + " x " + std::to_string(shape.height) + " samples"};
}

using Unnamed = std::map<std::int32_t, std::uint64_t>;  // values, and their pixels

std::string listed(const Unnamed& values) {
  constexpr std::size_t kMost = 16;
  std::string out;
  std::size_t count = 0;
  for (const auto& [value, pixels] : values) {
    if (count++ == kMost) return out + " and " + std::to_string(values.size() - kMost) + " more";
    out.append(out.empty() ? "" : ", ").append(std::to_string(value));
  }
  return out;
}

}  // namespace

Outcome<Classes> Classes::read(const RasterOptions& options, const RasterHeader& map, const terrain::RasterShape& shape,
                               std::uint64_t inMemory, std::uint64_t most, const std::stop_token& stop) {
  auto file = openLaid(options.classes, Content::kClasses, stop);
  if (!file) return file.error();
  const RasterHeader& header = (*file)->header();
  const std::string name = options.classes.string();
  const auto grid = gridOf(name, header, map, shape);
  if (!grid) return grid.error();
  const std::uint64_t bytes = std::uint64_t{sizeof(std::int32_t)} * header.width * header.height;
  if (auto fits = judgeSize(bytes, most, name, "map of classes"); !fits) return fits.error();
  auto samples = Samples::create(header.width, header.height, bytes <= inMemory ? bytes : 0);
  if (!samples) return Error{name + ": " + samples.error().message};
  Classes out(std::move(*samples));
  out.grid_ = *grid;
  if (auto filled = out.fill(**file, options, stop); !filled) return filled.error();
  out.content_ = out.grid_.mixedInto(out.materials_.hash());
  for (const std::string& own : out.own_)
    for (const char c : own + '\n') out.content_ = lattice::mix(out.content_ ^ static_cast<std::uint64_t>(c));
  return out;
}

Outcome<void> Classes::fill(RasterFile& file, const RasterOptions& options, const std::stop_token& stop) {
  const std::string name = options.classes.string();
  std::unordered_map<std::int32_t, std::uint8_t> materialOf;
  for (const NamedClass& named : options.named) {
    if (terrain::materialNumber(named.material, own_) == 0) own_.push_back(named.material);
    materialOf[named.value] = terrain::materialNumber(named.material, own_);
  }
  const RasterHeader& header = file.header();
  std::vector<double> values(header.width);
  Unnamed unnamed;
  std::uint64_t named = 0;
  for (std::uint32_t j = 0; j < header.height; ++j) {
    if (stop.stop_requested()) return Error{name + ": stopped"};
    if (auto read = file.row(values); !read) return read.error();
    const std::span<std::int32_t> row = materials_.row(j);
    for (std::uint32_t i = 0; i < header.width; ++i) {
      const double v = values[i];
      row[i] = 0;
      if (std::isnan(v) || (header.noData && v == *header.noData)) continue;
      constexpr double kFirst = std::numeric_limits<std::int32_t>::min(), kLast = std::numeric_limits<std::int32_t>::max();
      if (!(v >= kFirst && v <= kLast && v == std::floor(v)))
        return Error{name + ": the value at column " + std::to_string(i) + ", row " + std::to_string(j) + " is " + text::rounded(v, 9) +
                     "; classes are whole numbers"};
      const auto value = static_cast<std::int32_t>(v);
      if (const auto found = materialOf.find(value); found != materialOf.end()) {
        row[i] = found->second;
        ++named;
      } else if (++unnamed[value]; unnamed.size() > kMaxUnnamed) {
        return Error{name + ": more than " + std::to_string(kMaxUnnamed) + " of its values have no name: is it a map of classes?"};
      }
    }
  }
  if (named == 0)
    return Error{name + (unnamed.empty() ? ": there is nothing in it but NoData"
                                         : ": say what its values stand for, --raster class=VALUE:NAME: it has " + listed(unnamed))};
  description_ = options.classes.filename().string() + ", " + std::to_string(header.width) + " x " + std::to_string(header.height) +
                 " pixels, " + text::rounded(lattice::kMetresPerStep / grid_.x.perStep, 6) + " m wide";
  if (unnamed.empty()) return {};
  std::uint64_t pixels = 0;
  for (const auto& [value, count] : unnamed) pixels += count;
  description_ += ", without a name: " + listed(unnamed) + " (" +
                  text::rounded(100.0 * static_cast<double>(pixels) / (static_cast<double>(header.width) * header.height), 2) + " % of it)";
  return {};
}

std::uint8_t Classes::at(lattice::Step x, lattice::Step z) const {
  const double i = std::floor(grid_.x.at(x) + 0.5), j = std::floor(grid_.z.at(z) + 0.5);
  if (!(i >= 0 && j >= 0 && i < materials_.width() && j < materials_.height())) return 0;
  return static_cast<std::uint8_t>(materials_.at(static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j)));
}

}  // namespace ridgecast::raster
