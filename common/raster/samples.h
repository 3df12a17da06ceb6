#pragma once
// The samples of a height map, or the pixels of a picture, in memory or in a temporary file.

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

namespace ridgecast::raster {

std::string inMegabytes(std::uint64_t bytes);  // rounded up

// width x height steps, row after row. Owns its pages.
class Samples {
 public:
  // Error: no memory, or no space for the file; says how much is needed and where. Above `inMemory` bytes a file is used.
  static Outcome<Samples> create(std::uint32_t width, std::uint32_t height, std::uint64_t inMemory);
  ~Samples();
  Samples(Samples&& other) noexcept;
  Samples& operator=(Samples&&) = delete;
  std::span<std::int32_t> row(std::uint32_t z) {
    expects(data_ && z < height_, "a row lies within its map");
    return {data_ + std::size_t{width_} * z, width_};
  }
  const std::int32_t& at(std::uint32_t x, std::uint32_t z) const {
    assert(x < width_ && z < height_);
    return data_[std::size_t{width_} * z + x];
  }
  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }
  std::uint64_t hash() const;
  std::uint64_t bytes() const { return std::uint64_t{width_} * height_ * sizeof(std::int32_t); }

 private:
  Samples(std::int32_t* data, std::uint32_t width, std::uint32_t height) : data_(data), width_(width), height_(height) {}
  std::int32_t* data_;
  std::uint32_t width_, height_;
};

// Fills the samples that are kMissing: each becomes the mean of the nearest known ones to the west, east, north and south, weighted by
// one over their distance; where none lies in these directions, of those that were filled before. False: all are missing.
inline constexpr std::int32_t kMissing = std::numeric_limits<std::int32_t>::min();
bool fillMissing(Samples& samples);

// Interpolating a map with its NoData value as a height leaves samples between the ground and -9999 around every hole, kMixed deep
// (Lanczos: three inside and three outside). If one lies outside the range of all other samples by more than twice that range and 2,000 m,
// which no cliff does, all of them become kMissing; returns their number.
inline constexpr std::uint32_t kMixed = 6;
std::uint64_t dropMixed(Samples& samples);

}  // namespace ridgecast::raster
