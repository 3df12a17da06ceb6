#pragma once
// A terrain with a layer of edits on it: the heights of the one plus what the other raises them by. Height between posts is bicubic as that
// of height maps (terrain::cubicHeight) and added to the terrain's in one float operation, so all machines agree to the bit. Where nobody
// edited, heights and colours are the terrain's own.

#include <memory>

#include "common/edits/layer.h"
#include "common/terrain/terrain.h"

namespace ridgecast::edits {

class EditedTerrain final : public terrain::Terrain {
 public:
  EditedTerrain(std::shared_ptr<const terrain::Terrain> base, std::shared_ptr<const Layer> layer);

  const std::shared_ptr<const terrain::Terrain>& base() const { return base_; }
  const std::shared_ptr<const Layer>& layer() const { return layer_; }

  std::string_view name() const override { return base_->name(); }
  std::string_view source() const override { return base_->source(); }
  std::uint32_t seed() const override { return base_->seed(); }
  const terrain::Raster* raster() const override { return base_->raster(); }
  terrain::Colours colours() const override;  // posts with a material have its colour
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override;

 private:
  std::shared_ptr<const terrain::Terrain> base_;
  std::shared_ptr<const Layer> layer_;
};

// Linear red, green and blue of materials 1 to kMaterials: earth, rock, gravel, sand, grass, asphalt, concrete, snow.
std::array<float, 3> colourOf(std::uint8_t material);

}  // namespace ridgecast::edits
