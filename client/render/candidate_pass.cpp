#include "client/render/candidate_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "common/shaders/shaders.h"

namespace ridgecast::render {
namespace {

struct Dot {
  float x, y, z;
  std::array<float, 3> paint;
};
static_assert(sizeof(Dot) == 24);

}  // namespace

CandidatePass::CandidatePass(Program program) : program_(std::move(program)), vertexArray_(makeVertexArray()), buffer_(makeBuffer()) {}

Outcome<CandidatePass> CandidatePass::create() {
  auto program = Program::build("candidates", shaders::dots_vertex, shaders::dots);
  if (!program) return program.error();
  return CandidatePass(std::move(*program));
}

void CandidatePass::draw(const View& view, const Surface& surface, const Canvas& canvas, const std::vector<wire::Candidate>& points,
                         const CandidateColour& colour) const {
  const camera::Pose& pose = view.camera.pose;
  std::vector<Dot> dots;
  dots.reserve(points.size());
  for (auto c = points.rbegin(); c != points.rend(); ++c)
    // Differences in whole steps first: exact at any distance.
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
  program_.use();
  program_.sample("dotSurface", 0, surface.texture());
  setCamera(program_, view);
  program_.set("dotSize", std::max(2.0f, std::round(static_cast<float>(view.camera.projection.height) / 110)));
  glDrawArrays(GL_POINTS, 0, static_cast<GLsizei>(dots.size()));
  glDisable(GL_PROGRAM_POINT_SIZE);
  glDisable(GL_BLEND);
  glBindVertexArray(0);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
}

}  // namespace ridgecast::render
