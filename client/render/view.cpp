#include "client/render/view.h"

#include <array>
#include <cmath>

#include "client/render/edit_texture.h"
#include "client/render/height_texture.h"
#include "common/lattice/lattice.h"
#include "common/shaders/shaders.h"
#include "common/terrain/terrain.h"

namespace ridgecast::render {

void setVector(const Program& program, const char* name, const camera::Vec3& v) {
  program.set(name, static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z));
}

View supersampled(const View& view, std::uint32_t n) {
  View out = view;
  out.camera.projection.width *= n;
  out.camera.projection.height *= n;
  return out;
}

Outcome<Program> buildTerrainProgram(std::string_view what, const TerrainText& terrain, std::string_view main) {
  std::string noise(terrain::prelude());
  if (terrain.raster) noise += HeightTexture::accessor(terrain.draped);
  std::string edited;
  if (!terrain.neutral) {
    noise += terrain::beforeEdited();
    edited = terrain::edited();
  }
  const std::array<Program::Piece, 6> pieces = {{{"noise", noise},
                                                 {"terrain", terrain.neutral ? shaders::neutral_terrain : std::string_view(terrain.source)},
                                                 {"edits", edited},
                                                 {"shading", terrain::shading()},
                                                 {"view", shaders::view},
                                                 {what, main}}};
  return Program::build(what, shaders::full_screen, pieces);
}

void setCamera(const Program& program, const View& view) {
  const camera::Pose& pose = view.camera.pose;
  const camera::Projection& projection = view.camera.projection;
  setVector(program, "viewForward", camera::forward(pose));
  setVector(program, "viewRight", camera::right(pose));
  setVector(program, "viewUp", camera::up(pose));
  const double tangent = std::tan(projection.verticalFov / 2);
  program.set("viewTangents", static_cast<float>(tangent * projection.aspect()), static_cast<float>(tangent));
  program.set("viewScale", static_cast<float>(1 / (tangent * projection.aspect())), static_cast<float>(1 / tangent));
  program.set("viewHorizon", static_cast<float>(view.horizon));
}

void setView(const Program& program, const View& view, std::uint32_t seed) {
  const camera::Pose& pose = view.camera.pose;
  const camera::Projection& projection = view.camera.projection;
  constexpr lattice::Step kInCell = (lattice::Step{1} << lattice::kCellBits) - 1;
  program.set("viewCell", lattice::cellOf(pose.x), lattice::cellOf(pose.z));
  program.set("viewSteps", static_cast<int>(pose.x & kInCell), static_cast<int>(pose.z & kInCell));
  program.set("viewRemainder", static_cast<float>(pose.remainderX), static_cast<float>(pose.remainderZ));
  program.set("viewCameraY", static_cast<float>(pose.y));
  setCamera(program, view);
  program.set("viewSize", static_cast<float>(projection.width), static_cast<float>(projection.height));
  program.set("viewSeed", seed);
  program.set("viewFiltered", view.filtered ? 1.0f : 0.0f);
  EditTexture::bind(view.edits, program);
  if (view.heights) view.heights->bind(program);
}

}  // namespace ridgecast::render
