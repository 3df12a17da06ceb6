#include "client/render/morph_pass.h"

#include "common/shaders/shaders.h"

namespace ridgecast::render {
namespace {

constexpr std::string_view kBlend = R"(
uniform sampler2D morphFrom, morphTo, morphCarriedFrom, morphCarriedTo;
uniform float morphShare;
layout(location = 0) out vec4 surface;
layout(location = 1) out vec4 carried;
float chance(ivec2 at) {
  uint h = uint(at.x) * 0x9e3779b1u ^ uint(at.y) * 0x85ebca77u;
  h = (h ^ (h >> 15u)) * 0x2c1b3c6du;
  h = (h ^ (h >> 12u)) * 0x297a2d39u;
  return float((h ^ (h >> 15u)) >> 8u) * (1.0 / 16777216.0);
}
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 a = texelFetch(morphFrom, at, 0);
  vec4 b = texelFetch(morphTo, at, 0);
  float near = length(a.xyz), far = length(b.xyz);
  float share = morphShare;
  if (a.w != b.w || abs(near - far) > 0.05 * min(near, far)) share = chance(at) < share ? 1.0 : 0.0;
  surface = mix(a, b, share);
  carried = mix(texelFetch(morphCarriedFrom, at, 0), texelFetch(morphCarriedTo, at, 0), share);
}
)";

}  // namespace

Outcome<MorphPass> MorphPass::create() {
  auto program = Program::build("morph", shaders::full_screen, kBlend);
  if (!program) return program.error();
  return MorphPass(std::move(*program));
}

void MorphPass::blend(const Surface& from, const Surface& to, float share, const Surface& out) const {
  drawInto(out);
  program_.use();
  program_.sample("morphFrom", 0, from.texture());
  program_.sample("morphTo", 1, to.texture());
  program_.sample("morphCarriedFrom", 2, from.carried());
  program_.sample("morphCarriedTo", 3, to.carried());
  program_.set("morphShare", share);
  program_.drawFullScreen();
}

}  // namespace ridgecast::render
