#pragma once
// What a rendering sees through each sample: the terrain's position relative to the camera in metres (x, y, z), and whether there is any
// (w: 1 terrain, 0 sky). Both renderings write surfaces and one pass shades both: equal positions get equal colours.

#include <cstdint>
#include <optional>
#include <utility>

#include "client/render/gl_objects.h"
#include "common/outcome/outcome.h"

namespace ridgecast::render {

// A texture to draw into.
class Target {
 public:
  // Leaves its framebuffer bound. `format` is OpenGL's (makeTexture).
  Target(std::uint32_t format, std::uint32_t width, std::uint32_t height);
  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }
  std::uint32_t texture() const { return texture_.name(); }
  std::uint32_t framebuffer() const { return framebuffer_.name(); }

 protected:
  // One more texture of the bound framebuffer.
  GlObject attach(std::uint32_t attachment, std::uint32_t format) const;

 private:
  std::uint32_t width_, height_;
  GlObject framebuffer_, texture_;
};

inline void drawInto(const Target& target) { drawInto(target.framebuffer(), target.width(), target.height()); }

class Surface : public Target {
 public:
  // Error: the driver refuses a picture of this size. With `carried`, also holds the colours of vertices: linear light (r, g, b), written
  // only by the mesh pass.
  static Outcome<Surface> create(std::uint32_t width, std::uint32_t height, bool carried = false);
  std::uint32_t carried() const { return carried_.name(); }  // texture; 0: none

 private:
  using Target::Target;
  GlObject carried_, depth_;
};

// Colours as 8-bit display values; alpha is 1 where terrain shows.
class Canvas : public Target {
 public:
  static Outcome<Canvas> create(std::uint32_t width, std::uint32_t height);

 private:
  using Target::Target;
};

// Makes `target` a surface or canvas of this size, unless it is one.
template <class Kind, class... More>
Outcome<void> fit(std::optional<Kind>& target, std::uint32_t width, std::uint32_t height, More... more) {
  if (target && target->width() == width && target->height() == height) return {};
  target.reset();
  auto made = Kind::create(width, height, more...);
  if (!made) return made.error();
  target.emplace(std::move(*made));
  return {};
}

}  // namespace ridgecast::render
