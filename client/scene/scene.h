#pragma once
// The mesh that a client holds: leaves by address, replaced all or nothing by iterations. No OpenGL, no sockets.
// Not thread-safe; one owner.

#include <cstdint>
#include <map>
#include <memory>
#include <optional>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::scene {

// Most that is held, whatever a server sends.
inline constexpr std::uint64_t kMaxTriangles = 8'000'000;
inline constexpr std::size_t kMaxLeaves = 65'536;

struct HeldLeaf {
  std::shared_ptr<const mesh::LeafMesh> mesh;  // never null; may be empty
  mesh::LocalVertex low, high;                 // bounds of its vertices, in their frame; both zero when it is empty
  std::uint64_t hash = 0;                      // mesh::hashLeaf
  std::uint64_t version = 0;                   // of this scene: grows whenever this leaf is replaced
};

class Scene {
 public:
  // Decodes and applies an iteration. Either everything in it is applied, or (error: undecodable payload, a leaf gone that is not
  // held, a leaf named twice, limits, a number that does not follow the last one's) nothing is. The first iteration after the
  // beginning or clear() may have any number. The hash is not judged here: compare hash() with iteration.meshHash.
  Outcome<void> apply(const wire::Iteration& iteration);
  void clear();

  const std::map<lattice::LeafAddress, HeldLeaf>& leaves() const { return leaves_; }
  std::uint64_t hash() const { return hash_; }  // sum of mesh::hashTerm over the leaves held
  std::uint64_t triangles() const { return triangles_; }
  std::uint64_t iteration() const { return iteration_; }  // number of the last one applied, 0 before any

  // Height of the held mesh at a point, in metres; nothing where no held triangle covers it. Looks at the triangles of the few leaves
  // whose bounds hold the point: tens of microseconds.
  std::optional<double> height(lattice::Point at) const;

 private:
  std::map<lattice::LeafAddress, HeldLeaf> leaves_;
  std::uint64_t hash_ = 0, triangles_ = 0, iteration_ = 0, version_ = 0;
};

}  // namespace ridgecast::scene
