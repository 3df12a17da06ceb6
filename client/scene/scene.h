#pragma once
// The mesh that a client holds: leaves by address, replaced all or nothing by iterations. No OpenGL, no sockets.
// Not thread-safe; one owner.

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/outcome.h"
#include "common/terrain/shades.h"
#include "common/wire/messages.h"

namespace ridgecast::scene {

// Most that is held, whatever a server sends.
inline constexpr std::uint64_t kMaxTriangles = 8'000'000;
inline constexpr std::size_t kMaxLeaves = 65'536;
// Triangles of leaves that are gone, each as often as one iteration starts a leaf from them.
inline constexpr std::uint64_t kMaxGathered = 4 * kMaxTriangles;

struct HeldLeaf {
  std::shared_ptr<const mesh::LeafMesh> mesh;                 // never null; may be empty
  mesh::LocalVertex low, high;                                // bounds of its vertices, in their frame; both zero when it is empty
  std::uint64_t hash = 0;                                     // mesh::hashLeaf
  std::uint64_t version = 0;                                  // of this scene: grows whenever this leaf is replaced
  std::shared_ptr<const std::vector<terrain::Shade>> shades;  // of its vertices, where the world's travel with them; else null
  float error = 0;                                            // metres: the true terrain is at most so far above or below; 0: not known
};

using Leaves = std::map<lattice::LeafAddress, HeldLeaf>;

class Scene {
 public:
  // Decodes and applies an iteration: everything in it, or on an error nothing. Errors: undecodable payload, a leaf gone that is not held,
  // a leaf named twice, limits, a number that does not follow the last one's, shades that are not those of its vertices. The first
  // iteration after the beginning, clear() or reconnect() may have any number. The hash is not judged here: compare hash() with
  // iteration.meshHash.
  //
  // One thing is forgiven: a delta that does not make the intended leaf, because that leaf was damaged here. It stays as it is, and
  // takeDamaged() names it, to be requested again.
  Outcome<void> apply(const wire::Iteration& iteration);

  // The same in two steps. prepare() decodes, if there is much on up to four threads, and may run on another thread while this scene is
  // only read. take() puts the result in place, in microseconds; nothing else may have changed the scene in between.
  struct Prepared {
    std::uint64_t number = 0, hash = 0, triangles = 0;  // of the iteration; after it
    std::set<lattice::LeafAddress> gone, damaged;
    Leaves fresh;
  };
  Outcome<Prepared> prepare(const wire::Iteration& iteration) const;
  void take(Prepared&& prepared);
  void clear();

  // From the first iteration on: whether shades travel with the vertices (World.shaded_vertices).
  void expectShades(bool expect) { shaded_ = expect; }

  // Leaves that are not what the server thinks, each told once; the server must hear of them (ResendLeaves) before it hears the hash.
  std::vector<lattice::LeafAddress> takeDamaged();
  bool damaged() const { return !damaged_.empty(); }

  // The connection was lost, and what is held stays: the next iteration is the first of another one. The server hears by held() what is
  // damaged.
  void reconnect();
  // What is held, to be named to a server; empty when it is more than a server takes.
  std::vector<wire::HeldLeaf> held() const;

  const Leaves& leaves() const { return leaves_; }
  std::uint64_t hash() const { return hash_; }  // sum of mesh::hashTerm over the leaves held
  std::uint64_t triangles() const { return triangles_; }
  std::uint64_t iteration() const { return iteration_; }  // number of the last one applied, 0 before any

  // The held triangle over or below a point; empty if there is none. Searches the triangles of the few leaves whose bounds hold the point:
  // tens of microseconds. Valid until the leaf is replaced.
  struct Place {
    const HeldLeaf* leaf;
    std::array<mesh::LocalVertex, 3> corners;  // in the leaf's frame, counter-clockwise
    double height;                             // metres, at the point
  };
  std::optional<Place> locate(lattice::Point at) const;
  std::optional<double> height(lattice::Point at) const;  // metres

 private:
  Leaves leaves_;
  std::uint64_t hash_ = 0, triangles_ = 0, iteration_ = 0, version_ = 0;
  std::set<lattice::LeafAddress> damaged_, untold_;
  bool shaded_ = false;
};

}  // namespace ridgecast::scene
