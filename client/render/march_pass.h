#pragma once
// Ray-marches the terrain function into a surface: the picture that the mesh is measured against. It is converged: no step is longer
// than a tenth of the height above ground or shorter than a fifth of a sample, and a crossing is bisected 14 times; a march that is
// four times finer gives the same picture (a test holds it to SSIM >= 0.99). Needs the context it was made in.

#include <chrono>
#include <cstdint>

#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"

namespace ridgecast::render {

class MarchPass {
 public:
  static Outcome<MarchPass> create(const TerrainText& terrain);

  // Marches the whole surface, tile by tile so that no driver takes a long one for a hang. The surface has the view's size.
  // fineness divides every step: 1, or more for checking convergence.
  void march(const View& view, const Surface& surface, float fineness = 1);

  // The same in portions, for a window that must stay responsive: begin, then advance until it says that the surface is complete.
  // Each call marches tiles until `budget` has passed, at least one. The surface must stay until then.
  void begin(const View& view, const Surface& surface, float fineness = 1);
  bool advance(std::chrono::milliseconds budget);
  double progress() const;  // share of the tiles that are done, 1 when complete or never begun

 private:
  MarchPass(Program program, std::uint32_t seed);
  void marchTile(std::uint32_t tile);

  Program program_;
  GlObject vertexArray_;
  std::uint32_t seed_;
  View view_;
  float fineness_ = 1;
  std::uint32_t framebuffer_ = 0, width_ = 0, height_ = 0, tile_ = 0, tiles_ = 0;
};

}  // namespace ridgecast::render
