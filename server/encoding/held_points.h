#pragma once
// The points that a client holds, by square, and the changes that make them those of the server's mesh (common/points).
//
// One owner, one thread. Memory: 12 bytes a point.

#include <cstdint>
#include <map>
#include <span>
#include <unordered_map>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/points/points.h"
#include "common/triangulation/triangulation.h"
#include "server/pipeline/pipeline.h"
#include "server/replica/replica.h"

namespace ridgecast::encoding {

class HeldPoints {
 public:
  // The payload of an iteration, after which the client holds the mesh's points. `changes`: for a client that follows points. `news`
  // becomes the points that the client lacked or had at another height, in the payload's order, and the level of the square of each. Takes
  // the mesh's fresh vertices: only one client's points for each mesh.
  struct News {
    std::vector<lattice::Vertex> points;
    std::vector<int> levels;
  };
  std::vector<std::uint8_t> update(const replica::Changes& changes, pipeline::IteratingMesh& mesh, News& news);

 private:
  using Surface = pipeline::IteratingMesh::Surface;
  struct Point {
    std::int32_t x, z, y;  // in the square's frame
    std::uint64_t place() const { return static_cast<std::uint64_t>(x) << 32 | static_cast<std::uint32_t>(z); }
  };
  using Points = std::vector<Point>;  // ascending by place
  struct Listed {
    std::uint64_t place;  // x and z in the order of points
    std::int32_t y;
    triangulation::VertexId vertex;
    std::int32_t x() const { return static_cast<std::int32_t>(place >> 32); }
    std::int32_t z() const { return static_cast<std::int32_t>(place); }
  };
  using List = std::vector<Listed>;
  // A square whose points change; vertices with another height, and new ones, in the order of the change.
  struct Changed {
    points::Change change;
    std::vector<std::int32_t> before;  // heights of the raised
    std::vector<triangulation::VertexId> raised, inserted;
  };

  static Point inside(lattice::LeafAddress square, const lattice::Vertex& v) {
    return {static_cast<std::int32_t>(v.x - square.x()), static_cast<std::int32_t>(v.z - square.z()), v.y};
  }
  static Listed listed(const Point& p, triangulation::VertexId v) { return {p.place(), p.y, v}; }
  void beginAnew(const replica::Changes& changes, const pipeline::IteratingMesh& mesh);
  void replaceLeaves(const replica::Changes& changes);
  struct Filed {
    lattice::LeafAddress leaf;
    Points* points = nullptr;
  };
  Points& file(const lattice::Vertex& v, Filed& last);
  void compareLeaf(lattice::LeafAddress leaf, pipeline::IteratingMesh& mesh);
  void followLeaf(lattice::LeafAddress leaf, pipeline::IteratingMesh& mesh);
  void list(lattice::LeafAddress leaf, std::span<const triangulation::VertexId> vertices, const Surface& surface);
  void add(lattice::LeafAddress leaf, Points& held);
  void compareOpen(const Surface& surface);
  void compare(lattice::LeafAddress square, Points& held, const List& now);
  std::vector<std::uint8_t> write(const replica::Changes& changes, const pipeline::IteratingMesh& mesh, News& news);

  std::unordered_map<lattice::LeafAddress, Points, lattice::LeafAddressHash> leaves_;  // all that the client holds
  std::map<lattice::LeafAddress, Points> open_;                                        // none is empty
  std::vector<lattice::LeafAddress> squares_;                                          // of the leaves, in canonical order
  std::uint64_t outside_ = 0;                                                          // version of what was compared
  std::vector<lattice::LeafAddress> active_;  // squares that the last payload changed, in canonical order
  std::vector<Changed> changed_;              // of the current payload, leaves first
  std::vector<std::uint32_t> sizes_;          // of their squares before
  List list_;
  std::vector<triangulation::VertexId> vertices_;
};

}  // namespace ridgecast::encoding
