#include "server/quadtree/quadtree.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace ridgecast::quadtree {

using lattice::LeafAddress;
using lattice::Step;

namespace {
// Gap between an interval [low, high] and a point.
double gap(double p, double low, double high) { return p < low ? low - p : p > high ? p - high : 0.0; }
}  // namespace

std::int32_t Quadtree::find(LeafAddress address) const {
  const int up = kRootLevel - address.level;
  if (up < 0) return -1;
  const auto root = roots_.find({kRootLevel, address.i >> up, address.j >> up});
  if (root == roots_.end()) return -1;
  std::int32_t node = root->second;
  for (int d = up - 1; d >= 0; --d) {
    if (nodes_[node].children < 0) return -1;
    node = nodes_[node].children + static_cast<std::int32_t>(((address.i >> d) & 1) + 2 * ((address.j >> d) & 1));
  }
  return node;
}

std::int32_t Quadtree::makeChildren(std::int32_t node) {
  std::int32_t first;
  if (!free_.empty()) {
    first = free_.back();
    free_.pop_back();
  } else {
    first = static_cast<std::int32_t>(nodes_.size());
    nodes_.resize(nodes_.size() + 4);
  }
  for (int k = 0; k < 4; ++k) nodes_[first + k] = Node{};
  nodes_[node].children = first;
  leafCount_ += 3;
  changed_ = true;
  return first;
}

void Quadtree::freeChildren(std::int32_t node) {
  free_.push_back(nodes_[node].children);
  nodes_[node].children = -1;
  leafCount_ -= 3;
  changed_ = true;
}

double Quadtree::distance(const View& view, LeafAddress square) const {
  const double x0 = static_cast<double>(square.x()), z0 = static_cast<double>(square.z()), side = static_cast<double>(square.side());
  const double dx = gap(view.x, x0, x0 + side), dz = gap(view.z, z0, z0 + side);
  return std::sqrt(dx * dx + dz * dz) * lattice::kMetresPerStep;
}

bool Quadtree::wantsChildren(const View& view, LeafAddress address, double factor) const {
  if (address.level == 0) return false;
  const double side = static_cast<double>(address.side()) * lattice::kMetresPerStep, flat = distance(view, address);
  return side * side > factor * factor * (flat * flat + view.above * view.above);
}

void Quadtree::update(const View& view, std::int32_t node, LeafAddress address) {
  if (nodes_[node].children < 0) {
    if (!wantsChildren(view, address, kSplit)) return;
    makeChildren(node);
  } else if (!wantsChildren(view, address, kMerge)) {
    collapse(node);
    return;
  }
  for (int k = 0; k < 4; ++k) update(view, nodes_[node].children + k, address.child(k));
}

// Makes a node a leaf, whatever hung below it.
void Quadtree::collapse(std::int32_t node) {
  if (nodes_[node].children < 0) return;
  for (int k = 0; k < 4; ++k) collapse(nodes_[node].children + k);
  freeChildren(node);
  nodes_[node].tag = 0;
}

bool Quadtree::follow(const camera::Pose& pose, double ground) {
  const View view{static_cast<double>(pose.x), static_cast<double>(pose.z), std::max(0.0, pose.y - ground)};
  changed_ = false;
  std::vector<LeafAddress> held;
  for (const auto& [address, node] : roots_) held.push_back(address);
  std::sort(held.begin(), held.end());
  for (const LeafAddress& address : held) {
    if (distance(view, address) <= kKeepDistance) continue;
    const std::int32_t node = roots_.at(address);
    collapse(node);
    changed_ = true;
    free_.push_back(node);  // a root sits in the first of four slots of its own
    roots_.erase(address);
    --leafCount_;
  }
  const LeafAddress centre = lattice::leafAt({pose.x, pose.z}, kRootLevel);
  const std::int64_t reach = static_cast<std::int64_t>(kHorizon * lattice::kStepsPerMetre / static_cast<double>(centre.side())) + 1;
  for (std::int64_t i = centre.i - reach; i <= centre.i + reach; ++i)
    for (std::int64_t j = centre.j - reach; j <= centre.j + reach; ++j) {
      const LeafAddress address{kRootLevel, i, j};
      if (roots_.count(address) || distance(view, address) > kHorizon) continue;
      std::int32_t node;
      if (!free_.empty()) {
        node = free_.back();
        free_.pop_back();
      } else {
        node = static_cast<std::int32_t>(nodes_.size());
        nodes_.resize(nodes_.size() + 4);
      }
      nodes_[node] = Node{};
      roots_.emplace(address, node);
      ++leafCount_;
      changed_ = true;
    }
  held.clear();
  for (const auto& [address, node] : roots_) held.push_back(address);
  std::sort(held.begin(), held.end());
  for (const LeafAddress& address : held) update(view, roots_.at(address), address);
  return changed_;
}

template <class F>
void Quadtree::visit(std::int32_t node, LeafAddress address, F&& f) const {
  if (nodes_[node].children < 0) {
    f(address, nodes_[node].tag);
    return;
  }
  for (int k = 0; k < 4; ++k) visit(nodes_[node].children + k, address.child(k), f);
}

std::vector<LeafAddress> Quadtree::leaves() const {
  std::vector<LeafAddress> out;
  out.reserve(leafCount_);
  for (const auto& [address, node] : roots_) visit(node, address, [&](LeafAddress a, std::uint32_t) { out.push_back(a); });
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<LeafAddress> Quadtree::untagged(const std::function<void(std::uint32_t)>& tagged) const {
  std::vector<LeafAddress> out;
  for (const auto& [address, node] : roots_)
    visit(node, address, [&](LeafAddress a, std::uint32_t tag) {
      if (tag == 0) out.push_back(a);
      else tagged(tag);
    });
  std::sort(out.begin(), out.end());
  return out;
}

bool Quadtree::isLeaf(LeafAddress address) const {
  const std::int32_t node = find(address);
  return node >= 0 && nodes_[node].children < 0;
}

bool Quadtree::leafAt(lattice::Point p, LeafAddress& leaf) const {
  LeafAddress address = lattice::leafAt(p, kRootLevel);
  const auto root = roots_.find(address);
  if (root == roots_.end()) return false;
  std::int32_t node = root->second;
  while (nodes_[node].children >= 0) {
    const int bits = address.sideBits() - 1;
    const int k = static_cast<int>(((p.x >> bits) & 1) + 2 * ((p.z >> bits) & 1));
    node = nodes_[node].children + k;
    address = address.child(k);
  }
  leaf = address;
  return true;
}

std::uint32_t Quadtree::tagAt(lattice::Point p) const {
  const auto root = roots_.find(lattice::leafAt(p, kRootLevel));
  if (root == roots_.end()) return 0;
  std::int32_t node = root->second;
  for (int bits = lattice::kFinestSideBits + kRootLevel - 1; nodes_[node].children >= 0; --bits)
    node = nodes_[node].children + static_cast<std::int32_t>(((p.x >> bits) & 1) + 2 * ((p.z >> bits) & 1));
  return nodes_[node].tag;
}

std::vector<LeafAddress> Quadtree::touching(LeafAddress leaf) const {
  std::vector<LeafAddress> out;
  // Walk along the ring just outside, from leaf to leaf; the finest square is the smallest stride there is.
  const Step x0 = leaf.x() - 1, z0 = leaf.z() - 1, x1 = leaf.x() + leaf.side(), z1 = leaf.z() + leaf.side();
  const auto along = [&](bool horizontal, Step fixed, Step from, Step to) {
    for (Step at = from; at <= to;) {
      LeafAddress found;
      const lattice::Point p = horizontal ? lattice::Point{at, fixed} : lattice::Point{fixed, at};
      if (leafAt(p, found)) {
        out.push_back(found);
        at = horizontal ? found.x() + found.side() : found.z() + found.side();
      } else {
        at = lattice::floorTo(at, lattice::kFinestSideBits + kRootLevel) + (Step{1} << (lattice::kFinestSideBits + kRootLevel));
      }
    }
  };
  along(true, z0, x0, x1);
  along(true, z1, x0, x1);
  along(false, x0, z0, z1);
  along(false, x1, z0, z1);
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

void Quadtree::setTag(LeafAddress leaf, std::uint32_t tag) {
  const std::int32_t node = find(leaf);
  assert(node >= 0 && nodes_[node].children < 0);
  nodes_[node].tag = tag;
}

std::uint32_t Quadtree::tag(LeafAddress leaf) const {
  const std::int32_t node = find(leaf);
  return node >= 0 && nodes_[node].children < 0 ? nodes_[node].tag : 0;
}

}  // namespace ridgecast::quadtree
