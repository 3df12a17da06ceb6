#pragma once
// Blends two meshes' surfaces into one, so that a changing mesh never jumps: each sample moves along its ray from the first mesh's ground
// to the second's. So new vertices grow out of the existing surface; flipped edges, split leaves and removed vertices need no special case.
// Where the two see different ground (a moving silhouette, more than a twentieth of the distance apart), or one sees sky, samples switch
// one by one. Needs the context it was made in.

#include "client/render/gl_objects.h"
#include "client/render/surface.h"

namespace ridgecast::render {

class MorphPass {
 public:
  static Outcome<MorphPass> create();
  // `share` of the second surface, 0..1. All three have the same size; all or none carry colours.
  void blend(const Surface& from, const Surface& to, float share, const Surface& out) const;

 private:
  explicit MorphPass(Program program) : program_(std::move(program)) {}
  Program program_;
};

}  // namespace ridgecast::render
