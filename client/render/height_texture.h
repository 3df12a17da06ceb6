#pragma once
// The window of a height map (scene::HeightWindow) as a texture: 2,048 x 2,048 samples that wrap around, so that only what is new is
// uploaded when the camera moves, and a pyramid of eight levels for shading from afar. 22 MiB on the graphics card.
// Needs the context it was made in.

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "client/render/gl_objects.h"
#include "client/scene/height_window.h"

namespace ridgecast::render {

class HeightTexture {
 public:
  static constexpr std::int64_t kTiles = 16;  // a side
  static constexpr int kLevels = 8;           // the coarsest has one texel a tile

  explicit HeightTexture(const terrain::RasterShape& shape);
  // Uploads what the window has and the texture has not, at most `most` tiles. Whether everything is there now.
  bool update(const scene::HeightWindow& window, std::size_t most = 64);
  std::uint64_t version() const { return version_; }  // grows with every change

  // Sets the uniforms of accessor() and binds the texture to unit 3; the program must be in use.
  void bind(const Program& program) const;
  // GLSL that raster.glsl wants before it.
  static std::string_view accessor();

 private:
  void upload(terrain::TileAddress address, const terrain::Tile* tile);  // null: unknown
  terrain::RasterShape shape_;
  terrain::TileAddress base_;
  GlObject texture_;
  std::array<std::optional<terrain::TileAddress>, kTiles * kTiles> slots_;
  std::uint64_t seen_ = ~std::uint64_t{0}, version_ = 0;
};

}  // namespace ridgecast::render
