#pragma once
// A client's triangulation. It follows the points that a server sends (common/points): each insertion and removal there is repeated here,
// so the triangles are the same. Knows no messages, sockets or threads.
//
// Not thread-safe; one owner. Memory: about 100 bytes a triangle.

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/extraction.h"
#include "common/mesh/leaf_mesh.h"
#include "common/points/points.h"
#include "common/terrain/shade.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::core {

class PointMesh final : public triangulation::Partition {
 public:
  // `shaded`: shades travel with vertices. `triangles`: initial room; it grows on demand.
  explicit PointMesh(bool shaded, std::uint32_t triangles = 0);

  // An iteration's points. Leaves in any order.
  struct Step {
    std::span<const lattice::LeafAddress> gone, come;
    std::span<const std::uint8_t> payload;
    std::span<const std::uint8_t> shades;  // of points raised and inserted, where shades travel with vertices; else empty
  };
  struct Leaf {
    mesh::LeafMesh mesh;                 // in any order
    std::vector<terrain::Shade> shades;  // of its vertices, where they travel with them
  };

  // Takes the corners of these leaves' triangles as points. False: they contradict each other, reach too far or are too many; what is held
  // must then be cleared.
  struct Held {
    const mesh::LeafMesh* mesh;
    const std::vector<terrain::Shade>* shades;  // may be null
  };
  bool begin(std::span<const Held> leaves);
  // False: the step does not fit what is held, which must then be cleared.
  bool follow(const Step& step);
  // The leaves, in canonical order, whose triangles may have changed since the last call.
  struct Changed {
    lattice::LeafAddress leaf;
    std::uint64_t hash = 0;           // mesh::hashLeaf
    std::uint32_t triangles = 0;      // how many there are
    mesh::LocalVertex low{}, high{};  // bound its vertices, maybe loosely; both zero when it is empty
  };
  std::vector<Changed> takeChanged();
  // As it is now; costs more than following does.
  Leaf extract(lattice::LeafAddress leaf);
  // For drawing without indices. Triangles lie in numbered slots: block n has those from n x kBlock on, and belongs to one leaf. A copy of
  // all slots, updated from this, draws the leaves, and little of it changes in an iteration.
  static constexpr std::uint32_t kBlock = triangulation::TrianglePages::kBlock;
  struct Drawing {
    std::vector<std::uint32_t> ends, blocks;  // of each leaf, where its blocks end in `blocks`; the numbers of all its blocks now
    std::vector<std::uint32_t> changed;       // slots in these that are not as they were told last, block by block
    std::vector<mesh::LocalVertex> corners;   // three for each of them, of the leaf's frame; all 0 without a triangle
  };
  // For leaves that takeChanged() returned.
  void draw(std::span<const Changed> leaves, Drawing& to);
  void clear();

  triangulation::RegionId regionAt(triangulation::Point2 p) const override;

 private:
  using VertexId = triangulation::VertexId;
  using RegionId = triangulation::RegionId;
  static constexpr std::uint32_t kMinTriangles = 1 << 16, kMaxTriangles = 8'000'000;  // made room for at first
  static constexpr lattice::Step kReach = lattice::Step{1} << 26;                     // of vertices from the anchor

  // A square's change, by vertex.
  struct Resolved {
    std::vector<VertexId> removed, raised, inserted;
  };

  lattice::Point absolute(triangulation::Point2 p) const { return {anchor_.x + p.x, anchor_.z + p.z}; }
  static constexpr VertexId kNoVertex = triangulation::kInfinite;

  template <class F>
  void forEachVertex(F&& f) const {
    for (RegionId region = 0; region < mesh_->regionLimit(); ++region)
      if (mesh_->vertexPages().hasRegion(region))
        mesh_->vertexPages().forEach(region, [&](VertexId v) {
          if (v != triangulation::kInfinite) f(v);
        });
  }
  struct Effort {
    std::size_t spent = 0, most = 0;
    bool spend(std::size_t steps) { return (spent += steps) <= most; }
  };
  struct Levels {
    int likely = 0;      // of the leaf that was asked for last
    unsigned there = 0;  // of leaves that there may be, a bit each
  };
  triangulation::Moves moves();
  void make(std::uint32_t triangles);
  void empty();
  void reserve(std::size_t points);
  void addRegion(lattice::LeafAddress leaf);
  bool centre();
  bool startOver();
  bool replaceLeaves(const Step& step);
  std::uint32_t count(lattice::LeafAddress square);
  const std::vector<VertexId>& openPoints(lattice::LeafAddress square);
  const std::vector<VertexId>& list(lattice::LeafAddress square);
  bool start(std::span<const triangulation::Vertex> vertices);
  VertexId insert(const triangulation::Vertex& v, triangulation::TriangleId& hint);
  void prefetch(std::span<const points::Change> changes) const;
  void findHints(std::span<const points::Change> changes);
  VertexId hintFor(RegionId region, triangulation::Point2 p) const;
  bool change(std::span<const points::Change> changes, std::vector<Resolved>& resolved);
  bool readHeights(std::span<const points::Change> changes, std::span<const Resolved> resolved, points::Reader& reader,
                   std::span<const std::uint8_t> shades);
  bool setHeight(VertexId v, std::int32_t y);
  void allow(std::size_t changes);
  bool isCheap(VertexId v);
  // Bounds of the vertices of a region's triangles, maybe loose. Relative to the anchor.
  struct Bounds {
    mesh::LocalVertex low{kFar, kFar, kFar}, high{-kFar, -kFar, -kFar};
    static constexpr std::int32_t kFar = std::int32_t{1} << 30;
    bool empty() const { return low.x > high.x; }
    void add(const mesh::LocalVertex& a, const mesh::LocalVertex& b);
  };
  void addToBounds(RegionId region, triangulation::TriangleId t);
  Changed look(RegionId region);
  std::uint64_t termOf(triangulation::TriangleId t) const;
  std::uint64_t hashOf(RegionId region);
  void drawBlock(std::uint32_t block, std::uint32_t alive, lattice::LeafAddress leaf, Drawing& to);
  void setTerm(triangulation::TriangleId t, std::uint64_t term);

  std::unique_ptr<triangulation::Triangulation> mesh_;
  std::uint32_t capacity_ = 0;  // triangles
  lattice::Point anchor_;
  std::unordered_map<lattice::LeafAddress, RegionId, lattice::LeafAddressHash> regions_;
  std::vector<lattice::LeafAddress> leaves_;  // by region
  std::vector<Bounds> bounds_;                // by region; grow with fresh triangles, shrink when a leaf is extracted
  std::vector<lattice::LeafAddress> held_;    // the leaves, in canonical order
  std::vector<lattice::LeafAddress> active_;  // squares that the last payload changed, in canonical order
  std::vector<terrain::Shade> shades_;        // by vertex
  const bool shaded_;
  triangulation::WriteSet everything_;
  std::map<lattice::LeafAddress, std::vector<VertexId>>
      open_;       // of follow(): what lies outside all leaves, by square, once it was looked at
  Effort effort_;  // of begin() and follow()
  mutable Levels levels_;
  std::vector<VertexId> list_;
  std::vector<VertexId> hints_;  // of change(): by point that comes
  std::vector<std::pair<std::uint64_t, VertexId>> sorted_;
  using Pages = triangulation::TrianglePages;
  struct BlockHash {
    std::uint64_t sum = 0;    // of the terms of its triangles in `terms`
    std::uint16_t terms = 0;  // slots with a term in `sum`, also of triangles gone since
    std::uint16_t drawn = 0;  // slots that are as they were told
    static_assert(Pages::kBlock <= 16);
  };
  std::vector<BlockHash> hashes_;                // by block of triangles
  triangulation::Records<std::uint64_t> terms_;  // by triangle that is not fresh: of its leaf's hash
  mesh::Extractor extractor_;
};

}  // namespace ridgecast::core
