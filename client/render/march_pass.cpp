#include "client/render/march_pass.h"

#include <epoxy/gl.h>

#include <algorithm>

namespace ridgecast::render {
namespace {

constexpr std::uint32_t kTile = 128;  // samples a side

constexpr std::string_view kMarch = R"(
uniform float marchLowest, marchHighest, marchFineness;
layout(location = 0) out vec4 surface;

float marchGap(vec3 offset) {
  ivec2 cell;
  vec2 fraction;
  viewLocate(offset.xz, cell, fraction);
  return viewCameraY + offset.y - terrainHeight(cell, fraction, 0.0, viewSeed);
}

void main() {
  surface = vec4(0.0);
  vec3 ray = viewRay(gl_FragCoord.xy);
  float sampleWidth = viewFootprint(dot(ray, viewForward));  // for each metre along the ray
  float near = 0.1, far = viewHorizon;
  float air = marchHighest - viewCameraY;  // how far below the highest ground the camera is
  if (air < 0.0) {
    if (ray.y >= 0.0) return;
    near = max(near, air / ray.y);
  } else if (ray.y > 0.0) {
    far = min(far, air / ray.y);
  }
  if (ray.y < 0.0) far = min(far, (marchLowest - viewCameraY) / ray.y);
  if (near >= far) return;

  // A tenth of the gap, so that a cliff of 84 degrees is not stepped over: a quarter lost the upper edge of one behind a deep valley.
  float t = near, above = near;
  float gap = marchGap(ray * t);
  // Grazing rays near the ground take the most steps: ln(far / near) / (0.2 / 700) is 40,000 at 720 lines.
  for (int k = 0; k < 1000000 && gap > 0.0 && t < far; ++k) {
    above = t;
    t = min(t + max(max(0.1 * gap, 0.2 * sampleWidth * t), 0.005) / marchFineness, far);
    gap = marchGap(ray * t);
  }
  if (gap > 0.0) return;
  float below = t;
  for (int k = 0; k < 14; ++k) {
    float middle = 0.5 * (above + below);
    if (marchGap(ray * middle) > 0.0) above = middle; else below = middle;
  }
  surface = vec4(ray * (0.5 * (above + below)), 1.0);
}
)";

}  // namespace

MarchPass::MarchPass(Program program, std::uint32_t seed) : program_(std::move(program)), vertexArray_(makeVertexArray()), seed_(seed) {}

Outcome<MarchPass> MarchPass::create(const TerrainText& terrain) {
  auto program = buildTerrainProgram("ray march", terrain, kMarch);
  if (!program) return program.error();
  return MarchPass(std::move(*program), terrain.seed);
}

void MarchPass::begin(const View& view, const Surface& surface, float fineness) {
  view_ = view;
  fineness_ = fineness;
  framebuffer_ = surface.framebuffer();
  width_ = surface.width();
  height_ = surface.height();
  tile_ = 0;
  tiles_ = ((width_ + kTile - 1) / kTile) * ((height_ + kTile - 1) / kTile);
}

bool MarchPass::advance(std::chrono::milliseconds budget) {
  if (tile_ >= tiles_) return true;
  const auto end = std::chrono::steady_clock::now() + budget;
  drawInto(framebuffer_, width_, height_);
  glEnable(GL_SCISSOR_TEST);
  program_.use();
  setView(program_, view_, seed_);
  program_.set("marchLowest", static_cast<float>(view_.lowest));
  program_.set("marchHighest", static_cast<float>(view_.highest));
  program_.set("marchFineness", fineness_);
  glBindVertexArray(vertexArray_.name());
  do {
    marchTile(tile_++);
    glFinish();
  } while (tile_ < tiles_ && std::chrono::steady_clock::now() < end);
  glBindVertexArray(0);
  glDisable(GL_SCISSOR_TEST);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  return tile_ >= tiles_;
}

void MarchPass::march(const View& view, const Surface& surface, float fineness) {
  begin(view, surface, fineness);
  while (!advance(std::chrono::hours(1))) {
  }
}

double MarchPass::progress() const { return tiles_ ? static_cast<double>(tile_) / tiles_ : 1.0; }

// From the bottom upwards, which is where the ground is.
void MarchPass::marchTile(std::uint32_t tile) {
  const std::uint32_t columns = (width_ + kTile - 1) / kTile;
  const std::uint32_t x = (tile % columns) * kTile, y = (tile / columns) * kTile;
  glScissor(static_cast<GLint>(x), static_cast<GLint>(y), static_cast<GLsizei>(std::min(kTile, width_ - x)),
            static_cast<GLsizei>(std::min(kTile, height_ - y)));
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

}  // namespace ridgecast::render
