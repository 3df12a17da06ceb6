#pragma once
// The part of a height map that a client holds: square tiles around the camera, requested nearest first and kept a while after the camera
// has moved on. Not thread-safe; one owner. No OpenGL, no sockets.
//
// Bounds: kMaxTilesHeld tiles (32 MiB, and as much for the picture on a draped map), whatever a server sends; at most kMax pending
// requests.

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

class HeightWindow final : public terrain::Terrain, public terrain::Raster {
 public:
  static constexpr std::int64_t kMaxTilesFromCentre = 7;  // the window is at most 15 tiles wide
  static constexpr std::size_t kMaxTilesHeld = 512;
  static constexpr std::size_t kMax = 64;

  // `reach`: metres to hold around the camera; less if the window is full before.
  HeightWindow(std::string name, std::string source, std::uint32_t seed, const terrain::RasterShape& shape, double reach);

  void moveTo(lattice::Point centre);
  // Tiles to request now, nearest first; their requests are pending until they come or forgetRequests().
  std::vector<terrain::TileAddress> take();
  void forgetRequests() { pending_.clear(); }  // the connection is gone
  bool complete() const;                       // everything around the centre is held
  // Error: not a tile, or one that was not requested.
  Outcome<void> put(const wire::HeightTile& tile);

  terrain::TileAddress centre() const { return centre_; }
  struct Held {
    terrain::Tile samples;
    std::vector<std::uint8_t> colours;  // terrain::Raster::tileColours
  };
  const Held* find(terrain::TileAddress address) const;
  std::uint64_t version() const { return version_; }  // grows when the centre or a tile changes
  bool knows(lattice::Point p) const;                 // the height there
  double knownReach() const;                          // metres around the last centre within which every height is known

  std::string_view name() const override { return name_; }
  std::string_view source() const override { return source_; }
  std::uint32_t seed() const override { return seed_; }
  const terrain::Raster* raster() const override { return this; }
  // NaN where nothing is known.
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override;
  const terrain::RasterShape& shape() const override { return shape_; }
  void tile(terrain::TileAddress address, terrain::Tile& out) const override;  // zeros where nothing is known

 private:
  terrain::TileAddress tileOf(lattice::Point p) const;
  std::optional<std::array<std::int32_t, 16>> around(std::int64_t i, std::int64_t j) const;

  std::string name_, source_;
  std::uint32_t seed_;
  terrain::RasterShape shape_;
  std::int64_t tilesFromCentre_;
  lattice::Point at_;
  terrain::TileAddress centre_;
  std::map<terrain::TileAddress, std::unique_ptr<Held>> tiles_;
  std::set<terrain::TileAddress> pending_;
  std::uint64_t version_ = 0;
};

}  // namespace ridgecast::core
