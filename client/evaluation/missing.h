#pragma once
// Why a picture of the mesh differs from the ray march's: sources of error, and how far off the ground is.

#include <span>

#include "client/evaluation/ssim.h"
#include "common/camera/camera.h"
#include "common/terrain/terrain.h"

namespace ridgecast::evaluation {

// Shares of 1 - SSIM of the mesh's picture against the ray march's; they add up to `total`. A share may be negative.
struct Missing {
  double total = 0;
  double silhouettes = 0;  // windows with a pixel where the two see different ground: one sky, or 5 % of the distance apart
  double geometry = 0;     // elsewhere: disappears when every sample of the mesh is moved onto the true surface
  double shading = 0;      // elsewhere: remains then, without the marcher's: equal ground, different colours
  double marcher = 0;      // elsewhere: the ray march against one with finer steps
  double windows = 0;      // share of the windows that are silhouettes
};

// `mesh`, `corrected` and `finer` compare the mesh, the corrected mesh and the finer march with the march, pictures of one size.
// `meshSamples`, `marchSamples`: Renderer::positions() of both, with `samples` x `samples` a pixel.
Missing missingOf(const SimilarityMap& mesh, const SimilarityMap& corrected, const SimilarityMap& finer, std::span<const float> meshSamples,
                  std::span<const float> marchSamples, std::size_t samples);

// How far on the screen the ground seen lies from the true ground above or below it.
struct PixelError {
  double median = 0, p99 = 0, worst = 0;  // pixels
  std::size_t samples = 0;                // that see ground
};
// `positions` as Renderer::positions gives them, of a picture of this camera.
PixelError pixelErrorOf(std::span<const float> positions, const camera::Camera& camera, const terrain::Terrain& terrain);

}  // namespace ridgecast::evaluation
