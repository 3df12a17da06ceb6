#pragma once
// Ray-marches the terrain function into a surface: the picture that the mesh is measured against. First the *skyline* is drawn, the highest ground by
// direction and distance, sampled twice as densely as the picture; rays skip what they pass well above. Elsewhere no step is longer than a tenth of the height
// above ground or half a sample, or shorter than a fifth of one, and a crossing is bisected 14 times: whatever is half a sample wide is met, a fence before an
// abyss too. A test compares it with a march on the processor that is sixteen times finer and skips nothing. Needs the context it was made in.

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
  struct Sector {
    double half, perRadian;  // radians to each side of the middle; columns
    std::uint32_t columns;
  };
  MarchPass(Program skyline, Program march, std::uint32_t seed);
  Sector sector() const;
  void setSkyline(const Program& program, const Sector& sector) const;
  void drawSkyline();
  void marchTile(std::uint32_t tile);

  Program skyline_, program_;
  GlObject vertexArray_, skylineFramebuffer_, skylineTexture_;
  std::uint32_t skylineColumns_ = 0;
  std::uint32_t seed_;
  View view_;
  float fineness_ = 1;
  std::uint32_t framebuffer_ = 0, width_ = 0, height_ = 0, tile_ = 0, tiles_ = 0;
};

}  // namespace ridgecast::render
