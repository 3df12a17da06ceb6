#include "client/render/candidate_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace ridgecast::render {
namespace {

// A dot is shown whole or not at all: its middle decides. A little behind what is seen is still seen, as with edges.
constexpr std::string_view kVertex = R"(
layout(location = 0) in vec3 offset;  // metres from the camera
layout(location = 1) in vec3 paint;
uniform sampler2D candidateSurface;
uniform vec3 right, up, forward;
uniform vec2 scale;  // one over the tangents of the half angles
uniform float horizon, size;
out vec3 dotPaint;
out float dotAlpha;
void main() {
  float depth = dot(offset, forward);
  vec2 at = vec2(dot(offset, right), dot(offset, up)) * scale / max(depth, 1.0e-3);
  ivec2 samples = textureSize(candidateSurface, 0);
  vec4 s = texelFetch(candidateSurface, clamp(ivec2((at * 0.5 + 0.5) * vec2(samples)), ivec2(0), samples - 1), 0);
  bool hidden = s.w > 0.0 && depth > dot(s.xyz, forward) * 1.02 + 0.2;
  dotPaint = paint;
  dotAlpha = 1.0 - smoothstep(0.4, 0.9, length(offset) / horizon);
  gl_Position = depth < 0.1 || hidden ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(at, 0.0, 1.0);
  gl_PointSize = size;
}
)";

constexpr std::string_view kFragment = R"(
uniform float size;
in vec3 dotPaint;
in float dotAlpha;
layout(location = 0) out vec4 colour;
void main() {
  float away = length(gl_PointCoord - 0.5) * size;  // samples from the middle
  if (away > 0.5 * size) discard;
  colour = vec4(mix(dotPaint, vec3(0.02), size < 4.5 ? 0.0 : 0.8 * smoothstep(0.5 * size - 1.1, 0.5 * size - 0.4, away)), dotAlpha);
}
)";

struct Dot {
  float x, y, z;
  std::array<float, 3> paint;
};
static_assert(sizeof(Dot) == 24);

}  // namespace

CandidatePass::CandidatePass(Program program) : program_(std::move(program)), vertexArray_(makeVertexArray()), buffer_(makeBuffer()) {}

Outcome<CandidatePass> CandidatePass::create() {
  const std::array<Program::Piece, 1> pieces = {{{"candidates", kFragment}}};
  auto program = Program::build("candidates", kVertex, pieces);
  if (!program) return program.error();
  return CandidatePass(std::move(*program));
}

void CandidatePass::draw(const View& view, const Surface& surface, const Canvas& canvas, const std::vector<wire::Candidate>& points,
                         const CandidateColour& colour) const {
  const camera::Pose& pose = view.camera.pose;
  const camera::Projection& projection = view.camera.projection;
  std::vector<Dot> dots;
  dots.reserve(points.size());
  for (auto c = points.rbegin(); c != points.rend(); ++c)
    // Whole steps first, so that far out is as exact as here.
    dots.push_back({static_cast<float>((static_cast<double>(c->at.x - pose.x) - pose.remainderX) * lattice::kMetresPerStep),
                    static_cast<float>(c->at.y * lattice::kMetresPerStep - pose.y),
                    static_cast<float>((static_cast<double>(c->at.z - pose.z) - pose.remainderZ) * lattice::kMetresPerStep),
                    colour(c->pixels)});
  if (dots.empty()) return;
  glBindVertexArray(vertexArray_.name());
  glBindBuffer(GL_ARRAY_BUFFER, buffer_.name());
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(dots.size() * sizeof(Dot)), dots.data(), GL_STREAM_DRAW);
  glEnableVertexAttribArray(0);
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(Dot), nullptr);
  glEnableVertexAttribArray(1);
  glVertexAttribPointer(1, 3, GL_FLOAT, GL_FALSE, sizeof(Dot), reinterpret_cast<const void*>(offsetof(Dot, paint)));

  drawInto(canvas.framebuffer(), canvas.width(), canvas.height());
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
  glEnable(GL_PROGRAM_POINT_SIZE);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, surface.texture());
  program_.use();
  program_.set("candidateSurface", 0);
  setVector(program_, "right", camera::right(pose));
  setVector(program_, "up", camera::up(pose));
  setVector(program_, "forward", camera::forward(pose));
  const double tangent = std::tan(projection.verticalFov / 2);
  program_.set("scale", static_cast<float>(1 / (tangent * projection.aspect())), static_cast<float>(1 / tangent));
  program_.set("horizon", static_cast<float>(view.horizon));
  program_.set("size", std::max(2.0f, std::round(static_cast<float>(projection.height) / 110)));
  glDrawArrays(GL_POINTS, 0, static_cast<GLsizei>(dots.size()));
  glDisable(GL_PROGRAM_POINT_SIZE);
  glDisable(GL_BLEND);
  glBindTexture(GL_TEXTURE_2D, 0);
  glBindVertexArray(0);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
}

}  // namespace ridgecast::render
