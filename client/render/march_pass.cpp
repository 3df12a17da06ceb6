#include "client/render/march_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace ridgecast::render {
namespace {

constexpr std::uint32_t kTile = 128;  // samples a side

// What both programs share. The *skyline* is the highest ground by direction, a column for each sample, and by level distance, a row for each cell of
// an eighth of a doubling.
constexpr std::string_view kSkylineCells = R"(
uniform vec2 skylineAhead;                    // level, of length 1: the direction of the sector's middle
uniform float skylineHalf, skylinePerRadian;  // radians: half the sector; columns
float marchHeight(vec2 offset) {
  ivec2 cell;
  vec2 fraction;
  viewLocate(offset, cell, fraction);
  return terrainHeight(cell, fraction, 0.0, viewSeed);
}
float skylineBegin(int cell) { return 4.0 * exp2(float(cell) / 8.0); }  // metres
int skylineCell(float distance) { return int(floor(log2(distance / 4.0) * 8.0)); }
)";
constexpr int kSkylineCellCount = 13 * 8;  // to 32.8 km

constexpr std::string_view kSkyline = R"(
layout(location = 0) out float highest;
void main() {
  float direction = (gl_FragCoord.x - 0.5) / skylinePerRadian - skylineHalf;
  vec2 ray = cos(direction) * skylineAhead + sin(direction) * viewRight.xz;
  int cell = int(gl_FragCoord.y);
  float from = skylineBegin(cell), to = skylineBegin(cell + 1), apart = 0.5 * viewFootprint(from);
  highest = marchHeight(ray * to);
  for (float at = from; at < to; at += apart) highest = max(highest, marchHeight(ray * at));
}
)";

constexpr std::string_view kMarch = R"(
uniform float marchLowest, marchHighest, marchFineness;
uniform sampler2D skyline;
layout(location = 0) out vec4 surface;

float marchGap(vec3 offset) { return viewCameraY + offset.y - marchHeight(offset.xz); }

void main() {
  surface = vec4(0.0);
  vec3 ray = viewRay(gl_FragCoord.xy);
  float sampleWidth = viewFootprint(dot(ray, viewForward));  // for each metre along the ray
  float near = 0.1, far = viewHorizon;
  float air = marchHighest - viewCameraY;  // how far below the highest ground the camera is
  if (air < 0.0) {
    if (ray.y >= 0.0) return;
    near = max(near, air / ray.y);
  } else if (ray.y > 0.0) {
    far = min(far, air / ray.y);
  }
  if (ray.y < 0.0) far = min(far, (marchLowest - viewCameraY) / ray.y);
  if (near >= far) return;

  float level = length(ray.xz);  // for each metre along the ray
  ivec2 last = textureSize(skyline, 0) - 1;
  int column = clamp(int(floor((atan(dot(ray.xz, viewRight.xz), dot(ray.xz, skylineAhead)) + skylineHalf) * skylinePerRadian)), 0, last.x);
  float t = near, above = near;
  // Grazing rays near the ground take the most steps: ln(far / near) / (0.2 / 700) is 40,000 at 720 lines.
  for (int k = 0; k < 1000000; ++k) {
    float widest = far;
    if (level * t >= skylineBegin(0)) {
      int cell = min(skylineCell(level * t), last.y);
      float leaves = min(skylineBegin(cell + 1) / level, far);
      float ground = max(texelFetch(skyline, ivec2(column, cell), 0).r, texelFetch(skyline, ivec2(min(column + 1, last.x), cell), 0).r);
      // Between the places where the skyline was sampled the ground may be a little higher.
      if (viewCameraY + ray.y * (ray.y < 0.0 ? leaves : t) > ground + 2.0 * sampleWidth * t) {
        if (leaves >= far) return;
        above = t = max(leaves, t * 1.000001);
        continue;
      }
      widest = 0.5 * sampleWidth * t;  // no step over what is half a sample wide, however deep the ground before it
    }
    float gap = marchGap(ray * t);
    if (gap <= 0.0) break;
    if (t >= far) return;
    above = t;
    t = min(t + max(max(min(0.1 * gap, widest), 0.2 * sampleWidth * t), 0.005) / marchFineness, far);
  }
  float below = t;
  for (int k = 0; k < 14; ++k) {
    float middle = 0.5 * (above + below);
    if (marchGap(ray * middle) > 0.0) above = middle; else below = middle;
  }
  surface = vec4(ray * (0.5 * (above + below)), 1.0);
}
)";

}  // namespace

MarchPass::MarchPass(Program skyline, Program march, std::uint32_t seed)
    : skyline_(std::move(skyline)),
      program_(std::move(march)),
      vertexArray_(makeVertexArray()),
      skylineFramebuffer_(makeFramebuffer()),
      seed_(seed) {}

Outcome<MarchPass> MarchPass::create(const TerrainText& terrain) {
  auto skyline = buildTerrainProgram("skyline", terrain, std::string(kSkylineCells) + std::string(kSkyline));
  if (!skyline) return skyline.error();
  auto march = buildTerrainProgram("ray march", terrain, std::string(kSkylineCells) + std::string(kMarch));
  if (!march) return march.error();
  return MarchPass(std::move(*skyline), std::move(*march), terrain.seed);
}

void MarchPass::begin(const View& view, const Surface& surface, float fineness) {
  view_ = view;
  fineness_ = fineness;
  framebuffer_ = surface.framebuffer();
  width_ = surface.width();
  height_ = surface.height();
  drawSkyline();
  tile_ = 0;
  tiles_ = ((width_ + kTile - 1) / kTile) * ((height_ + kTile - 1) / kTile);
}

// The directions between the picture's corners, half the circle each way where it sees straight up or down.
MarchPass::Sector MarchPass::sector() const {
  const camera::Pose& pose = view_.camera.pose;
  const camera::Projection& projection = view_.camera.projection;
  const double tangent = std::tan(projection.verticalFov / 2), ahead = std::cos(pose.pitch) - tangent * std::sin(std::abs(pose.pitch));
  const double half = ahead > 0 ? std::atan(tangent * projection.aspect() / ahead) : std::numbers::pi;
  GLint most = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &most);
  const double perRadian = std::min(camera::pixelsPerRadian(projection), (most - 2) / (2 * half));
  return {half, perRadian, static_cast<std::uint32_t>(std::ceil(2 * half * perRadian)) + 2};
}

void MarchPass::setSkyline(const Program& program, const Sector& sector) const {
  program.use();
  setView(program, view_, seed_);
  const camera::Vec3 right = camera::right(view_.camera.pose);
  program.set("skylineAhead", static_cast<float>(right.z), static_cast<float>(-right.x));
  program.set("skylineHalf", static_cast<float>(sector.half));
  program.set("skylinePerRadian", static_cast<float>(sector.perRadian));
}

void MarchPass::drawSkyline() {
  const Sector now = sector();
  if (now.columns != skylineColumns_) {
    skylineTexture_ = makeTexture(GL_R32F, now.columns, kSkylineCellCount);
    skylineColumns_ = now.columns;
    glBindFramebuffer(GL_FRAMEBUFFER, skylineFramebuffer_.name());
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, skylineTexture_.name(), 0);
  }
  drawInto(skylineFramebuffer_.name(), now.columns, kSkylineCellCount);
  setSkyline(skyline_, now);
  drawFullScreen(vertexArray_);
  glFinish();
}

bool MarchPass::advance(std::chrono::milliseconds budget) {
  if (tile_ >= tiles_) return true;
  const auto end = std::chrono::steady_clock::now() + budget;
  drawInto(framebuffer_, width_, height_);
  glEnable(GL_SCISSOR_TEST);
  setSkyline(program_, sector());
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, skylineTexture_.name());
  program_.set("skyline", 0);
  program_.set("marchLowest", static_cast<float>(view_.lowest));
  program_.set("marchHighest", static_cast<float>(view_.highest));
  program_.set("marchFineness", fineness_);
  glBindVertexArray(vertexArray_.name());
  do {
    marchTile(tile_++);
    glFinish();
  } while (tile_ < tiles_ && std::chrono::steady_clock::now() < end);
  glBindVertexArray(0);
  glDisable(GL_SCISSOR_TEST);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  return tile_ >= tiles_;
}

void MarchPass::march(const View& view, const Surface& surface, float fineness) {
  begin(view, surface, fineness);
  while (!advance(std::chrono::hours(1))) {
  }
}

double MarchPass::progress() const { return tiles_ ? static_cast<double>(tile_) / tiles_ : 1.0; }

// From the bottom upwards, which is where the ground is.
void MarchPass::marchTile(std::uint32_t tile) {
  const std::uint32_t columns = (width_ + kTile - 1) / kTile;
  const std::uint32_t x = (tile % columns) * kTile, y = (tile / columns) * kTile;
  glScissor(static_cast<GLint>(x), static_cast<GLint>(y), static_cast<GLsizei>(std::min(kTile, width_ - x)),
            static_cast<GLsizei>(std::min(kTile, height_ - y)));
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

}  // namespace ridgecast::render
