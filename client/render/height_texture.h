#pragma once
// The window of a height map (core::HeightWindow) as a texture: 2,048 x 2,048 samples that wrap around, so that a moving camera uploads
// only what is new, and a pyramid of eight levels for distant shading. 22 MiB on the graphics card, and as much for a picture on the map.
// Needs the context it was made in.

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "client/core/ground/height_window.h"
#include "client/render/gl_objects.h"

namespace ridgecast::render {

class HeightTexture {
 public:
  static constexpr std::int64_t kTiles = 16;  // a side
  static constexpr int kLevels = 8;           // the coarsest has one texel a tile

  explicit HeightTexture(const terrain::RasterShape& shape);
  // Uploads at most `most` tiles that the texture lacks. Returns whether it now has everything.
  bool update(const core::HeightWindow& window, std::size_t most = 64);
  std::uint64_t version() const { return version_; }  // grows with every change

  // Sets the uniforms of accessor() and binds the textures to units 3 and 4; the program must be in use.
  void bind(const Program& program) const;
  // GLSL that must precede raster.glsl.
  static std::string accessor(bool draped);

 private:
  void upload(terrain::TileAddress address, const core::HeightWindow::Held* tile);  // null: unknown
  void uploadColours(std::vector<std::uint8_t> texels, int x, int y);
  terrain::RasterShape shape_;
  terrain::TileAddress base_;
  GlObject texture_;
  std::optional<GlObject> picture_;
  std::array<std::optional<terrain::TileAddress>, kTiles * kTiles> slots_;
  std::uint64_t seen_ = ~std::uint64_t{0}, version_ = 0;
};

}  // namespace ridgecast::render
