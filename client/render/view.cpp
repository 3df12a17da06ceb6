#include "client/render/view.h"

#include <array>
#include <cmath>

#include "client/render/height_texture.h"
#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"

namespace ridgecast::render {
namespace {

// One triangle that covers the picture, without any buffer.
constexpr std::string_view kFullScreenVertex = R"(
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }
)";

// Ground that no ray meets.
constexpr std::string_view kNeutralTerrain = R"(
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return -131072.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
)";

// Cells and steps are integers relative to the camera's cell, so that nothing is ever far from anything: the only rounding is that of
// the offset from the camera, a float.
constexpr std::string_view kViewFunctions = R"(
uniform ivec2 viewCell;        // the camera's cell
uniform ivec2 viewSteps;       // its steps inside the cell
uniform vec2 viewRemainder;    // and the rest, in steps
uniform float viewCameraY;
uniform vec3 viewForward, viewRight, viewUp;  // unit vectors
uniform vec2 viewTangents;     // of the half angles, horizontal and vertical
uniform vec2 viewSize;         // of the picture, in samples
uniform float viewHorizon;
uniform uint viewSeed;
uniform float viewFiltered;      // 1 or 0

void viewLocate(vec2 offset, out ivec2 cell, out vec2 fraction) {
  ivec2 steps = viewSteps + ivec2(floor(offset * 256.0 + viewRemainder));
  cell = viewCell + (steps >> 20);
  fraction = vec2(steps & 0xfffff) * (1.0 / 1048576.0);
}
vec3 viewRay(vec2 sampleAt) {
  vec2 s = (sampleAt / viewSize * 2.0 - 1.0) * viewTangents;
  return normalize(viewForward + s.x * viewRight + s.y * viewUp);
}
float viewFootprint(float depth) { return depth * 2.0 * viewTangents.y / viewSize.y; }
float viewFilter(float depth) { return viewFiltered * viewFootprint(depth); }
)";

}  // namespace

void setVector(const Program& program, const char* name, const camera::Vec3& v) {
  program.set(name, static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z));
}

View supersampled(const View& view, std::uint32_t n) {
  View out = view;
  out.camera.projection.width *= n;
  out.camera.projection.height *= n;
  return out;
}

std::string_view fullScreenVertex() { return kFullScreenVertex; }

Outcome<Program> buildTerrainProgram(std::string_view what, const TerrainText& terrain, std::string_view main) {
  std::string noise(terrain::prelude());
  if (terrain.raster) noise += HeightTexture::accessor();
  const std::array<Program::Piece, 5> pieces = {{{"noise", noise},
                                                 {"terrain", terrain.neutral ? kNeutralTerrain : std::string_view(terrain.source)},
                                                 {"shading", terrain::shading()},
                                                 {"view", kViewFunctions},
                                                 {what, main}}};
  return Program::build(what, kFullScreenVertex, pieces);
}

void setView(const Program& program, const View& view, std::uint32_t seed) {
  const camera::Pose& pose = view.camera.pose;
  const camera::Projection& projection = view.camera.projection;
  constexpr lattice::Step kInCell = (lattice::Step{1} << lattice::kCellBits) - 1;
  program.set("viewCell", lattice::cellOf(pose.x), lattice::cellOf(pose.z));
  program.set("viewSteps", static_cast<int>(pose.x & kInCell), static_cast<int>(pose.z & kInCell));
  program.set("viewRemainder", static_cast<float>(pose.remainderX), static_cast<float>(pose.remainderZ));
  program.set("viewCameraY", static_cast<float>(pose.y));
  setVector(program, "viewForward", camera::forward(pose));
  setVector(program, "viewRight", camera::right(pose));
  setVector(program, "viewUp", camera::up(pose));
  const double tangent = std::tan(projection.verticalFov / 2);
  program.set("viewTangents", static_cast<float>(tangent * projection.aspect()), static_cast<float>(tangent));
  program.set("viewSize", static_cast<float>(projection.width), static_cast<float>(projection.height));
  program.set("viewHorizon", static_cast<float>(view.horizon));
  program.set("viewSeed", seed);
  program.set("viewFiltered", view.filtered ? 1.0f : 0.0f);
  if (view.heights) view.heights->bind(program);
}

}  // namespace ridgecast::render
