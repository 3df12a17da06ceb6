#pragma once
// Colours a surface: terrain by its own functions at the surface's positions, filtered by the sample's footprint; sky elsewhere and beyond
// the horizon. Mesh and ray march share this pass. Needs the context it was made in.

#include <cstdint>

#include "client/render/gl_objects.h"
#include "client/render/picture.h"
#include "client/render/surface.h"
#include "client/render/view.h"

namespace ridgecast::render {

class ShadePass {
 public:
  static Outcome<ShadePass> create(const TerrainText& terrain);

  // Surface and canvas have the view's size.
  void shade(const View& view, const Surface& surface, const Canvas& canvas) const;

 private:
  ShadePass(Program program, std::uint32_t seed) : program_(std::move(program)), seed_(seed) {}
  Program program_;
  std::uint32_t seed_;
};

// Reads a canvas back; waits until drawing is complete.
Picture readBack(const Canvas& canvas);

// Copies a canvas, stretched, into a rectangle of the window (framebuffer 0), in pixels from the bottom left.
struct Rectangle {
  int x = 0, y = 0, width = 0, height = 0;
};
void present(const Canvas& canvas, const Rectangle& target, const Rectangle& clip);

}  // namespace ridgecast::render
