#include "server/quadtree/quadtree.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/outcome/contract.h"

namespace ridgecast::quadtree {

using lattice::LeafAddress;
using lattice::Step;

namespace {
constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kSlack = 0.01;   // metres: far above what rounding does to distances,
constexpr double kLongest = 1e9;  // and to their sums up to here

// Gap between an interval [low, high] and a point.
double gap(double p, double low, double high) { return p < low ? low - p : p > high ? p - high : 0.0; }

// Whether all of a square does.
bool liesOnLattice(LeafAddress square) {
  return lattice::positionIsValid(square.x(), square.z()) &&
         lattice::positionIsValid(square.x() + square.side(), square.z() + square.side());
}
}  // namespace

// The deepest node of this level or coarser that holds a point: nothing beyond every root.
inline Quadtree::Place Quadtree::descend(lattice::Point p, int finest) const {
  const LeafAddress root = lattice::leafAt(p, kRootLevel);
  Place at{rootAt(root.i, root.j), kRootLevel};
  if (at.node < 0) return at;
  while (at.level > finest && nodes_[at.node].children >= 0) {
    const int bits = lattice::kFinestSideBits + --at.level;
    at.node = nodes_[at.node].children + static_cast<std::int32_t>(((p.x >> bits) & 1) + 2 * ((p.z >> bits) & 1));
  }
  return at;
}

std::int32_t Quadtree::find(LeafAddress address) const {
  const Place at = descend({address.x(), address.z()}, address.level);
  return at.node >= 0 && at.level == address.level && nodes_[at.node].children < 0 ? at.node : -1;
}

std::int32_t Quadtree::newFour() {
  std::int32_t first;
  if (!free_.empty()) {
    first = free_.back();
    free_.pop_back();
  } else {
    first = static_cast<std::int32_t>(nodes_.size());
    nodes_.resize(nodes_.size() + 4);
  }
  for (int k = 0; k < 4; ++k) nodes_[first + k] = Node{};
  return first;
}

// A leaf is one no longer.
void Quadtree::drop(std::int32_t node) {
  if (nodes_[node].tag != 0) gone_.push_back(nodes_[node].tag);
  nodes_[node].tag = 0;
}

void Quadtree::makeChildren(std::int32_t node) {
  const std::int32_t first = newFour();
  drop(node);
  nodes_[node].children = first;
}

void Quadtree::freeChildren(std::int32_t node) {
  for (int k = 0; k < 4; ++k) {
    expects(nodes_[nodes_[node].children + k].children < 0, "what is merged are leaves");
    drop(nodes_[node].children + k);
  }
  free_.push_back(nodes_[node].children);
  nodes_[node].children = -1;
}

double Quadtree::distance(const View& view, LeafAddress square) const {
  const double x0 = static_cast<double>(square.x()), z0 = static_cast<double>(square.z()), side = static_cast<double>(square.side());
  const double dx = gap(view.x, x0, x0 + side), dz = gap(view.z, z0, z0 + side);
  return std::sqrt(dx * dx + dz * dz) * lattice::kMetresPerStep;
}

// Returns the node's next check.
double Quadtree::update(const View& view, std::int32_t node, LeafAddress address) {
  if (nodes_[node].nextCheck > travel_) return nodes_[node].nextCheck;
  if (address.level == 0) return nodes_[node].nextCheck = kNever;
  const double side = static_cast<double>(address.side()) * lattice::kMetresPerStep, flat = distance(view, address);
  const double away = std::sqrt(flat * flat + view.above * view.above);
  const bool split = nodes_[node].children >= 0;
  const double merges = side / kMerge, splits = side / kSplit;  // four leaves from here on, a leaf nearer than this
  if (split && !(away < merges)) {
    collapse(node);
    made_.push_back(address);
    return nodes_[node].nextCheck = travel_ + (away - splits) - kSlack;
  }
  if (!split) {
    if (!(away < splits)) return nodes_[node].nextCheck = travel_ + (away - splits) - kSlack;
    makeChildren(node);
    for (int k = 0; k < 4; ++k) made_.push_back(address.child(k));
  }
  double next = travel_ + (merges - away) - kSlack;
  for (int k = 0; k < 4; ++k) next = std::min(next, update(view, nodes_[node].children + k, address.child(k)));
  return nodes_[node].nextCheck = next;
}

// Makes a node a leaf, whatever hung below it.
void Quadtree::collapse(std::int32_t node) {
  if (nodes_[node].children < 0) return;
  for (int k = 0; k < 4; ++k) collapse(nodes_[node].children + k);
  freeChildren(node);
}

std::int32_t Quadtree::makeRoot(LeafAddress address) {
  Root& root = roots_[rootSlot(address.i, address.j)];
  expects(root.node < 0, "roots that are held share no slot");
  root = {address.i, address.j, newFour()};
  held_.push_back(address);
  return root.node;
}

void Quadtree::followRoots(const View& view, const camera::Pose& pose) {
  if (nextRootCheck_ > travel_) return;
  nextRootCheck_ = kNever;
  std::erase_if(held_, [&](LeafAddress address) {
    const double slack = kKeepDistance - distance(view, address);
    if (slack >= 0) {
      nextRootCheck_ = std::min(nextRootCheck_, travel_ + slack - kSlack);
      return false;
    }
    const std::int32_t node = rootAt(address.i, address.j);
    collapse(node);
    drop(node);
    free_.push_back(node);  // a root sits in the first of four slots of its own
    roots_[rootSlot(address.i, address.j)] = {};
    return true;
  });
  const LeafAddress centre = lattice::leafAt({pose.x, pose.z}, kRootLevel);
  const double side = static_cast<double>(centre.side()) * lattice::kMetresPerStep;
  const auto reach = static_cast<std::int64_t>(kHorizon / side) + 1;
  nextRootCheck_ = std::min(nextRootCheck_, travel_ + (static_cast<double>(reach) * side - kHorizon) - kSlack);  // of those beyond
  for (std::int64_t i = centre.i - reach; i <= centre.i + reach; ++i)
    for (std::int64_t j = centre.j - reach; j <= centre.j + reach; ++j) {
      const LeafAddress address{kRootLevel, i, j};
      if (rootAt(i, j) >= 0 || !liesOnLattice(address)) continue;
      if (const double slack = distance(view, address) - kHorizon; slack > 0) {
        nextRootCheck_ = std::min(nextRootCheck_, travel_ + slack - kSlack);
        continue;
      }
      makeRoot(address);
      made_.push_back(address);
    }
  std::sort(held_.begin(), held_.end());
}

bool Quadtree::follow(const camera::Pose& pose, double ground) {
  expects(lattice::positionIsValid(pose.x, pose.z), "a camera is over the lattice");
  expects(std::isfinite(pose.y) && std::isfinite(ground), "a camera and its ground have heights");
  const View view{static_cast<double>(pose.x), static_cast<double>(pose.z), std::max(0.0, pose.y - ground)};
  made_.clear();
  gone_.clear();
  const double dx = (view.x - last_.x) * lattice::kMetresPerStep, dz = (view.z - last_.z) * lattice::kMetresPerStep,
               dy = view.above - last_.above;
  travel_ += std::sqrt(dx * dx + dz * dz + dy * dy);
  if (travel_ > kLongest) {
    travel_ = 0;
    nextRootCheck_ = kAlways;
    for (Node& node : nodes_) node.nextCheck = kAlways;
  }
  last_ = view;
  followRoots(view, pose);
  for (const LeafAddress& address : held_) update(view, rootAt(address.i, address.j), address);
  std::erase_if(made_, [&](LeafAddress address) { return !isLeaf(address); });  // split in turn
  std::sort(made_.begin(), made_.end());
  return !made_.empty() || !gone_.empty();
}

bool Quadtree::isLeaf(LeafAddress address) const { return find(address) >= 0; }

bool Quadtree::leafAt(lattice::Point p, LeafAddress& leaf) const {
  const Place at = descend(p, 0);
  if (at.node >= 0) leaf = lattice::leafAt(p, at.level);
  return at.node >= 0;
}

std::uint32_t Quadtree::tagAt(lattice::Point p) const {
  const std::int32_t node = descend(p, 0).node;
  return node < 0 ? 0 : nodes_[node].tag;
}

// Walks along the ring just outside, from leaf to leaf.
template <class F>
void Quadtree::forEachTouching(LeafAddress leaf, F&& f) const {
  const Step x0 = leaf.x() - 1, z0 = leaf.z() - 1, x1 = leaf.x() + leaf.side(), z1 = leaf.z() + leaf.side();
  const auto along = [&](bool horizontal, Step fixed, Step from, Step to) {
    for (Step at = from; at <= to;) {
      const Place touching = descend(horizontal ? lattice::Point{at, fixed} : lattice::Point{fixed, at}, 0);
      if (touching.node >= 0) f(touching);
      const int bits = lattice::kFinestSideBits + touching.level;
      at = lattice::floorTo(at, bits) + (Step{1} << bits);
    }
  };
  along(true, z0, x0, x1);
  along(true, z1, x0, x1);
  along(false, x0, z0, z1);
  along(false, x1, z0, z1);
}

void Quadtree::touchingTags(LeafAddress leaf, std::vector<std::uint32_t>& tags) const {
  tags.clear();
  forEachTouching(leaf, [&](const Place& other) { tags.push_back(nodes_[other.node].tag); });
  std::sort(tags.begin(), tags.end());
  tags.erase(std::unique(tags.begin(), tags.end()), tags.end());
}

bool Quadtree::restore(const std::vector<LeafAddress>& leaves) {
  expects(held_.empty(), "a tree is restored before it follows a camera");
  constexpr std::int64_t kReach = kRootSlots / 2;  // so that any two of them share no slot
  for (const LeafAddress& leaf : leaves) {
    if (leaf.level > kRootLevel || !lattice::addressIsValid(leaf) || !liesOnLattice(leaf)) return false;
    const LeafAddress root = lattice::leafAt({leaf.x(), leaf.z()}, kRootLevel);
    const LeafAddress first = held_.empty() ? root : held_.front();
    if (std::abs(root.i - first.i) >= kReach || std::abs(root.j - first.j) >= kReach) return false;
    std::int32_t node = rootAt(root.i, root.j);
    if (node < 0) node = makeRoot(root);
    for (int level = kRootLevel; level > leaf.level; --level) {
      if (nodes_[node].children < 0) makeChildren(node);
      const int bits = lattice::kFinestSideBits + level - 1;
      node = nodes_[node].children + static_cast<std::int32_t>(((leaf.x() >> bits) & 1) + 2 * ((leaf.z() >> bits) & 1));
    }
  }
  std::sort(held_.begin(), held_.end());
  made_ = leaves;
  // As many as the tree has, and each is one: all of them.
  std::size_t count = held_.size();
  for (const Node& node : nodes_) count += node.children >= 0 ? 3 : 0;
  return count == leaves.size() && std::ranges::all_of(leaves, [this](LeafAddress leaf) {
           bool isBalanced = isLeaf(leaf);
           forEachTouching(leaf, [&](const Place& other) { isBalanced = isBalanced && std::abs(other.level - leaf.level) <= 1; });
           return isBalanced;
         });
}

void Quadtree::setTag(LeafAddress leaf, std::uint32_t tag) {
  const std::int32_t node = find(leaf);
  expects(node >= 0, "a node that is asked for is there");
  nodes_[node].tag = tag;
}

std::uint32_t Quadtree::tag(LeafAddress leaf) const {
  const std::int32_t node = find(leaf);
  return node >= 0 ? nodes_[node].tag : 0;
}

}  // namespace ridgecast::quadtree
