#include "client/render/march_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "common/outcome/contract.h"
#include "common/shaders/shaders.h"

namespace ridgecast::render {
namespace {

constexpr int kSkylineCellCount = 13 * 8;  // to 32.8 km

}  // namespace

MarchPass::MarchPass(Program skyline, Program march, std::uint32_t seed)
    : skylineProgram_(std::move(skyline)), marchProgram_(std::move(march)), seed_(seed) {
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &mostColumns_);
}

Outcome<MarchPass> MarchPass::create(const TerrainText& terrain) {
  auto skyline = buildTerrainProgram("skyline", terrain, "#define SKYLINE\n" + std::string(shaders::march));
  if (!skyline) return skyline.error();
  auto march = buildTerrainProgram("ray march", terrain, shaders::march);
  if (!march) return march.error();
  return MarchPass(std::move(*skyline), std::move(*march), terrain.seed);
}

void MarchPass::begin(const View& view, const Surface& surface, float fineness) {
  view_ = view;
  fineness_ = fineness;
  sector_ = sectorOf(view.camera, mostColumns_);
  if (sector_.columns != skyline_.width) skylineTarget_.emplace(GL_R32F, sector_.columns, kSkylineCellCount);
  skyline_ = {skylineTarget_->framebuffer(), sector_.columns, kSkylineCellCount};
  picture_ = {surface.framebuffer(), surface.width(), surface.height()};
}

// The directions between the picture's corners, half the circle each way where it sees straight up or down.
MarchPass::Sector MarchPass::sectorOf(const camera::Camera& camera, int mostColumns) {
  const double pitch = camera.pose.pitch, tangent = std::tan(camera.projection.verticalFov / 2);
  const double ahead = std::cos(pitch) - tangent * std::sin(std::abs(pitch));
  const double half = ahead > 0 ? std::atan(tangent * camera.projection.aspect() / ahead) : std::numbers::pi;
  const double perRadian = std::min(camera::pixelsPerRadian(camera.projection), (mostColumns - 2) / (2 * half));
  return {half, perRadian, static_cast<std::uint32_t>(std::ceil(2 * half * perRadian)) + 2};
}

void MarchPass::use(const Program& program) const {
  program.use();
  setView(program, view_, seed_);
  const camera::Vec3 right = camera::right(view_.camera.pose);
  program.set("skylineAhead", static_cast<float>(right.z), static_cast<float>(-right.x));
  program.set("skylineHalf", static_cast<float>(sector_.half));
  program.set("skylinePerRadian", static_cast<float>(sector_.perRadian));
}

bool MarchPass::advance(std::chrono::milliseconds budget) {
  expects(skylineTarget_.has_value(), "a march that goes on was begun");
  const Clock::time_point end = Clock::now() + budget;
  if (skyline_.left()) {
    use(skylineProgram_);
    if (!draw(skylineProgram_, skyline_, end)) return false;
  }
  if (!picture_.left()) return true;
  use(marchProgram_);
  marchProgram_.sample("skyline", 0, skylineTarget_->texture());
  marchProgram_.set("marchLowest", static_cast<float>(view_.lowest));
  marchProgram_.set("marchHighest", static_cast<float>(view_.highest));
  marchProgram_.set("marchFineness", fineness_);
  draw(marchProgram_, picture_, end);
  return !picture_.left();
}

// Whether there is time left.
bool MarchPass::draw(const Program& program, Tiles& tiles, Clock::time_point end) {
  drawInto(tiles.framebuffer, tiles.width, tiles.height);
  glEnable(GL_SCISSOR_TEST);
  bool inTime = true;
  for (; tiles.left() && inTime; inTime = Clock::now() < end) {
    const std::uint32_t tile = tiles.done++, x = tile % tiles.columns() * kTile, y = tile / tiles.columns() * kTile;
    glScissor(static_cast<GLint>(x), static_cast<GLint>(y), static_cast<GLsizei>(std::min(kTile, tiles.width - x)),
              static_cast<GLsizei>(std::min(kTile, tiles.height - y)));
    program.drawFullScreen();
    glFinish();
  }
  glDisable(GL_SCISSOR_TEST);
  return inTime;
}

void MarchPass::march(const View& view, const Surface& surface, float fineness) {
  begin(view, surface, fineness);
  while (!advance(std::chrono::hours(1))) {
  }
}

double MarchPass::progress() const {
  const std::uint32_t all = skyline_.count() + picture_.count();
  return all ? static_cast<double>(skyline_.done + picture_.done) / all : 1.0;
}

}  // namespace ridgecast::render
