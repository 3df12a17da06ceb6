#pragma once
// Which leaves a camera holds: squares that grow with their distance, out to the horizon, following the camera.
//
// The roots are the squares of kRootLevel that come within kKeepDistance (they are taken in within kHorizon); below each hangs a tree.
// A node splits while its side exceeds kSplit times its distance, and four leaves merge once their parent's side is at most
// kMerge times its distance; the gap between the two is the hysteresis. Distance is 3D: from the camera to the nearest point of the
// square, the ground taken at the height of the ground below the camera. kSplit < 0.7, so leaves that touch differ by at most one
// level without any balancing.
//
// A leaf is invalid until its first mesh was made. The tree carries a tag for each leaf (the engine's handle, 0: none).
// One thread at a time.

#include <cstdint>
#include <functional>
#include <unordered_map>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"

namespace ridgecast::quadtree {

inline constexpr int kRootLevel = 8;               // 8,192 m
inline constexpr double kHorizon = 32'000;         // metres
inline constexpr double kKeepDistance = 34'000;    // metres
inline constexpr double kSplit = 0.25;
inline constexpr double kMerge = 0.225;

class Quadtree {
 public:
  // Follows the camera; ground: height of the ground below it in metres. Returns whether any leaf came or went. A leaf that is new
  // has tag 0.
  bool follow(const camera::Pose& pose, double ground);

  // Every leaf of the tree, in canonical order of address.
  std::vector<lattice::LeafAddress> leaves() const;
  std::size_t leafCount() const { return leafCount_; }
  // The leaves without a tag, in canonical order; `tagged` is told the tags of the others, in any order.
  std::vector<lattice::LeafAddress> untagged(const std::function<void(std::uint32_t)>& tagged) const;

  bool isLeaf(lattice::LeafAddress address) const;
  // The leaf that holds a point; false when the point is beyond every root.
  bool leafAt(lattice::Point p, lattice::LeafAddress& leaf) const;
  // The leaves whose closed squares share at least a point with a leaf's, itself excluded, in canonical order.
  std::vector<lattice::LeafAddress> touching(lattice::LeafAddress leaf) const;

  void setTag(lattice::LeafAddress leaf, std::uint32_t tag);
  std::uint32_t tag(lattice::LeafAddress leaf) const;
  // The tag of the leaf that holds a point, 0 beyond every root. The engine asks this for every new triangle.
  std::uint32_t tagAt(lattice::Point p) const;

 private:
  struct Node {
    std::int32_t children = -1;  // index of the first of four, -1: a leaf
    std::uint32_t tag = 0;
  };
  struct View {
    double x, z, above;          // camera in steps relative to nothing: exact below 2^53; height above ground in metres
  };
  std::int32_t find(lattice::LeafAddress address) const;  // -1: no such node
  std::int32_t makeChildren(std::int32_t node);
  void freeChildren(std::int32_t node);
  double distance(const View& view, lattice::LeafAddress square) const;
  void update(const View& view, std::int32_t node, lattice::LeafAddress address);
  bool wantsChildren(const View& view, lattice::LeafAddress address, double factor) const;
  void collapse(std::int32_t node);
  template <class F>
  void visit(std::int32_t node, lattice::LeafAddress address, F&& f) const;

  std::unordered_map<lattice::LeafAddress, std::int32_t, lattice::LeafAddressHash> roots_;
  std::vector<Node> nodes_;
  std::vector<std::int32_t> free_;  // first of four
  std::size_t leafCount_ = 0;
  bool changed_ = false;
};

}  // namespace ridgecast::quadtree
