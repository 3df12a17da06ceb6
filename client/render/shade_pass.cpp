#include "client/render/shade_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cstddef>
#include <string>

#include "common/shaders/shaders.h"

namespace ridgecast::render {

Outcome<ShadePass> ShadePass::create(const TerrainText& terrain) {
  const std::string way = terrain.shaded    ? "#define SHADE_CARRIED\n"
                          : terrain.neutral ? "#define SHADE_NEUTRAL\n"
                          : terrain.raster  ? "#define SHADE_RASTER\n"
                                            : "";
  auto program = buildTerrainProgram("shading", terrain, way + std::string(shaders::shade));
  if (!program) return program.error();
  return ShadePass(std::move(*program), terrain.seed);
}

void ShadePass::shade(const View& view, const Surface& surface, const Canvas& canvas) const {
  drawInto(canvas);
  program_.use();
  setView(program_, view, seed_);
  program_.sample("shadeSurface", 0, surface.texture());
  program_.sample("shadeCarried", 1, surface.carried());
  program_.drawFullScreen();
}

Picture readBack(const Canvas& canvas) {
  const std::size_t width = canvas.width(), height = canvas.height();
  std::vector<std::uint8_t> rgba(width * height * 4);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, canvas.framebuffer());
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, static_cast<GLsizei>(width), static_cast<GLsizei>(height), GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
  Picture out{canvas.width(), canvas.height(), {}, {}};
  out.rgb.resize(width * height * 3);
  out.terrain.resize(width * height);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x) {
      const std::uint8_t* from = &rgba[4 * ((height - 1 - y) * width + x)];
      std::copy_n(from, 3, &out.rgb[3 * (y * width + x)]);
      out.terrain[y * width + x] = from[3];
    }
  return out;
}

void present(const Canvas& canvas, const Rectangle& target, const Rectangle& clip) {
  glBindFramebuffer(GL_READ_FRAMEBUFFER, canvas.framebuffer());
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
  glEnable(GL_SCISSOR_TEST);
  glScissor(clip.x, clip.y, clip.width, clip.height);
  glBlitFramebuffer(0, 0, static_cast<GLint>(canvas.width()), static_cast<GLint>(canvas.height()), target.x, target.y,
                    target.x + target.width, target.y + target.height, GL_COLOR_BUFFER_BIT, GL_LINEAR);
  glDisable(GL_SCISSOR_TEST);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
}

}  // namespace ridgecast::render
