#pragma once
// What the picture is made of, over a picture of the mesh: its edges, the squares of its leaves, candidates for its vertices, and what a frozen
// camera sees.
// Drawn over a canvas where the surface below it shows: hidden lines are left out. Needs the context it was made in.

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "client/render/candidate_pass.h"
#include "client/render/gl_objects.h"
#include "client/render/mesh_pass.h"
#include "client/render/surface.h"
#include "client/render/view.h"

namespace ridgecast::render {

struct Structure {
  bool wireframe = false;
  // The colour of a leaf's border and of what fills it, as a display value of 0..1; none: no borders.
  std::function<std::array<float, 3>(const lattice::LeafAddress&)> leafColour;
  std::optional<camera::Camera> frozen;                            // what this camera does not see is darkened
  std::shared_ptr<const std::vector<wire::Candidate>> candidates;  // null: none
  CandidateColour candidateColour;                                 // where there are some
  bool any() const { return wireframe || leafColour || frozen || candidates; }
};

class StructurePass {
 public:
  static Outcome<StructurePass> create();
  // `mesh` is what was drawn last, `surface` where that is, `canvas` the picture; all of the view's size.
  void draw(const View& view, const MeshPass& mesh, const Surface& surface, const Canvas& canvas, const Structure& structure) const;

 private:
  StructurePass(Program edges, Program leaves, Program frustum, CandidatePass candidates);
  Program edges_, leaves_, frustum_;
  CandidatePass candidates_;
  GlObject vertexArray_;
};

}  // namespace ridgecast::render
