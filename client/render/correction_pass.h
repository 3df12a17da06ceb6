#pragma once
// Moves the mesh's picture onto the true terrain: for each sample a few secant steps along its ray, from the mesh to the terrain function.
// A rendering between mesh and ray march, shown by default (common/shaders/correct.glsl). It needs the terrain's function, costs one height
// a step (far from the ground up to 37 more) and hides the mesh's errors. True ground that rises above the mesh, in front of sky or farther
// ground, is searched for above silhouettes, up to 8 samples high (up to 38 heights for a sample just above one); anything farther is
// missing. Needs the context it was made in.

#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"

namespace ridgecast::render {

// Heights a sample, while the mesh is near the ground.
inline constexpr int kCorrectionSteps = 3;

class CorrectionPass {
 public:
  // Error: a shader that the driver does not compile. A neutral terrain leaves surfaces unchanged.
  static Outcome<CorrectionPass> create(const TerrainText& terrain);
  // `out` becomes `mesh` corrected: two different surfaces of the view's size. Carried colours are not copied, because a terrain with them
  // is neutral (see canCorrect()). `steps` >= 1.
  void correct(const View& view, const Surface& mesh, const Surface& out, int steps = kCorrectionSteps) const;
  bool canCorrect() const { return canCorrect_; }

 private:
  CorrectionPass(Program program, std::uint32_t seed, bool canCorrect)
      : program_(std::move(program)), seed_(seed), canCorrect_(canCorrect) {}
  Program program_;
  std::uint32_t seed_;
  bool canCorrect_;
};

}  // namespace ridgecast::render
