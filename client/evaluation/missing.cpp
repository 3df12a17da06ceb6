#include "client/evaluation/missing.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"

namespace ridgecast::evaluation {
namespace {

bool differ(const float* a, const float* b) {
  if ((a[3] > 0) != (b[3] > 0)) return true;
  if (a[3] == 0) return false;
  const double first = std::hypot(a[0], a[1], a[2]), second = std::hypot(b[0], b[1], b[2]);
  return std::abs(first - second) > 0.05 * std::min(first, second);
}

// How many such pixels each window has.
std::vector<std::uint32_t> silhouettes(std::size_t width, std::size_t height, std::span<const float> mesh, std::span<const float> march,
                                       std::size_t samples) {
  const std::size_t border = kSimilarityWindow - 1, columns = width + border, rows = height + border;
  expects(mesh.size() == march.size() && mesh.size() == 4 * columns * rows * samples * samples,
          "pictures that are compared have the same size");
  std::vector<bool> differs(columns * rows, false);
  for (std::size_t y = 0; y < rows; ++y)
    for (std::size_t x = 0; x < columns; ++x)
      for (std::size_t k = 0; k < samples * samples && !differs[y * columns + x]; ++k) {
        const std::size_t at = 4 * ((y * samples + k / samples) * columns * samples + x * samples + k % samples);
        differs[y * columns + x] = differ(&mesh[at], &march[at]);
      }
  return setInWindows(differs, columns, rows);
}

}  // namespace

Missing missingOf(const SimilarityMap& mesh, const SimilarityMap& corrected, const SimilarityMap& finer, std::span<const float> meshSamples,
                  std::span<const float> marchSamples, std::size_t samples) {
  expects(mesh.values.size() == corrected.values.size() && mesh.values.size() == finer.values.size(),
          "pictures that are compared have the same size");
  const std::vector<std::uint32_t> edge = silhouettes(mesh.width, mesh.height, meshSamples, marchSamples, samples);
  Missing out;
  for (std::size_t k = 0; k < edge.size(); ++k) {
    const double lost = 1 - mesh.values[k], kept = 1 - corrected.values[k], own = 1 - finer.values[k];
    out.total += lost;
    if (edge[k] > 0) {
      out.silhouettes += lost;
      out.windows += 1;
      continue;
    }
    out.geometry += lost - kept;
    out.shading += kept - own;
    out.marcher += own;
  }
  for (double* share : {&out.total, &out.silhouettes, &out.geometry, &out.shading, &out.marcher, &out.windows})
    *share /= static_cast<double>(std::max<std::size_t>(edge.size(), 1));
  return out;
}

PixelError pixelErrorOf(std::span<const float> positions, const camera::Camera& camera, const terrain::Terrain& terrain) {
  std::vector<lattice::Step> x, z;
  std::vector<std::size_t> at;
  for (std::size_t k = 0; k + 3 < positions.size(); k += 4) {
    if (positions[k + 3] == 0) continue;
    at.push_back(k);
    x.push_back(camera.pose.x +
                static_cast<lattice::Step>(std::floor(camera.pose.remainderX + double{positions[k]} * lattice::kStepsPerMetre)));
    z.push_back(camera.pose.z +
                static_cast<lattice::Step>(std::floor(camera.pose.remainderZ + double{positions[k + 2]} * lattice::kStepsPerMetre)));
  }
  PixelError out;
  out.samples = at.size();
  if (at.empty()) return out;
  std::vector<float> heights(at.size());
  terrain.heights(x, z, heights);
  const camera::Vec3 forward = camera::forward(camera.pose), right = camera::right(camera.pose), up = camera::up(camera.pose);
  const double scale = camera::pixelsPerRadian(camera.projection);
  const auto project = [&](double px, double py, double pz) {
    const double depth = std::max(px * forward.x + py * forward.y + pz * forward.z, 0.05);
    return std::pair{scale * (px * right.x + py * right.y + pz * right.z) / depth, scale * (px * up.x + py * up.y + pz * up.z) / depth};
  };
  std::vector<double> errors(at.size());
  for (std::size_t k = 0; k < at.size(); ++k) {
    const float* p = &positions[at[k]];
    const auto [ax, ay] = project(p[0], p[1], p[2]);
    const auto [bx, by] = project(p[0], double{heights[k]} - camera.pose.y, p[2]);
    errors[k] = std::hypot(ax - bx, ay - by);
  }
  std::ranges::sort(errors);
  out.median = errors[errors.size() / 2];
  out.p99 = errors[(errors.size() - 1) * 99 / 100];
  out.worst = errors.back();
  return out;
}

}  // namespace ridgecast::evaluation
