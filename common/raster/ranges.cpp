#include "common/raster/ranges.h"

#include <algorithm>

namespace ridgecast::raster {
namespace {

using Range = terrain::Raster::Range;

constexpr int kFirstBits = 3, kMoreBits = 2;
constexpr std::uint32_t kAcross = 6;  // blocks that a rectangle may span at the level that answers

void add(Range& to, const Range& more) { to = {std::min(to.lowest, more.lowest), std::max(to.highest, more.highest)}; }

}  // namespace

Ranges::Ranges(const Samples& samples) {
  static constexpr Range kNone{terrain::kMaxSample, -terrain::kMaxSample};
  const auto sized = [](std::uint32_t width, std::uint32_t height, int bits, int more) {
    const auto blocks = [&](std::uint32_t n) { return ((n - 1) >> more) + 1; };
    Level level{bits, blocks(width), blocks(height), {}};
    level.blocks.assign(std::size_t{level.width} * level.height, kNone);
    return level;
  };
  Level level = sized(samples.width(), samples.height(), kFirstBits, kFirstBits);
  for (std::uint32_t z = 0; z < samples.height(); ++z) {
    const std::int32_t* const row = &samples.at(0, z);
    Range* const blocks = &level.blocks[std::size_t{z >> kFirstBits} * level.width];
    for (std::uint32_t x = 0; x < samples.width(); ++x) add(blocks[x >> kFirstBits], {row[x], row[x]});
  }
  levels_.push_back(std::move(level));
  while (levels_.back().blocks.size() > 1) {
    const Level& finer = levels_.back();
    Level coarser = sized(finer.width, finer.height, finer.bits + kMoreBits, kMoreBits);
    for (std::uint32_t z = 0; z < finer.height; ++z)
      for (std::uint32_t x = 0; x < finer.width; ++x)
        add(coarser.blocks[std::size_t{z >> kMoreBits} * coarser.width + (x >> kMoreBits)], finer.blocks[std::size_t{z} * finer.width + x]);
    levels_.push_back(std::move(coarser));
  }
}

Range Ranges::of(const Samples& samples, std::uint32_t x0, std::uint32_t z0, std::uint32_t x1, std::uint32_t z1) const {
  Range out{samples.at(x0, z0), samples.at(x0, z0)};
  const std::uint32_t across = std::max(x1 - x0, z1 - z0) + 1;
  if (across <= 2 * kAcross) {
    for (std::uint32_t z = z0; z <= z1; ++z)
      for (std::uint32_t x = x0; x <= x1; ++x) add(out, {samples.at(x, z), samples.at(x, z)});
    return out;
  }
  const auto found = std::ranges::find_if(levels_, [&](const Level& level) { return across >> level.bits <= kAcross; });
  const Level& level = found == levels_.end() ? levels_.back() : *found;
  for (std::uint32_t z = z0 >> level.bits; z <= z1 >> level.bits; ++z)
    for (std::uint32_t x = x0 >> level.bits; x <= x1 >> level.bits; ++x) add(out, level.blocks[std::size_t{z} * level.width + x]);
  return out;
}

std::uint64_t Ranges::bytes() const {
  std::uint64_t sum = 0;
  for (const Level& level : levels_) sum += level.blocks.size() * sizeof(Range);
  return sum;
}

}  // namespace ridgecast::raster
