#pragma once
// Moves what the mesh shows onto the true terrain: through each sample a few secant steps along its ray, from where the mesh has the
// ground to where the terrain function has it. A rendering of its own between mesh and ray march: it needs the terrain's function, costs
// one height a step (where the mesh is far from the ground, up to 37 more) and hides what the mesh lacks. Where true ground stands out over
// the mesh, in front of sky or farther ground, it is looked for above silhouettes, up to 8 samples high (up to 38 heights for a sample just
// above one); what stands out farther is lacking. Needs the context it was made in.

#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"

namespace ridgecast::render {

// Heights a sample, where the mesh is near the ground.
inline constexpr int kCorrectionSteps = 3;

class CorrectionPass {
 public:
  // Error: a shader that the driver does not compile. A terrain that is neutral leaves surfaces as they are.
  static Outcome<CorrectionPass> create(const TerrainText& terrain);
  // `out` is `mesh` corrected; the two are different surfaces of the view's size. Carried colours are not copied: a terrain that has
  // them is neutral, which canCorrect() tells. `steps` >= 1.
  void correct(const View& view, const Surface& mesh, const Surface& out, int steps = kCorrectionSteps) const;
  bool canCorrect() const { return canCorrect_; }

 private:
  CorrectionPass(Program program, std::uint32_t seed, bool canCorrect);
  Program program_;
  GlObject vertexArray_;
  std::uint32_t seed_;
  bool canCorrect_;
};

}  // namespace ridgecast::render
