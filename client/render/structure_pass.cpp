#include "client/render/structure_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "common/shaders/shaders.h"

namespace ridgecast::render {
namespace {

// Lines slightly behind the surface are still visible: lines and triangles are sampled at different places, and a morphing surface lies
// between two meshes.
constexpr std::string_view kSeen = R"(
uniform sampler2D structureSurface;
uniform vec3 viewForward;
uniform float viewHorizon;
in vec3 offset;
in float depth;
layout(location = 0) out vec4 colour;
float seen(float tolerance) {  // 0: hidden; fades out towards the horizon
  vec4 s = texelFetch(structureSurface, ivec2(gl_FragCoord.xy), 0);
  if (s.w == 0.0 || depth > dot(s.xyz, viewForward) * (1.0 + tolerance) + 0.1) return 0.0;
  return 1.0 - smoothstep(0.4, 0.9, length(offset) / viewHorizon);
}
)";

// Edges fade out with the size of a leaf's triangles on screen, foreshortened as the surface there; otherwise tiny triangles would leave
// nothing but edges.
constexpr std::string_view kEdges = R"(
uniform float pixels;  // that the side of one of the leaf's triangles covers at a depth of one metre
float facing() {  // the cosine between the surface's normal and the line of sight
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec3 s = texelFetch(structureSurface, at, 0).xyz;
  vec3 normal = cross(texelFetch(structureSurface, at + ivec2(1, 0), 0).xyz - s, texelFetch(structureSurface, at + ivec2(0, 1), 0).xyz - s);
  return abs(dot(normal, s)) / max(length(normal) * length(s), 1e-9);
}
void main() {
  float alpha = 0.6 * seen(0.01);
  if (alpha > 0.0) alpha *= smoothstep(1.5, 7.0, pixels / depth * facing());
  if (alpha == 0.0) discard;
  colour = vec4(0.02, 0.02, 0.06, alpha);
}
)";

constexpr std::string_view kLeaves = R"(
uniform vec3 square;  // the leaf's least corner, x and z from the camera, and its side: metres
uniform vec3 paint;
uniform float lineWidth;  // samples
void main() {
  vec2 place = offset.xz - square.xy;
  vec2 lines = min(abs(place), abs(square.z - place)) / max(fwidth(place), vec2(1e-4));
  float line = 1.0 - smoothstep(lineWidth - 0.5, lineWidth + 0.5, min(lines.x, lines.y));
  float alpha = seen(0.002) * mix(0.3, 0.95, line);
  if (alpha == 0.0) discard;
  colour = vec4(paint, alpha);
}
)";

// One fill over the whole picture.
constexpr std::string_view kFrustum = R"(
uniform sampler2D structureSurface;
uniform vec3 fromFrozen;  // the camera, seen from the frozen one; metres
uniform vec3 viewRight, viewUp, viewForward;  // of the frozen one
uniform vec2 viewTangents;
uniform float viewHorizon;
layout(location = 0) out vec4 colour;
void main() {
  vec4 s = texelFetch(structureSurface, ivec2(gl_FragCoord.xy), 0);
  if (s.w == 0.0) discard;
  vec3 at = s.xyz + fromFrozen;
  float depth = dot(at, viewForward);
  bool inside = depth > 0.0 && abs(dot(at, viewRight)) <= depth * viewTangents.x && abs(dot(at, viewUp)) <= depth * viewTangents.y;
  if (inside) discard;
  colour = vec4(0.03, 0.04, 0.10, 0.55 * (1.0 - smoothstep(0.4, 0.9, length(s.xyz) / viewHorizon)));
}
)";

struct Dot {
  float x, y, z;
  std::array<float, 3> paint;
};
static_assert(sizeof(Dot) == 24);

using lattice::metres;

Outcome<Program> meshProgram(std::string_view what, std::string_view main) {
  const std::array<Program::Piece, 2> pieces = {{{"seen", kSeen}, {what, main}}};
  return Program::build(what, shaders::mesh_vertex, pieces);
}

}  // namespace

StructurePass::StructurePass(Program edges, Program leaves, Program frustum, Program dots)
    : edges_(std::move(edges)),
      leaves_(std::move(leaves)),
      frustum_(std::move(frustum)),
      dots_(std::move(dots)),
      dotArray_(makeVertexArray()),
      dotBuffer_(makeBuffer()) {}

Outcome<StructurePass> StructurePass::create() {
  auto edges = meshProgram("edges", kEdges);
  if (!edges) return edges.error();
  auto leaves = meshProgram("leaves", kLeaves);
  if (!leaves) return leaves.error();
  auto frustum = Program::build("frustum", shaders::full_screen, kFrustum);
  if (!frustum) return frustum.error();
  auto dots = Program::build("candidates", shaders::dots_vertex, shaders::dots);
  if (!dots) return dots.error();
  return StructurePass(std::move(*edges), std::move(*leaves), std::move(*frustum), std::move(*dots));
}

void StructurePass::draw(const View& view, const MeshPass& mesh, const Surface& surface, const Canvas& canvas,
                         const Structure& structure) const {
  if (!structure.any()) return;
  const camera::Pose& pose = view.camera.pose;
  drawInto(canvas);
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
  if (structure.leafColour) {
    leaves_.use();
    leaves_.sample("structureSurface", 0, surface.texture());
    leaves_.set("lineWidth", std::max(1.0f, static_cast<float>(view.camera.projection.height) / 500));
    mesh.redraw(view, leaves_, [&](const MeshPass::Leaf& leaf) {
      const lattice::LeafAddress& a = leaf.address;
      leaves_.set("square", static_cast<float>(metres(a.x() - pose.x)), static_cast<float>(metres(a.z() - pose.z)),
                  static_cast<float>(metres(a.side())));
      const auto c = structure.leafColour(a);
      leaves_.set("paint", c[0], c[1], c[2]);
    });
  }
  if (structure.wireframe) {
    edges_.use();
    edges_.sample("structureSurface", 0, surface.texture());
    glPolygonMode(GL_FRONT_AND_BACK, GL_LINE);
    const double pixels = camera::pixelsPerRadian(view.camera.projection);
    mesh.redraw(view, edges_, [&](const MeshPass::Leaf& leaf) {
      const double side = metres(leaf.address.side()) / std::sqrt(std::max(1.0, static_cast<double>(leaf.triangles) / 2));
      edges_.set("pixels", static_cast<float>(side * pixels));
    });
    glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
  }
  if (structure.frozen) {
    const camera::Pose& frozen = structure.frozen->pose;
    frustum_.use();
    frustum_.sample("structureSurface", 0, surface.texture());
    setVector(frustum_, "fromFrozen", {metres(pose.x - frozen.x), pose.y - frozen.y, metres(pose.z - frozen.z)});
    View from = view;
    from.camera = *structure.frozen;
    setCamera(frustum_, from);
    frustum_.drawFullScreen();
  }
  if (structure.candidates && !structure.candidates->empty()) {
    dots_.use();
    dots_.sample("dotSurface", 0, surface.texture());
    drawCandidates(view, structure);
  }
  glDisable(GL_BLEND);
}

void StructurePass::drawCandidates(const View& view, const Structure& structure) const {
  const camera::Pose& pose = view.camera.pose;
  std::vector<Dot> dots;
  dots.reserve(structure.candidates->size());
  for (auto c = structure.candidates->rbegin(); c != structure.candidates->rend(); ++c)
    // Differences in whole steps first: exact at any distance.
    dots.push_back({static_cast<float>((static_cast<double>(c->at.x - pose.x) - pose.remainderX) * lattice::kMetresPerStep),
                    static_cast<float>(c->at.y * lattice::kMetresPerStep - pose.y),
                    static_cast<float>((static_cast<double>(c->at.z - pose.z) - pose.remainderZ) * lattice::kMetresPerStep),
                    structure.candidateColour(c->pixels)});
  glBindVertexArray(dotArray_.name());
  glBindBuffer(GL_ARRAY_BUFFER, dotBuffer_.name());
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(dots.size() * sizeof(Dot)), dots.data(), GL_STREAM_DRAW);
  glEnableVertexAttribArray(0);
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(Dot), nullptr);
  glEnableVertexAttribArray(1);
  glVertexAttribPointer(1, 3, GL_FLOAT, GL_FALSE, sizeof(Dot), std::bit_cast<const void*>(offsetof(Dot, paint)));
  setCamera(dots_, view);
  dots_.set("dotSize", std::max(2.0f, std::round(static_cast<float>(view.camera.projection.height) / 110)));
  glEnable(GL_PROGRAM_POINT_SIZE);
  glDrawArrays(GL_POINTS, 0, static_cast<GLsizei>(dots.size()));
  glDisable(GL_PROGRAM_POINT_SIZE);
  glBindVertexArray(0);
}

}  // namespace ridgecast::render
