#pragma once
// Ray-marches the terrain function into a surface: the picture that the mesh is measured against. First it draws the *skyline*, the highest
// ground by direction and distance, sampled twice as densely as the picture; rays skip what they pass well above
// (common/shaders/march.glsl). Elsewhere no step is longer than a tenth of the height above ground or half a sample, or shorter than a
// fifth of one, and a crossing is bisected 14 times: rays meet whatever is half a sample wide, also a fence before an abyss. A test
// compares it with a march on the processor that is sixteen times finer and skips nothing. Needs the context it was made in.

#include <chrono>
#include <cstdint>
#include <optional>

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
  // Each call draws tiles of skyline and surface until `budget` has passed, at least one. The surface must stay until then.
  void begin(const View& view, const Surface& surface, float fineness = 1);
  bool advance(std::chrono::milliseconds budget);
  double progress() const;  // share of the tiles that are done, 1 when complete or never begun

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::uint32_t kTile = 128;  // samples a side
  // A target that is drawn tile by tile, from the bottom upwards, which is where the ground is.
  struct Tiles {
    std::uint32_t framebuffer = 0, width = 0, height = 0, done = 0;
    std::uint32_t columns() const { return (width + kTile - 1) / kTile; }
    std::uint32_t count() const { return columns() * ((height + kTile - 1) / kTile); }
    bool left() const { return done < count(); }
  };
  struct Sector {
    double half = 0, perRadian = 0;  // radians to each side of the middle; columns
    std::uint32_t columns = 0;
  };
  MarchPass(Program skyline, Program march, std::uint32_t seed);
  static Sector sectorOf(const camera::Camera& camera, int mostColumns);
  void use(const Program& program) const;
  static bool draw(const Program& program, Tiles& tiles, Clock::time_point end);

  Program skylineProgram_, marchProgram_;
  std::optional<Target> skylineTarget_;
  std::uint32_t seed_;
  int mostColumns_ = 0;
  View view_;
  float fineness_ = 1;
  Sector sector_;
  Tiles skyline_, picture_;
};

}  // namespace ridgecast::render
