#include "common/edits/edited_terrain.h"

#include <algorithm>

namespace ridgecast::edits {

namespace glsl {
namespace {
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#include "common/terrain/glsl_as_cpp.h"

#include "common/terrain/material_color.glsl"
#pragma GCC diagnostic pop
}  // namespace
}  // namespace glsl

EditedTerrain::EditedTerrain(std::shared_ptr<const terrain::Terrain> base, std::shared_ptr<const Layer> layer)
    : base_(std::move(base)), layer_(std::move(layer)), rise_(layer_) {}

void EditedTerrain::heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const {
  layer_->heights(*base_, x, z, out);
}

void EditedTerrain::materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const {
  base_->materials(x, z, out);
  for (std::size_t k = 0; !layer_->empty() && k < out.size(); ++k)
    if (const std::uint8_t painted = layer_->materialAt({x[k], z[k]}); painted != 0) out[k] = painted;
}

const terrain::RasterShape& Rise::shape() const {
  static const terrain::RasterShape endless{
      .x = {0, terrain::pitchOf(kPostSteps)}, .z = {0, terrain::pitchOf(kPostSteps)}, .lowest = -kMaxRise, .highest = kMaxRise};
  return endless;
}

void Rise::tile(terrain::TileAddress at, terrain::Tile& out) const {
  samples(at.i * terrain::kTileSide, at.j * terrain::kTileSide, terrain::kTileSide, terrain::kTileSide, out.data());
}

void Rise::samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const {
  for (std::int64_t b = z; b < z + rows; ++b)
    for (std::int64_t a = x; a < x + columns; ++a) *out++ = layer_->riseAt(a, b);
}

terrain::Raster::Range Rise::range(std::int64_t x, std::int64_t z, std::int64_t columns, std::int64_t rows) const {
  Range out;
  layer_->forEachTile({x, z, x + columns, z + rows}, [&](TileAddress, const Tile& tile) {
    out = {std::min(out.lowest, tile.lowest()), std::max(out.highest, tile.highest())};
  });
  return out;
}

terrain::Colours EditedTerrain::colours() const {
  auto own = base_->colours();
  if (!own || layer_->empty()) return own;
  return [own = std::move(own), layer = layer_](const lattice::Step* x, const lattice::Step* z, const float* height,
                                                const std::array<float, 3>* normal, float footprint, std::array<float, 3>* out,
                                                std::size_t count, std::uint32_t seed) {
    own(x, z, height, normal, footprint, out, count, seed);
    for (std::size_t k = 0; k < count; ++k)
      if (const std::uint8_t material = layer->materialAt({x[k], z[k]}); material != 0) out[k] = colourOf(material);
  };
}

std::shared_ptr<const Layer> layerOf(const terrain::Terrain& terrain) {
  const auto* edited = dynamic_cast<const EditedTerrain*>(&terrain);
  return edited && !edited->layer()->empty() ? edited->layer() : nullptr;
}

std::array<float, 3> colourOf(std::uint8_t material) {
  const glsl::vec3 c = glsl::materialColor(material);
  return {c.x, c.y, c.z};
}

}  // namespace ridgecast::edits
