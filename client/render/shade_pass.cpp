#include "client/render/shade_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cstddef>
#include <string>

namespace ridgecast::render {
namespace {

// The height that colours depend on is the terrain's own, not the mesh's: like the normal it then follows from x and z alone, so that
// what is left between the two renderings is where the surface is, not how it is painted.
constexpr std::string_view kShade = R"(
uniform sampler2D shadeSurface;
layout(location = 0) out vec4 colour;
void main() {
  vec4 s = texelFetch(shadeSurface, ivec2(gl_FragCoord.xy), 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light;
  if (ground) {
    ivec2 cell;
    vec2 fraction;
    viewLocate(s.xz, cell, fraction);
    float height = terrainHeight(cell, fraction, 0.0, viewSeed);
    light = shadeTerrain(cell, fraction, height, viewFilter(dot(s.xyz, viewForward)), s.xyz / max(range, 1e-6), range, viewHorizon, viewSeed);
  } else {
    light = skyColor(viewRay(gl_FragCoord.xy));
  }
  colour = vec4(toDisplay(light), ground ? 1.0 : 0.0);
}
)";

// The normal of the mesh, from the positions beside this one (the nearer of the two on each axis, so that edges do not smear).
constexpr std::string_view kMeshNormal = R"(
uniform sampler2D shadeSurface;
layout(location = 0) out vec4 colour;
vec3 along(vec3 here, ivec2 at, ivec2 step) {
  ivec2 last = textureSize(shadeSurface, 0) - 1;
  vec4 after = texelFetch(shadeSurface, min(at + step, last), 0);
  vec4 before = texelFetch(shadeSurface, max(at - step, ivec2(0)), 0);
  vec3 forwards = after.xyz - here;
  vec3 backwards = here - before.xyz;
  bool first = after.w > 0.0 && at + step == min(at + step, last);
  bool second = before.w > 0.0 && at - step == max(at - step, ivec2(0));
  return first && (!second || dot(forwards, forwards) < dot(backwards, backwards)) ? forwards : backwards;
}
vec3 meshNormal(vec3 here, ivec2 at) {
  vec3 normal = cross(along(here, at, ivec2(1, 0)), along(here, at, ivec2(0, 1)));
  normal = dot(normal, normal) > 0.0 ? normalize(normal) : vec3(0.0, 1.0, 0.0);
  return normal.y < 0.0 ? -normal : normal;
}
vec3 plainLight(vec3 normal) {
  return vec3(2.6, 2.3, 1.9) * max(dot(normal, kSunDirection), 0.0) + vec3(0.30, 0.38, 0.50) * (0.6 + 0.4 * normal.y);
}
)";

// Without the terrain's functions: the mesh's normal, and a ramp of heights from green through ochre and grey to white.
constexpr std::string_view kNeutralShade = R"(
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 s = texelFetch(shadeSurface, at, 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light;
  if (ground) {
    vec3 normal = meshNormal(s.xyz, at);
    float height = viewCameraY + s.y;
    vec3 ramp = mix(vec3(0.16, 0.20, 0.10), vec3(0.33, 0.29, 0.18), smoothstep(0.0, 800.0, height));
    ramp = mix(ramp, vec3(0.34, 0.33, 0.32), smoothstep(800.0, 1700.0, height));
    ramp = mix(ramp, vec3(0.62), smoothstep(1700.0, 3200.0, height));
    light = ramp * plainLight(normal);
    light = mix(skyColor(s.xyz / max(range, 1e-6)), light, clearness(range, viewHorizon));
  } else {
    light = skyColor(viewRay(gl_FragCoord.xy));
  }
  colour = vec4(toDisplay(light), ground ? 1.0 : 0.0);
}
)";

// A private terrain's: what the vertices brought along, lit by the mesh pass.
constexpr std::string_view kCarriedShade = R"(
uniform sampler2D shadeCarried;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 s = texelFetch(shadeSurface, at, 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light = ground ? mix(skyColor(s.xyz / max(range, 1e-6)), texelFetch(shadeCarried, at, 0).rgb, clearness(range, viewHorizon))
                      : skyColor(viewRay(gl_FragCoord.xy));
  colour = vec4(toDisplay(light), ground ? 1.0 : 0.0);
}
)";

// A height map's: as any terrain where the window of samples reaches, beyond it from the mesh's own shape.
constexpr std::string_view kRasterShade = R"(
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 s = texelFetch(shadeSurface, at, 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light;
  if (ground) {
    ivec2 cell;
    vec2 fraction;
    viewLocate(s.xz, cell, fraction);
    vec3 direction = s.xyz / max(range, 1e-6);
    float footprint = viewFilter(dot(s.xyz, viewForward));
    float reach = max(footprint, rasterPitchMetres);
    float height = terrainHeight(cell, fraction, 0.0, viewSeed);
    float least = min(min(heightNear(cell, fraction, -reach, -reach, footprint, viewSeed), heightNear(cell, fraction, reach, reach, footprint, viewSeed)),
                      min(heightNear(cell, fraction, -reach, reach, footprint, viewSeed), heightNear(cell, fraction, reach, -reach, footprint, viewSeed)));
    if (min(height, least) > kUnknownHeight) {
      light = shadeTerrain(cell, fraction, height, footprint, direction, range, viewHorizon, viewSeed);
    } else {
      vec3 normal = meshNormal(s.xyz, at);
      light = terrainColor(cell, fraction, viewCameraY + s.y, normal, footprint, viewSeed) * plainLight(normal);
      light = mix(skyColor(direction), light, clearness(range, viewHorizon));
    }
  } else {
    light = skyColor(viewRay(gl_FragCoord.xy));
  }
  colour = vec4(toDisplay(light), ground ? 1.0 : 0.0);
}
)";

}  // namespace

ShadePass::ShadePass(Program program, std::uint32_t seed) : program_(std::move(program)), vertexArray_(makeVertexArray()), seed_(seed) {}

Outcome<ShadePass> ShadePass::create(const TerrainText& terrain) {
  const std::string_view main = terrain.shaded ? kCarriedShade : terrain.neutral ? kNeutralShade : terrain.raster ? kRasterShade : kShade;
  auto program = buildTerrainProgram("shading", terrain, std::string(main == kShade ? "" : kMeshNormal) + std::string(main));
  if (!program) return program.error();
  return ShadePass(std::move(*program), terrain.seed);
}

void ShadePass::shade(const View& view, const Surface& surface, const Canvas& canvas) const {
  drawInto(canvas.framebuffer(), canvas.width(), canvas.height());
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, surface.texture());
  program_.use();
  setView(program_, view, seed_);
  program_.set("shadeSurface", 0);
  program_.set("shadeCarried", 1);
  glActiveTexture(GL_TEXTURE1);
  glBindTexture(GL_TEXTURE_2D, surface.carried());
  glActiveTexture(GL_TEXTURE0);
  drawFullScreen(vertexArray_);
  glBindTexture(GL_TEXTURE_2D, 0);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
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
