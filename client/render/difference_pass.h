#pragma once
// How two canvases differ, as a heat map in the window: the distance of their display values from 0 (black) through violet and orange to
// light yellow (a quarter of the full range and more), which colour-blind eyes tell apart. Needs the context it was made in.

#include "client/render/gl_objects.h"
#include "client/render/surface.h"

namespace ridgecast::render {

class DifferencePass {
 public:
  static Outcome<DifferencePass> create();
  // Into framebuffer 0, whole, `width` x `height` pixels; canvases of any size are stretched over it.
  void present(const Canvas& a, const Canvas& b, int width, int height) const;

 private:
  explicit DifferencePass(Program program);
  Program program_;
  GlObject vertexArray_;
};

}  // namespace ridgecast::render
