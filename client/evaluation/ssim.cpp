#include "client/evaluation/ssim.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "common/outcome/contract.h"

namespace ridgecast::evaluation {
namespace {

constexpr std::size_t kWindow = kSimilarityWindow;

std::array<double, kWindow> gaussian() {
  std::array<double, kWindow> kernel{};
  double sum = 0;
  for (std::size_t k = 0; k < kWindow; ++k) {
    const double d = static_cast<double>(k) - 5;
    sum += kernel[k] = std::exp(-d * d / (2 * 1.5 * 1.5));
  }
  for (double& w : kernel) w /= sum;
  return kernel;
}

std::vector<double> luma(const render::Picture& p) {
  std::vector<double> out(std::size_t{p.width} * p.height);
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = 0.299 * p.rgb[3 * k] + 0.587 * p.rgb[3 * k + 1] + 0.114 * p.rgb[3 * k + 2];
  return out;
}

// Weighted means of the product of two pictures over every window that fits, separably.
std::vector<double> windowMeans(const std::vector<double>& a, const std::vector<double>* b, std::size_t width, std::size_t height) {
  static const std::array<double, kWindow> kernel = gaussian();
  const std::size_t w = width - (kWindow - 1), h = height - (kWindow - 1);
  std::vector<double> line(width), rows(w * height), out(w * h, 0.0);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) line[x] = a[y * width + x] * (b ? (*b)[y * width + x] : 1.0);
    for (std::size_t x = 0; x < w; ++x) {
      double sum = 0;
      for (std::size_t k = 0; k < kWindow; ++k) sum += kernel[k] * line[x + k];
      rows[y * w + x] = sum;
    }
  }
  for (std::size_t y = 0; y < h; ++y)
    for (std::size_t k = 0; k < kWindow; ++k)
      for (std::size_t x = 0; x < w; ++x) out[y * w + x] += kernel[k] * rows[(y + k) * w + x];
  return out;
}

}  // namespace

// By a summed-area table.
std::vector<std::uint32_t> setInWindows(const std::vector<bool>& pixels, std::size_t width, std::size_t height) {
  const std::size_t stride = width + 1;
  std::vector<std::uint32_t> sum(stride * (height + 1), 0);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      sum[(y + 1) * stride + x + 1] = pixels[y * width + x] + sum[y * stride + x + 1] + sum[(y + 1) * stride + x] - sum[y * stride + x];
  const std::size_t w = width - (kWindow - 1), h = height - (kWindow - 1);
  std::vector<std::uint32_t> out(w * h);
  for (std::size_t y = 0; y < h; ++y)
    for (std::size_t x = 0; x < w; ++x) {
      const std::size_t top = y * stride + x, bottom = (y + kWindow) * stride + x;
      out[y * w + x] = sum[bottom + kWindow] + sum[top] - sum[top + kWindow] - sum[bottom];
    }
  return out;
}

SimilarityMap similarityMap(const render::Picture& picture, const render::Picture& reference) {
  expects(picture.width == reference.width && picture.height == reference.height, "pictures that are compared have the same size");
  expects(picture.width >= kWindow && picture.height >= kWindow, "a picture holds the window of the measure");
  const std::size_t width = picture.width, height = picture.height;
  const std::vector<double> a = luma(picture), b = luma(reference);
  const std::vector<double> meanA = windowMeans(a, nullptr, width, height), meanB = windowMeans(b, nullptr, width, height);
  const std::vector<double> squareA = windowMeans(a, &a, width, height), squareB = windowMeans(b, &b, width, height);
  const std::vector<double> product = windowMeans(a, &b, width, height);

  SimilarityMap out{width - (kWindow - 1), height - (kWindow - 1), std::vector<double>(meanA.size()), {}};
  std::vector<bool> terrain(width * height, false);
  std::transform(reference.terrain.begin(), reference.terrain.end(), terrain.begin(), [](std::uint8_t mask) { return mask == 255; });
  for (const std::uint32_t count : setInWindows(terrain, width, height)) out.terrain.push_back(count == kWindow * kWindow);
  constexpr double kC1 = (0.01 * 255) * (0.01 * 255), kC2 = (0.03 * 255) * (0.03 * 255);
  for (std::size_t k = 0; k < meanA.size(); ++k) {
    const double ma = meanA[k], mb = meanB[k];
    const double va = squareA[k] - ma * ma, vb = squareB[k] - mb * mb, covariance = product[k] - ma * mb;
    out.values[k] = (2 * ma * mb + kC1) * (2 * covariance + kC2) / ((ma * ma + mb * mb + kC1) * (va + vb + kC2));
  }
  return out;
}

Similarity similarity(const render::Picture& picture, const render::Picture& reference) {
  const SimilarityMap map = similarityMap(picture, reference);
  double total = 0, terrainTotal = 0;
  std::size_t terrainCount = 0;
  for (std::size_t k = 0; k < map.values.size(); ++k) {
    total += map.values[k];
    if (!map.terrain[k]) continue;
    terrainTotal += map.values[k];
    ++terrainCount;
  }
  Similarity out;
  out.mean = total / static_cast<double>(map.values.size());
  if (terrainCount) out.terrain = terrainTotal / static_cast<double>(terrainCount);
  if (!reference.terrain.empty())
    out.terrainShare = static_cast<double>(std::ranges::count(reference.terrain, 255)) / static_cast<double>(reference.terrain.size());
  return out;
}

}  // namespace ridgecast::evaluation
