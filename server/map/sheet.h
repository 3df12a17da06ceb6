#pragma once
// The terrain seen from straight above, as a sheet of pixels: the heights at their middles, and colours. Pure functions; any thread.

#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "common/terrain/terrain.h"

namespace ridgecast::map {

// Columns run along x, rows along z, or nearly so. All middles lie within lattice::kMaxPosition.
struct Sheet {
  double x = 0, z = 0;            // steps: the middle of the first pixel
  double pitchX = 0, pitchZ = 0;  // steps from one pixel to the next
  std::uint32_t columns = 0, rows = 0;
  // Of a sheet that is turned or bent: where its pixels' corners 0, 32, ... lie, row by row; bilinear between. Then x and z are not used.
  struct Node {
    double x = 0, z = 0;  // steps
  };
  static constexpr std::uint32_t kNodePixels = 32;
  std::vector<Node> nodes = {};
  std::size_t nodesAcross() const { return columns / kNodePixels + 1; }
  std::size_t pixels() const { return std::size_t{columns} * rows; }
};

// Metres, row after row, at the step nearest to each pixel's middle. Empty once `stop` is requested.
std::vector<float> heights(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop = {});

// sRGB, three bytes a pixel: the terrain's own colours at the width of a pixel, without light and shadow. The slope is that between the
// pixels on both sides. Empty: the terrain has no colours in C++, or `stop` was requested.
std::vector<std::uint8_t> colours(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop = {});

}  // namespace ridgecast::map
