#pragma once
// Candidates as dots over a picture of the mesh, where the surface does not hide them. Needs the context it was made in.

#include <array>
#include <functional>
#include <vector>

#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"
#include "common/wire/messages.h"

namespace ridgecast::render {

// The colour of a candidate by its error in pixels, as a display value of 0..1.
using CandidateColour = std::function<std::array<float, 3>(float pixels)>;

class CandidatePass {
 public:
  static Outcome<CandidatePass> create();
  // `surface` is where the mesh is, `canvas` the picture; both of the view's size. The worst of `points` come first, and are drawn last.
  void draw(const View& view, const Surface& surface, const Canvas& canvas, const std::vector<wire::Candidate>& points,
            const CandidateColour& colour) const;

 private:
  explicit CandidatePass(Program program);
  Program program_;
  GlObject vertexArray_, buffer_;
};

}  // namespace ridgecast::render
