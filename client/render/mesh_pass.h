#pragma once
// Draws the held mesh into a surface. Vertices stay integers on the graphics card, and the leaf's corner relative to the camera's step is
// an integer too: 10^12 m out is as exact as the origin, and neighbours cannot crack. Needs the context it was made in.

#include <cstdint>
#include <functional>
#include <map>

#include "client/core/mesh/scene.h"
#include "client/render/arena.h"
#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"

namespace ridgecast::render {

// Metres in front of the camera at which the mesh is clipped.
inline constexpr double kNear = 0.1;

class MeshPass {
 public:
  // `shaded`: leaves carry shades, which are lit into the surface's carried colours.
  static Outcome<MeshPass> create(bool shaded = false);
  bool shaded() const { return shaded_; }

  // Copies leaves that are new or have a newer version, and drops those that are gone. Memory follows what the scene holds (doubling).
  void update(const core::Leaves& leaves);

  // Clears the surface and draws the leaves of the last update(), except those whose bounding box is out of view. The surface has the
  // view's size.
  void draw(const View& view, const Surface& surface) const;

  // Draws the same triangles again into the bound framebuffer, with the caller's program, which is in use and has the vertex shader
  // shaders::mesh_vertex. `each`, if any, is called before every leaf.
  struct Leaf {
    lattice::LeafAddress address;
    std::uint64_t triangles = 0;
  };
  void redraw(const View& view, const Program& program, const std::function<void(const Leaf&)>& each) const;

 private:
  struct Slot {
    std::uint64_t version = 0;
    std::size_t firstVertex = 0, vertices = 0, firstIndex = 0, indices = 0;
    mesh::LocalVertex low, high;  // bounding box, like the leaf's vertices
  };
  MeshPass(Program program, bool reversedDepth, bool shaded);
  void bindArrays() const;
  void place(const core::HeldLeaf& held, Slot& slot);
  void giveBack(const Slot& slot);

  Program program_;
  // float depth from 1 at the near plane to 0 at infinity; otherwise logarithmic depth, written by the fragment shader
  bool reversedDepth_;
  bool shaded_;
  GlObject vertexArray_, vertexBuffer_, indexBuffer_, shadeBuffer_;  // shades lie where their vertices do
  Arena vertexArena_{0}, indexArena_{0};
  std::size_t shadeCapacity_ = 0;
  std::map<lattice::LeafAddress, Slot> slots_;
};

}  // namespace ridgecast::render
