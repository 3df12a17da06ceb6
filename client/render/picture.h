#pragma once
// Pictures in memory and on disk. Rows run from top to bottom.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::render {

// 8-bit display values.
struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<std::uint8_t> rgb;      // width x height x 3
  std::vector<std::uint8_t> terrain;  // width x height: 255 where the whole pixel shows terrain, 0 where any of it shows sky
};

// The mean of n x n blocks, in display values, rounded to nearest; width and height must be multiples of n >= 1.
// The downsampled pixel shows terrain if all of its samples do.
Picture downsample(const Picture& picture, std::uint32_t n);

// JPEG; quality 1..100.
std::string encodeJpeg(const Picture& picture, int quality);

// Error: the file cannot be written.
Outcome<void> writePng(const Picture& picture, const std::filesystem::path& file);
// Reads only colours; `terrain` stays empty. Error: not a readable PNG.
Outcome<Picture> readPng(const std::filesystem::path& file);

}  // namespace ridgecast::render
