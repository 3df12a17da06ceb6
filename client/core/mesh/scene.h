#pragma once
// The mesh that a client holds: leaves by address, replaced all or nothing by iterations. No OpenGL, no sockets.
//
// Leaves changed by points have hash, bounds and count at once; their triangles are made when read. Robots and simulations, which read the
// few leaves around them, do not pay for the others.
//
// Not thread-safe; one owner: reading makes leaves, too.

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "client/core/mesh/point_mesh.h"
#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/outcome.h"
#include "common/terrain/shades.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

// Upper limits, whatever a server sends.
inline constexpr std::uint64_t kMaxTriangles = 8'000'000;
inline constexpr std::size_t kMaxLeaves = 65'536;

struct HeldLeaf {
  std::shared_ptr<const mesh::LeafMesh> mesh;  // may be empty; in any order. Null: not made yet
  mesh::LocalVertex low, high;                 // hold its vertices, in their frame; tight once it is made; zero when it is empty
  std::uint32_t triangles = 0;                 // how many there are
  std::uint64_t hash = 0;                      // mesh::hashLeaf
  std::uint64_t version = 0;                   // of this scene: grows whenever this leaf is replaced
  std::shared_ptr<const std::vector<terrain::Shade>> shades;  // of its vertices, where the world's travel with them; else null
  float error = 0;                                            // metres: the true terrain is at most this far above or below; 0: not known
};

using Leaves = std::map<lattice::LeafAddress, HeldLeaf>;

class Scene {
 public:
  // What travels besides leaves: points (Hello.points), and shades with the vertices (World.shaded_vertices); the triangles granted. Call
  // before the first iteration. `spread` does work(k) for every k < `count`, in any order or at once; `bytes` is the amount of work.
  using Spread = void (*)(std::size_t count, std::size_t bytes, const std::function<void(std::size_t)>& work);
  static void inOrder(std::size_t count, std::size_t bytes, const std::function<void(std::size_t)>& work);
  struct Following {
    bool points = false, shades = false;
    std::uint32_t triangles = 0;
    Spread spread = inOrder;
  };
  void follow(const Following& what);

  // Decodes and applies an iteration, or nothing on an error. Errors: undecodable payload, a leaf gone that is not held, a leaf named
  // twice, limits, a number out of sequence, shades that do not match its vertices. The first iteration after the beginning, clear() or
  // reconnect() may have any number. Does not check the hash: compare hash() with iteration.meshHash.
  Outcome<void> apply(const wire::Iteration& iteration);

  // The same in two steps, for windows, which draw all leaves. prepare() decodes and makes leaves. It may run on another thread while
  // leaves made before are read: call leaves() first. take() installs the result, in microseconds; nothing else may have been prepared or
  // changed in between.
  struct Prepared {
    std::uint64_t number = 0, hash = 0, triangles = 0;  // of the iteration; after it
    std::set<lattice::LeafAddress> gone;
    Leaves fresh;
    std::vector<PointMesh::Changed> changed;
    std::uint64_t came = 0;  // triangles
    bool lost = false;
  };
  Outcome<Prepared> prepare(const wire::Iteration& iteration);
  void take(Prepared&& prepared);
  void clear();

  // For drawing without indices: the leaves that points may have changed in the last iteration, and what to draw of these
  // (PointMesh::draw()). None if points were lost: what is drawn stays.
  const std::vector<PointMesh::Changed>& changed() const { return changed_; }
  void draw(PointMesh::Drawing& to) const;
  std::uint64_t came() const { return came_; }  // triangles of the last iteration's leaves, and those by which others grew

  // Received points do not fit those held: leaves made by points stay as last made, or are empty, until all come whole.
  bool lost() const { return lost_; }

  // The connection was lost, and what is held stays: the next iteration is the first of a new connection. `unnamed`: the server is told
  // only the hash of what is held, so that iteration says nothing of its leaves: all of them go before it is applied, unless it has that
  // hash and brings none.
  void reconnect(bool unnamed) {
    iteration_ = 0;
    unnamed_ = unnamed;
  }
  bool dropsAllFor(const wire::Iteration& iteration) const {
    return unnamed_ && (iteration.meshHash != hash_ || !iteration.come.empty() || !iteration.whole.empty());
  }
  // The leaves held, to be named to a server; empty if too many for it.
  std::vector<wire::HeldLeaf> held() const;

  // All leaves, all made: 17 microseconds for each that changed since the last read.
  const Leaves& leaves() const;
  // One of them, made; null: it is not held. Valid until the leaf is replaced.
  const HeldLeaf* leaf(const lattice::LeafAddress& address) const;
  // Those that the last iteration took away, whether or not it brought them back.
  const std::set<lattice::LeafAddress>& gone() const { return gone_; }
  // All leaves as they are, made or not.
  const Leaves& index() const { return leaves_; }
  std::uint64_t hash() const { return hash_; }  // sum of mesh::hashTerm over the leaves held
  std::uint64_t triangles() const { return triangles_; }
  std::uint64_t iteration() const { return iteration_; }  // number of the last one applied, 0 before any

  // The held triangle over or below a point; empty if there is none. Makes and searches the few leaves whose bounds hold the point: tens
  // of microseconds. Valid until the leaf is replaced.
  struct Place {
    const HeldLeaf* leaf;
    std::array<mesh::LocalVertex, 3> corners;  // in the leaf's frame, counter-clockwise
    double height;                             // metres, at the point
  };
  std::optional<Place> locate(lattice::Point at) const;
  std::optional<double> height(lattice::Point at) const;  // metres

 private:
  Outcome<Prepared> decode(const wire::Iteration& iteration);
  void make(HeldLeaf& leaf, const lattice::LeafAddress& address) const;

  mutable Leaves leaves_;
  mutable bool made_ = true;  // all leaves
  std::uint64_t hash_ = 0, triangles_ = 0, iteration_ = 0, version_ = 0;
  Following following_;
  bool lost_ = false, unnamed_ = false;
  std::set<lattice::LeafAddress> gone_;
  std::vector<PointMesh::Changed> changed_;
  std::uint64_t came_ = 0;
  std::unique_ptr<PointMesh> points_;  // made for the first iteration, where points are followed
};

}  // namespace ridgecast::core
