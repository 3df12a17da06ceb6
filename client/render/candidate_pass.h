#pragma once
// Candidates as dots over a picture of the mesh, except where the surface hides them. Needs the context it was made in.

#include <array>
#include <functional>
#include <vector>

#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"
#include "common/wire/messages.h"

namespace ridgecast::render {

// A candidate's colour by its error in pixels, as display values of 0..1.
using CandidateColour = std::function<std::array<float, 3>(float pixels)>;

class CandidatePass {
 public:
  static Outcome<CandidatePass> create();
  // `surface` is the mesh's, `canvas` the picture; both of the view's size. `points` begins with the worst, which are drawn last.
  void draw(const View& view, const Surface& surface, const Canvas& canvas, const std::vector<wire::Candidate>& points,
            const CandidateColour& colour) const;

 private:
  explicit CandidatePass(Program program);
  Program program_;
  GlObject vertexArray_, buffer_;
};

}  // namespace ridgecast::render
