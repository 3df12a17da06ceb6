#pragma once
// Draws the mesh held into a surface. Vertices stay integers on the graphics card; the leaf's corner relative to the camera's own step
// is an integer too, so 10^12 m out is as exact as the origin and neighbours cannot crack. Needs the context it was made in.

#include <cstdint>
#include <functional>
#include <map>

#include "client/render/arena.h"
#include "client/render/gl_objects.h"
#include "client/render/surface.h"
#include "client/render/view.h"
#include "client/scene/scene.h"

namespace ridgecast::render {

// Metres in front of the camera at which the mesh is cut off.
inline constexpr double kNear = 0.1;

class MeshPass {
 public:
  // `shaded`: leaves bring shades along, which are lit into the surface's carried colours.
  static Outcome<MeshPass> create(bool shaded = false);
  bool shaded() const { return shaded_; }

  // Copies leaves that are new or whose version grew, forgets those that are gone. Memory follows what the scene holds (doubling).
  void update(const scene::Scene& scene);
  void update(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves);

  struct Drawn {
    std::uint32_t leaves = 0;
    std::uint64_t triangles = 0;
  };
  // Clears the surface and draws what update() left; leaves outside the view are skipped by their bounding boxes.
  // The surface has the view's size.
  Drawn draw(const View& view, const Surface& surface) const;

  // The same triangles once more, into whatever framebuffer is bound, with a program of one's own that is in use and has the vertex shader
  // shaders::mesh_vertex. `each` is called before every leaf.
  struct Leaf {
    lattice::LeafAddress address;
    std::uint64_t triangles = 0;
  };
  void redraw(const View& view, const Program& program, const std::function<void(const Leaf&)>& each) const;

 private:
  struct Slot {
    std::uint64_t version = 0;
    std::size_t firstVertex = 0, vertices = 0, firstIndex = 0, indices = 0;
    mesh::LocalVertex low, high;  // bounding box, as the leaf's vertices
  };
  MeshPass(Program program, bool reversedDepth, bool shaded);
  void bindArrays() const;
  Drawn drawLeaves(const View& view, const Program& program, int leafOffset, const std::function<void(const Leaf&)>& each) const;
  void place(const scene::HeldLeaf& held, Slot& slot);
  void giveBack(const Slot& slot);

  Program program_;
  bool reversedDepth_;  // float depth from 1 at the near plane to 0 at infinity; else logarithmic depth, written by the fragment shader
  bool shaded_;
  int leafOffset_ = -1;
  GlObject vertexArray_, vertexBuffer_, indexBuffer_, shadeBuffer_;  // shades lie where their vertices do
  Arena vertexArena_{0}, indexArena_{0};
  std::size_t shadeCapacity_ = 0;
  std::map<lattice::LeafAddress, Slot> slots_;
};

}  // namespace ridgecast::render
