#pragma once
// A terrain with a layer of edits on it: its heights plus the layer's rises. Rises between posts are bicubic like height maps
// (terrain::cubicHeights) and are added to the terrain's height in one float operation, so all machines agree to the bit. Where nothing was
// edited, heights and colours are the terrain's own.

#include <memory>

#include "common/edits/layer.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"

namespace ridgecast::edits {

// A layer's rises as a height map's posts.
class Rise final : public terrain::Raster {
 public:
  explicit Rise(std::shared_ptr<const Layer> layer) : layer_(std::move(layer)) {}
  const terrain::RasterShape& shape() const override;
  void tile(terrain::TileAddress address, terrain::Tile& out) const override;
  void samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const override;
  Range range(std::int64_t x, std::int64_t z, std::int64_t columns, std::int64_t rows) const override;

 private:
  std::shared_ptr<const Layer> layer_;
};

class EditedTerrain final : public terrain::Terrain {
 public:
  EditedTerrain(std::shared_ptr<const terrain::Terrain> base, std::shared_ptr<const Layer> layer);

  const std::shared_ptr<const terrain::Terrain>& base() const { return base_; }
  const std::shared_ptr<const Layer>& layer() const { return layer_; }

  std::string_view name() const override { return base_->name(); }
  std::string_view source() const override { return base_->source(); }
  std::uint32_t seed() const override { return base_->seed(); }
  const terrain::Raster* raster() const override { return base_->raster(); }
  const terrain::Raster* edits() const override { return layer_->empty() ? nullptr : &rise_; }
  terrain::Relief relief() const override { return base_->edits() ? terrain::Relief() : base_->relief(); }  // one layer's rises are known
  const terrain::Terrain& unedited() const override { return base_->unedited(); }
  std::span<const std::string> ownMaterials() const override { return base_->ownMaterials(); }
  terrain::Colours colours() const override;  // posts with a material have its colour
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override;
  // As the posts are painted; elsewhere the terrain's.
  void materials(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<std::uint8_t> out) const override;

 private:
  std::shared_ptr<const terrain::Terrain> base_;
  std::shared_ptr<const Layer> layer_;
  Rise rise_;
};

// The layer on a terrain; null: unedited.
std::shared_ptr<const Layer> layerOf(const terrain::Terrain& terrain);

// Linear red, green and blue of materials 1 to kMaterials.
std::array<float, 3> colourOf(std::uint8_t material);

}  // namespace ridgecast::edits
