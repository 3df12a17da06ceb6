#pragma once
// Blends what two meshes show into one surface, so that a mesh that changes never jumps: through each sample the ground moves along the
// ray from where the first mesh has it to where the second does. New vertices so grow out of the surface that was there, and edges
// that flip, leaves that split and vertices that go need nothing of their own. Where the two see different ground (a silhouette that
// moves, more than a twentieth of the distance apart) or one sees sky, samples change over one by one.
// Needs the context it was made in.

#include "client/render/gl_objects.h"
#include "client/render/surface.h"

namespace ridgecast::render {

class MorphPass {
 public:
  static Outcome<MorphPass> create();
  // `share` of the second surface, 0..1. All three have one size, and carry colours all or none.
  void blend(const Surface& from, const Surface& to, float share, const Surface& out) const;

 private:
  explicit MorphPass(Program program);
  Program program_;
  GlObject vertexArray_;
};

}  // namespace ridgecast::render
