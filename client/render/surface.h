#pragma once
// What a rendering sees through each sample: the terrain's position relative to the camera in metres (x, y, z), and whether there is any
// (w: 1 terrain, 0 sky). Both renderings write surfaces and one pass shades both: equal positions get equal colours.

#include <cstdint>

#include "client/render/gl_objects.h"
#include "common/outcome/outcome.h"

namespace ridgecast::render {

class Surface {
 public:
  // Error: the driver refuses a picture of this size. With `carried`, also holds the colours of vertices: linear light (r, g, b), written
  // only by the mesh pass.
  static Outcome<Surface> create(std::uint32_t width, std::uint32_t height, bool carried = false);
  std::uint32_t carried() const { return carried_.name(); }  // texture; 0: none
  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }
  std::uint32_t texture() const { return positions_.name(); }
  std::uint32_t framebuffer() const { return framebuffer_.name(); }

 private:
  std::uint32_t width_ = 0, height_ = 0;
  GlObject positions_, carried_, depth_, framebuffer_;
};

// Colours as 8-bit display values; alpha is 1 where terrain shows.
class Canvas {
 public:
  static Outcome<Canvas> create(std::uint32_t width, std::uint32_t height);
  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }
  std::uint32_t texture() const { return colours_.name(); }
  std::uint32_t framebuffer() const { return framebuffer_.name(); }

 private:
  std::uint32_t width_ = 0, height_ = 0;
  GlObject colours_, framebuffer_;
};

}  // namespace ridgecast::render
