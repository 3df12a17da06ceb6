#pragma once
// Structural similarity of two pictures of one size.
// Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment: From Error Visibility to Structural Similarity, 2004: 11 x 11 Gaussian
// window with sigma 1.5, valid region only, luma 0.299 R + 0.587 G + 0.114 B unrounded, K1 = 0.01, K2 = 0.03, L = 255.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "client/render/picture.h"

namespace ridgecast::evaluation {

struct Similarity {
  double mean = 1;                // over all windows, -1..1; 1: equal
  std::optional<double> terrain;  // over windows that see terrain only; nothing when there are none or no mask
  double terrainShare = 0;        // of the mask's pixels that are terrain, 0..1
};

// The same window by window, rows from top to bottom: the window at (x, y) has its middle at pixel (x + 5, y + 5).
struct SimilarityMap {
  std::size_t width = 0, height = 0;  // of the map: 10 less than the pictures'
  std::vector<double> values;
  std::vector<bool> terrain;  // windows that see terrain only; none without a mask
};
inline constexpr std::size_t kSimilarityWindow = 11;
// How many pixels of each window are set, of width x height pixels.
std::vector<std::uint32_t> setInWindows(const std::vector<bool>& pixels, std::size_t width, std::size_t height);
SimilarityMap similarityMap(const render::Picture& picture, const render::Picture& reference);

// The mask is `reference.terrain` (the ray march's). Contract: both pictures have one size, at least 11 x 11.
Similarity similarity(const render::Picture& picture, const render::Picture& reference);

}  // namespace ridgecast::evaluation
