#include "client/render/correction_pass.h"

#include <epoxy/gl.h>

#include <string>

namespace ridgecast::render {
namespace {

// The mesh's own plane gives the first step's slope, the two last heights that of the others. No slope is taken for flatter than a
// quarter of the mesh's, and no step is longer than what lifts the ground by kMostSamples samples' widths: rough ground between two
// heights then costs accuracy, never a wild point.
constexpr std::string_view kCorrect = R"(
uniform sampler2D correctSurface;
uniform int correctSteps;
layout(location = 0) out vec4 surface;

const float kMostSamples = 8.0;

float correctGap(vec3 offset) {
  ivec2 cell;
  vec2 fraction;
  viewLocate(offset.xz, cell, fraction);
  return viewCameraY + offset.y - terrainHeight(cell, fraction, 0.0, viewSeed);
}

// From here to the nearer of the two samples beside it on an axis; w: 0 when both are sky.
vec4 correctAlong(vec3 here, ivec2 at, ivec2 next) {
  ivec2 last = textureSize(correctSurface, 0) - 1;
  vec4 after = texelFetch(correctSurface, min(at + next, last), 0);
  vec4 before = texelFetch(correctSurface, max(at - next, ivec2(0)), 0);
  vec3 forwards = after.xyz - here, backwards = here - before.xyz;
  float f = after.w > 0.0 && dot(forwards, forwards) > 0.0 ? dot(forwards, forwards) : 3.0e38;
  float b = before.w > 0.0 && dot(backwards, backwards) > 0.0 ? dot(backwards, backwards) : 3.0e38;
  return vec4(f < b ? forwards : backwards, min(f, b) < 3.0e38 ? 1.0 : 0.0);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  surface = texelFetch(correctSurface, at, 0);
  if (surface.w == 0.0 || correctSteps == 0) return;
  float t = length(surface.xyz);
  vec3 ray = surface.xyz / t;
  vec4 across = correctAlong(surface.xyz, at, ivec2(1, 0)), upwards = correctAlong(surface.xyz, at, ivec2(0, 1));
  vec3 normal = cross(across.xyz, upwards.xyz);
  // How fast the gap closes for each metre along the ray, were the ground the mesh's plane.
  float fall = across.w * upwards.w > 0.0 && abs(normal.y) > 1.0e-6 * length(normal) ? dot(ray, normal) / normal.y : ray.y;
  fall = min(fall, -0.02);
  float longest = kMostSamples * viewFootprint(dot(surface.xyz, viewForward)) / -fall;
  float slope = fall, best = t, gap = correctGap(surface.xyz), least = gap;
  UNKNOWN
  for (int k = 1; k <= correctSteps; ++k) {
    float next = t + clamp(-gap / slope, -longest, longest);
    if (k == correctSteps) {
      if (abs(gap) <= abs(least)) best = next;
      break;
    }
    float there = correctGap(ray * next);
    slope = next != t ? min((there - gap) / (next - t), 0.25 * fall) : fall;
    t = next;
    gap = there;
    if (abs(gap) <= abs(least)) {
      best = t;
      least = gap;
    }
  }
  surface = vec4(ray * max(best, 0.05), 1.0);
}
)";

}  // namespace

CorrectionPass::CorrectionPass(Program program, std::uint32_t seed, bool canCorrect)
    : program_(std::move(program)), vertexArray_(makeVertexArray()), seed_(seed), canCorrect_(canCorrect) {}

Outcome<CorrectionPass> CorrectionPass::create(const TerrainText& terrain) {
  std::string main(kCorrect);
  // Beyond what is known of a height map the mesh is all there is.
  const std::string_view mark = "UNKNOWN";
  main.replace(main.find(mark), mark.size(), terrain.raster ? "if (viewCameraY + surface.y - gap <= kUnknownHeight) return;" : "");
  auto program = buildTerrainProgram("correction", terrain, main);
  if (!program) return program.error();
  return CorrectionPass(std::move(*program), terrain.seed, !terrain.neutral);
}

void CorrectionPass::correct(const View& view, const Surface& mesh, const Surface& out, int steps) const {
  drawInto(out.framebuffer(), out.width(), out.height());
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, mesh.texture());
  program_.use();
  setView(program_, view, seed_);
  program_.set("correctSurface", 0);
  program_.set("correctSteps", canCorrect_ ? steps : 0);
  drawFullScreen(vertexArray_);
  glBindTexture(GL_TEXTURE_2D, 0);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
}

}  // namespace ridgecast::render
