#include "client/render/height_texture.h"

#include <epoxy/gl.h>

#include <cmath>
#include <limits>
#include <vector>

#include "common/outcome/contract.h"

namespace ridgecast::render {
namespace {

constexpr std::int32_t kUnknown = std::numeric_limits<std::int32_t>::min();
constexpr GLint kTexels = static_cast<GLint>(HeightTexture::kTiles) * terrain::kTileSide;

constexpr std::string_view kAccessor = R"(
uniform isampler2D rasterWindow;
uniform ivec2 rasterBaseCell, rasterBaseSteps, rasterBaseParts;  // where the window's first sample lies
uniform ivec2 rasterFirst;                                       // and where it is in the texture, which wraps around
int rasterTexel(ivec2 index, int level) {
  int side = 2048 >> level;
  if (index.x < 0 || index.y < 0 || index.x >= side || index.y >= side) return -2147483647;
  return texelFetch(rasterWindow, ((rasterFirst >> level) + index) & (side - 1), level).x;
}
)";

constexpr std::string_view kDrapeAccessor = R"(
#define RASTER_DRAPED
uniform sampler2D rasterDrape;
vec4 rasterPicture(vec2 index, float footprint) {
  if (min(index.x, index.y) < 0.0 || max(index.x, index.y) >= 2048.0) return vec4(0.0);
  return textureLod(rasterDrape, (vec2(rasterFirst) + index + 0.5) * (1.0 / 2048.0), log2(footprint));
}
)";

}  // namespace

HeightTexture::HeightTexture(const terrain::RasterShape& shape) : shape_(shape), texture_(makeTexture()) {
  glActiveTexture(GL_TEXTURE3);
  glBindTexture(GL_TEXTURE_2D, texture_.name());
  const std::vector<std::int32_t> unknown(std::size_t{kTexels} * kTexels, kUnknown);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  for (int level = 0; level < kLevels; ++level)
    glTexImage2D(GL_TEXTURE_2D, level, GL_R32I, kTexels >> level, kTexels >> level, 0, GL_RED_INTEGER, GL_INT, unknown.data());
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, kLevels - 1);
  if (shape.draped) {
    picture_ = makeTexture();
    glBindTexture(GL_TEXTURE_2D, picture_->name());
    const std::vector<std::uint8_t> none(std::size_t{4} * kTexels * kTexels);
    for (int level = 0; level < kLevels; ++level)
      glTexImage2D(GL_TEXTURE_2D, level, GL_SRGB8_ALPHA8, kTexels >> level, kTexels >> level, 0, GL_RGBA, GL_UNSIGNED_BYTE, none.data());
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_REPEAT);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_REPEAT);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, kLevels - 1);
  }
  glBindTexture(GL_TEXTURE_2D, 0);
  glActiveTexture(GL_TEXTURE0);
}

void HeightTexture::upload(terrain::TileAddress address, const core::HeightWindow::Held* tile) {
  expects(!tile || tile->colours.empty() || tile->colours.size() == terrain::kTileColourBytes,
          "a tile's samples all have colours, or none");
  std::vector<std::int32_t> texels;
  if (tile)
    texels.assign(tile->samples.begin(), tile->samples.end());
  else
    texels.assign(terrain::kTileSamples, kUnknown);
  const auto x = static_cast<GLint>(address.i & (kTiles - 1)) * terrain::kTileSide,
             y = static_cast<GLint>(address.j & (kTiles - 1)) * terrain::kTileSide;
  for (int level = 0; level < kLevels; ++level) {
    const GLint side = terrain::kTileSide >> level;
    glTexSubImage2D(GL_TEXTURE_2D, level, x >> level, y >> level, side, side, GL_RED_INTEGER, GL_INT, texels.data());
    if (!tile) continue;
    const auto n = static_cast<std::size_t>(side), half = n / 2;
    for (std::size_t j = 0; j < half; ++j)
      for (std::size_t i = 0; i < half; ++i) {
        const std::size_t k = 2 * j * n + 2 * i;  // never before what is still to be read
        texels[j * half + i] = (texels[k] + texels[k + 1] + texels[k + n] + texels[k + n + 1]) >> 2;
      }
  }
  if (!picture_) return;
  glBindTexture(GL_TEXTURE_2D, picture_->name());
  uploadColours(tile && !tile->colours.empty() ? tile->colours : std::vector<std::uint8_t>(terrain::kTileColourBytes), x, y);
  glBindTexture(GL_TEXTURE_2D, texture_.name());
}

void HeightTexture::uploadColours(std::vector<std::uint8_t> texels, int x, int y) {
  for (int level = 0; level < kLevels; ++level) {
    const GLint side = terrain::kTileSide >> level;
    glTexSubImage2D(GL_TEXTURE_2D, level, x >> level, y >> level, side, side, GL_RGBA, GL_UNSIGNED_BYTE, texels.data());
    const auto n = static_cast<std::size_t>(side), half = n / 2;
    for (std::size_t k = 0; k < 4 * half * half; ++k) {
      const std::size_t channel = k % 4, i = k / 4 % half, j = k / 4 / half;
      const std::uint8_t* const from = &texels[8 * (j * n + i) + channel];  // never before what is still to be read
      const std::array<float, 4> four{float(from[0]), float(from[4]), float(from[4 * n]), float(from[4 * n + 4])};
      float sum = 0;
      for (const float v : four) sum += channel == 3 ? v : v * v;  // sRGB is nearly the root of light
      texels[k] = static_cast<std::uint8_t>(std::lround(channel == 3 ? sum / 4 : std::sqrt(sum / 4)));
    }
  }
}

bool HeightTexture::update(const core::HeightWindow& window, std::size_t most) {
  if (seen_ == window.version()) return true;
  const terrain::TileAddress centre = window.centre();
  base_ = {centre.i - kTiles / 2, centre.j - kTiles / 2};
  glActiveTexture(GL_TEXTURE3);
  glBindTexture(GL_TEXTURE_2D, texture_.name());
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  std::size_t uploaded = 0;
  bool all = true;
  for (std::int64_t j = 0; j < kTiles; ++j)
    for (std::int64_t i = 0; i < kTiles; ++i) {
      const terrain::TileAddress address{base_.i + i, base_.j + j};
      auto& slot = slots_[static_cast<std::size_t>((address.j & (kTiles - 1)) * kTiles + (address.i & (kTiles - 1)))];
      if (slot == address) continue;
      const core::HeightWindow::Held* tile = window.find(address);
      if (tile && uploaded >= most) {
        all = false;
        tile = nullptr;
      }
      if (!tile && !slot) continue;
      upload(address, tile);
      uploaded += tile ? 1 : 0;
      slot = tile ? std::optional(address) : std::nullopt;
    }
  glBindTexture(GL_TEXTURE_2D, 0);
  glActiveTexture(GL_TEXTURE0);
  if (all) seen_ = window.version();
  ++version_;
  return all;
}

void HeightTexture::bind(const Program& program) const {
  const std::int64_t i = base_.i * terrain::kTileSide, j = base_.j * terrain::kTileSide;
  const lattice::Step x = shape_.x.of(i), z = shape_.z.of(j);
  constexpr lattice::Step kInCell = (lattice::Step{1} << lattice::kCellBits) - 1;
  program.set("rasterBaseCell", lattice::cellOf(x), lattice::cellOf(z));
  program.set("rasterBaseSteps", static_cast<int>(x & kInCell), static_cast<int>(z & kInCell));
  program.set("rasterBaseParts", shape_.x.partsOf(i), shape_.z.partsOf(j));
  program.set("rasterFirst", static_cast<int>(base_.i & (kTiles - 1)) * terrain::kTileSide,
              static_cast<int>(base_.j & (kTiles - 1)) * terrain::kTileSide);
  program.sample("rasterWindow", 3, texture_.name());
  if (picture_) program.sample("rasterDrape", 4, picture_->name());
}

std::string HeightTexture::accessor(bool draped) { return std::string(kAccessor).append(draped ? kDrapeAccessor : ""); }

}  // namespace ridgecast::render
