#include "client/render/difference_pass.h"

#include <array>

#include "common/shaders/shaders.h"

namespace ridgecast::render {
namespace {

constexpr std::string_view kDifference = R"(
uniform sampler2D differenceA, differenceB;
uniform vec2 differenceSize;
uniform vec3 ramp0, ramp1, ramp2, ramp3, ramp4;  // kDifferenceRamp
layout(location = 0) out vec4 colour;
void main() {
  vec2 at = gl_FragCoord.xy / differenceSize;
  vec3 a = texelFetch(differenceA, ivec2(at * vec2(textureSize(differenceA, 0))), 0).rgb;
  vec3 b = texelFetch(differenceB, ivec2(at * vec2(textureSize(differenceB, 0))), 0).rgb;
  float v = min(length(a - b) * (4.0 / 1.7320508), 1.0) * 4.0;
  vec3 ramp[5] = vec3[5](ramp0, ramp1, ramp2, ramp3, ramp4);
  int k = min(int(v), 3);
  colour = vec4(mix(ramp[k], ramp[k + 1], v - float(k)), 1.0);
}
)";

}  // namespace

Outcome<DifferencePass> DifferencePass::create() {
  auto program = Program::build("difference", shaders::full_screen, kDifference);
  if (!program) return program.error();
  return DifferencePass(std::move(*program));
}

void DifferencePass::present(const Canvas& a, const Canvas& b, int width, int height) const {
  drawInto(0, static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height));
  program_.use();
  program_.sample("differenceA", 0, a.texture());
  program_.sample("differenceB", 1, b.texture());
  program_.set("differenceSize", static_cast<float>(width), static_cast<float>(height));
  static constexpr std::array<const char*, 5> kNames = {"ramp0", "ramp1", "ramp2", "ramp3", "ramp4"};
  for (std::size_t k = 0; k < kNames.size(); ++k)
    program_.set(kNames[k], kDifferenceRamp[k][0], kDifferenceRamp[k][1], kDifferenceRamp[k][2]);
  program_.drawFullScreen();
}

}  // namespace ridgecast::render
