#include "client/render/correction_pass.h"

#include <string>

#include "common/shaders/shaders.h"

namespace ridgecast::render {

Outcome<CorrectionPass> CorrectionPass::create(const TerrainText& terrain) {
  auto program = buildTerrainProgram("correction", terrain, (terrain.raster ? "#define RASTER\n" : "") + std::string(shaders::correct));
  if (!program) return program.error();
  return CorrectionPass(std::move(*program), terrain.seed, !terrain.neutral);
}

void CorrectionPass::correct(const View& view, const Surface& mesh, const Surface& out, int steps) const {
  drawInto(out);
  program_.use();
  setView(program_, view, seed_);
  program_.sample("correctSurface", 0, mesh.texture());
  program_.set("correctSteps", canCorrect_ ? steps : 0);
  program_.drawFullScreen();
}

}  // namespace ridgecast::render
