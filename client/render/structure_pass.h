#pragma once
// The mesh's structure over its picture: edges, squares of leaves, candidates, and what a frozen camera sees. Drawn over a canvas, without
// lines and dots that the surface hides. Needs the context it was made in.

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "client/render/gl_objects.h"
#include "client/render/mesh_pass.h"
#include "client/render/surface.h"
#include "client/render/view.h"
#include "common/wire/messages.h"

namespace ridgecast::render {

struct Structure {
  bool wireframe = false;
  // The colour of a leaf's border and its fill, as display values of 0..1; empty: no borders.
  std::function<std::array<float, 3>(const lattice::LeafAddress&)> leafColour;
  std::optional<camera::Camera> frozen;                            // darkens what this camera does not see
  std::shared_ptr<const std::vector<wire::Candidate>> candidates;  // the worst first, which are drawn last; null: none
  // A candidate's colour by its error in pixels, as display values of 0..1.
  std::function<std::array<float, 3>(float pixels)> candidateColour;
  bool any() const { return wireframe || leafColour || frozen || candidates; }
};

class StructurePass {
 public:
  static Outcome<StructurePass> create();
  // `mesh` is what was drawn last, `surface` its surface, `canvas` the picture; all of the view's size.
  void draw(const View& view, const MeshPass& mesh, const Surface& surface, const Canvas& canvas, const Structure& structure) const;

 private:
  StructurePass(Program edges, Program leaves, Program frustum, Program dots);
  void drawCandidates(const View& view, const Structure& structure) const;
  Program edges_, leaves_, frustum_, dots_;
  GlObject dotArray_, dotBuffer_;
};

}  // namespace ridgecast::render
