#pragma once
// Which leaves a camera holds: squares that grow with their distance, out to the horizon, following the camera.
//
// The roots are the squares of kRootLevel that come within kKeepDistance (they are taken in within kHorizon) and lie on the lattice; below
// each hangs a tree. A node splits while its side exceeds kSplit times its distance, and four leaves merge once their parent's side is at
// most kMerge times its distance; the gap between the two is the hysteresis. Distance is 3D: from the camera to the nearest point of the
// square, the ground taken at the height of the ground below the camera. kSplit < 0.7, so leaves that touch differ by at most one
// level without any balancing.
//
// The tree carries a tag for each leaf (the engine's handle, 0: none).
//
// A camera that moves by d changes no distance by more than d. So each node knows how far the camera may travel before it or anything below
// it can split or merge: its next check. follow() skips nodes until then.
//
// follow() and setTag(): one thread, alone. The rest reads.

#include <array>
#include <cstdint>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"

namespace ridgecast::quadtree {

inline constexpr int kRootLevel = 8;             // 8,192 m
inline constexpr double kHorizon = 32'000;       // metres
inline constexpr double kKeepDistance = 34'000;  // metres
inline constexpr double kSplit = 0.25;
inline constexpr double kMerge = 0.225;

class Quadtree {
 public:
  // Follows the camera; ground: height of the ground below it in metres. Returns whether any leaf came or went. A leaf that is new
  // has tag 0, and is to get one before the next call.
  bool follow(const camera::Pose& pose, double ground);
  // An empty tree gets these leaves, in canonical order, as made(): those of a tree that followed some camera. False: there is no such
  // tree, and this one is not to be used any more.
  bool restore(const std::vector<lattice::LeafAddress>& leaves);
  // By the last follow(): the leaves that came, in canonical order, and the tags of those that went, in any.
  const std::vector<lattice::LeafAddress>& made() const { return made_; }
  const std::vector<std::uint32_t>& gone() const { return gone_; }

  const std::vector<lattice::LeafAddress>& roots() const { return held_; }  // in canonical order
  bool isLeaf(lattice::LeafAddress address) const;
  // The leaf that holds a point; false when the point is beyond every root.
  bool leafAt(lattice::Point p, lattice::LeafAddress& leaf) const;
  // The tags of the leaves whose closed squares share at least a point with a leaf's, itself excluded, ascending.
  void touchingTags(lattice::LeafAddress leaf, std::vector<std::uint32_t>& tags) const;

  void setTag(lattice::LeafAddress leaf, std::uint32_t tag);
  std::uint32_t tag(lattice::LeafAddress leaf) const;
  // The tag of the leaf that holds a point, 0 beyond every root. The engine asks this for every new triangle.
  std::uint32_t tagAt(lattice::Point p) const;

 private:
  static constexpr double kAlways = -1;
  struct Node {
    std::int32_t children = -1;  // index of the first of four, -1: a leaf
    std::uint32_t tag = 0;
    double nextCheck = kAlways;  // travel from which on something here or below may change
  };
  struct View {
    double x, z, above;  // camera in steps relative to nothing: exact below 2^53; height above ground in metres
  };
  // The roots held lie within five of the camera's, so none of them share a slot.
  struct Root {
    std::int64_t i = 0, j = 0;
    std::int32_t node = -1;  // -1: none
  };
  static constexpr std::size_t kRootSlots = 16;  // each way
  static std::size_t rootSlot(std::int64_t i, std::int64_t j) {
    return static_cast<std::size_t>(i & (kRootSlots - 1)) * kRootSlots + static_cast<std::size_t>(j & (kRootSlots - 1));
  }
  std::int32_t rootAt(std::int64_t i, std::int64_t j) const {
    const Root& root = roots_[rootSlot(i, j)];
    return root.i == i && root.j == j ? root.node : -1;
  }
  struct Place {
    std::int32_t node;  // -1: none
    int level;
  };
  Place descend(lattice::Point p, int finest) const;
  std::int32_t find(lattice::LeafAddress address) const;  // -1: no leaf
  template <class F>
  void forEachTouching(lattice::LeafAddress leaf, F&& f) const;  // f(place): of leaves, several times where they are larger
  std::int32_t newFour();
  void makeChildren(std::int32_t node);
  void freeChildren(std::int32_t node);
  void drop(std::int32_t node);
  double distance(const View& view, lattice::LeafAddress square) const;
  double update(const View& view, std::int32_t node, lattice::LeafAddress address);
  std::int32_t makeRoot(lattice::LeafAddress address);
  void followRoots(const View& view, const camera::Pose& pose);
  void collapse(std::int32_t node);

  std::array<Root, kRootSlots * kRootSlots> roots_;
  std::vector<lattice::LeafAddress> held_;  // the roots, in canonical order
  std::vector<Node> nodes_;
  std::vector<std::int32_t> free_;  // first of four
  View last_{};
  double travel_ = 0;               // metres, of all follow() so far
  double nextRootCheck_ = kAlways;  // travel from which on a root may come or go
  std::vector<lattice::LeafAddress> made_;
  std::vector<std::uint32_t> gone_;
};

}  // namespace ridgecast::quadtree
