#include "client/render/gpu_terrain.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "client/render/edit_texture.h"
#include "client/render/gl_objects.h"
#include "client/render/height_texture.h"
#include "client/render/surface.h"
#include "common/lattice/lattice.h"

namespace ridgecast::render {
namespace {

constexpr std::uint32_t kPointsSide = 64;
constexpr std::size_t kMax = kPointsSide * kPointsSide;  // points a draw

constexpr std::string_view kHeights = R"(
uniform isampler2D heightPoints;
layout(location = 0) out vec4 height;
void main() {
  ivec4 p = texelFetch(heightPoints, ivec2(gl_FragCoord.xy), 0);
  height = vec4(terrainHeight(p.xy, vec2(p.zw) * (1.0 / 1048576.0), 0.0, viewSeed), 0.0, 0.0, 1.0);
}
)";

class GpuTerrain final : public terrain::Terrain {
 public:
  GpuTerrain(std::string name, const TerrainText& text, const HeightTexture* heights, const EditTexture* edits, Program program)
      : name_(std::move(name)),
        text_(text),
        window_(heights),
        edits_(edits),
        program_(std::move(program)),
        result_(GL_RGBA32F, kPointsSide, kPointsSide),
        points_(makeTexture(GL_RGBA32I, kPointsSide, kPointsSide)) {}
  std::string_view name() const override { return name_; }
  std::string_view source() const override { return text_.source; }
  std::uint32_t seed() const override { return text_.seed; }

  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t begin = 0; begin < out.size(); begin += kMax) {
      const std::size_t n = std::min(kMax, out.size() - begin);
      draw(x.subspan(begin, n), z.subspan(begin, n), out.subspan(begin, n));
    }
  }

 private:
  void draw(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const {
    constexpr lattice::Step kInCell = (lattice::Step{1} << lattice::kCellBits) - 1;
    const auto rows = static_cast<GLsizei>((out.size() + kPointsSide - 1) / kPointsSide);
    std::vector<std::int32_t> texels(static_cast<std::size_t>(rows) * kPointsSide * 4);
    for (std::size_t i = 0; i < out.size(); ++i) {
      texels[4 * i] = lattice::cellOf(x[i]);
      texels[4 * i + 1] = lattice::cellOf(z[i]);
      texels[4 * i + 2] = static_cast<std::int32_t>(x[i] & kInCell);
      texels[4 * i + 3] = static_cast<std::int32_t>(z[i] & kInCell);
    }
    drawInto(result_.framebuffer(), kPointsSide, static_cast<std::uint32_t>(rows));
    program_.use();
    program_.sample("heightPoints", 0, points_.name());
    glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, kPointsSide, rows, GL_RGBA_INTEGER, GL_INT, texels.data());
    program_.set("viewSeed", text_.seed);
    if (window_) window_->bind(program_);
    EditTexture::bind(edits_, program_);
    program_.drawFullScreen();
    std::vector<float> drawn(static_cast<std::size_t>(rows) * kPointsSide);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, kPointsSide, rows, GL_RED, GL_FLOAT, drawn.data());
    std::copy_n(drawn.begin(), out.size(), out.begin());
  }

  std::string name_;
  TerrainText text_;
  const HeightTexture* window_;
  const EditTexture* edits_;
  Program program_;
  Target result_;
  GlObject points_;
};

}  // namespace

Outcome<std::shared_ptr<const terrain::Terrain>> gpuTerrain(std::string name, const TerrainText& text, const HeightTexture* heights,
                                                            const EditTexture* edits) {
  auto program = buildTerrainProgram("heights", text, kHeights);
  if (!program) return program.error();
  return std::shared_ptr<const terrain::Terrain>(std::make_shared<GpuTerrain>(std::move(name), text, heights, edits, std::move(*program)));
}

}  // namespace ridgecast::render
