#pragma once
// Pictures of one world, from the held mesh and by ray march, drawn off screen. Needs the context it was made in.

#include <chrono>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <vector>

#include "client/core/mesh/scene.h"
#include "client/render/correction_pass.h"
#include "client/render/march_pass.h"
#include "client/render/mesh_pass.h"
#include "client/render/morph_pass.h"
#include "client/render/picture.h"
#include "client/render/shade_pass.h"
#include "common/terrain/terrain.h"

namespace ridgecast::render {

// Bounds of the terrain's heights within `radius` metres around a point: sampled every 128 m, with a margin of 400 m for what lies between.
// A height map's are those of all its samples. With the terrain's edits, if it has any.
struct HeightBounds {
  double lowest = 0, highest = 0;
};
HeightBounds boundsAround(const terrain::Terrain& terrain, lattice::Point centre, double radius);
// Bounds of the ground with these edits, where `own` are those of the terrain's.
HeightBounds withEdits(HeightBounds own, const terrain::Raster* edits, lattice::Point centre, double radius);

// What draws a world. Error: a shader that the driver does not compile.
struct Passes {
  MeshPass mesh, before;  // before: of the mesh that a morph begins with
  MorphPass morph;
  CorrectionPass correction;
  MarchPass march;
  ShadePass shade;
  static Outcome<Passes> create(const TerrainText& terrain);
};

class Renderer {
 public:
  static Outcome<Renderer> create(const TerrainText& terrain);

  struct Drawn {
    Picture picture;
    double milliseconds = 0;     // drawing and shading, all samples; not reading back
    double cpuMilliseconds = 0;  // of all threads of this process: what a software driver costs, independent of other programs
  };
  // The view is the picture's; n x n samples a pixel, averaged as display values. Error: a picture larger than the driver can draw.
  Outcome<Drawn> drawMesh(const core::Leaves& leaves, const View& view, std::uint32_t samples = 1);
  // The blend of two meshes (morph_pass.h).
  Outcome<Drawn> drawMorph(const core::Leaves& from, const core::Leaves& to, float share, const View& view);
  // The mesh with each sample moved onto the true terrain (correction_pass.h).
  Outcome<Drawn> drawCorrected(const core::Leaves& leaves, const View& view, std::uint32_t samples = 1, int steps = kCorrectionSteps);
  Outcome<Drawn> drawMarch(const View& view, std::uint32_t samples = 1, float fineness = 1);

  // The last drawing, coloured again with another `filtered`. Camera and samples must be the same.
  Outcome<Drawn> shadeAgain(const View& view, std::uint32_t samples = 1);
  // The last drawing's samples: x, y, z in metres from the camera, and 1 for ground or 0 for sky; rows from top to bottom.
  std::vector<float> positions() const;
  // Uploads the given leaves without drawing; returns the milliseconds until they are on the graphics card.
  double upload(const core::Leaves& leaves);

 private:
  explicit Renderer(Passes passes) : passes_(std::move(passes)) {}
  Outcome<void> fit(const View& view, std::initializer_list<std::optional<Surface>*> beside = {});
  static double processMilliseconds();
  struct Began {
    std::chrono::steady_clock::time_point wall = std::chrono::steady_clock::now();
    double cpu = processMilliseconds();
  };
  Drawn finish(const View& view, std::uint32_t samples, Began began);

  Passes passes_;
  std::optional<Surface> surface_, first_, second_;  // the last two for morphs, the first of them also for corrections
  std::optional<Canvas> canvas_;
};

}  // namespace ridgecast::render
