#include "server/replica/replica.h"

#include <algorithm>

#include "common/mesh/leaf_mesh.h"
#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::replica {

Replica::Replica(std::uint32_t window, bool followsPoints) : window_(std::max(window, 1u)), followsPoints_(followsPoints) {}

bool Replica::resume(std::span<const wire::HeldLeaf> leaves) {
  expects(lastSent_ == 0, "a client resumes before the first iteration");
  if (unnamed_ != 0 || held_.size() + leaves.size() > wire::kMaxResumed) return false;
  scratch_ = held_;
  for (const wire::HeldLeaf& leaf : leaves) scratch_.push_back({leaf.address, 0, 0, leaf.hash, false});
  std::ranges::sort(scratch_, {}, &Held::address);
  if (std::ranges::adjacent_find(scratch_, {}, &Held::address) != scratch_.end()) return false;
  held_.swap(scratch_);
  for (const wire::HeldLeaf& leaf : leaves) meshHash_ += mesh::hashTerm(leaf.address, leaf.hash);
  return true;
}

bool Replica::resume(std::uint64_t meshHash) {
  expects(lastSent_ == 0 && followsPoints_ && meshHash != 0, "a client that follows points resumes before the first iteration");
  if (unnamed_ != 0 || !held_.empty()) return false;
  unnamed_ = meshHash;
  return true;
}

void Replica::restore(std::span<const mesh::LeafState> leaves) {
  expects(lastSent_ == 0, "a client resumes before the first iteration");
  held_.clear();
  meshHash_ = unnamed_ = 0;
  for (const mesh::LeafState& leaf : leaves) {
    held_.push_back({leaf.address, leaf.version, leaf.points, leaf.hash, false});
    meshHash_ += mesh::hashTerm(leaf.address, leaf.hash);
  }
}

// By bytes: those that differ whole, or all by points, each about as the terrains at hand are coded.
bool Replica::isShorterAnew(std::span<const mesh::LeafState> leaves) const {
  constexpr double kWhole = 24, kWholeTriangle = 1.9, kName = 9, kTriangle = 1.1;
  double whole = 0, anew = kName * static_cast<double>(held_.size() + leaves.size());
  auto held = held_.cbegin();
  for (const mesh::LeafState& leaf : leaves) {
    while (held != held_.cend() && held->address < leaf.address) ++held;
    const bool isSame = held != held_.cend() && held->address == leaf.address && held->hash == leaf.hash && !held->again;
    if (!isSame) whole += kWhole + kWholeTriangle * leaf.triangles;
    anew += kTriangle * leaf.triangles;
  }
  return anew < whole;
}

bool Replica::resumes(std::span<const mesh::LeafState> leaves) const {
  if (lastSent_ == 0 && unnamed_ != 0) return true;
  if (lastSent_ != 0 || held_.empty()) return false;
  std::size_t known = 0;
  auto held = held_.cbegin();
  for (const mesh::LeafState& leaf : leaves) {
    while (held != held_.cend() && held->address < leaf.address) ++held;
    known += held != held_.cend() && held->address == leaf.address;
  }
  return 2 * known >= leaves.size();
}

Changes Replica::send(std::span<const mesh::LeafState> leaves) {
  expects(hasRoom(), "an iteration is sent where the window has room");
  Changes changes;
  changes.anew = lastSent_ == 0 || repairs(leaves);
  if (unnamed_ != 0) {
    std::uint64_t hash = 0;
    for (const mesh::LeafState& leaf : leaves) hash += mesh::hashTerm(leaf.address, leaf.hash);
    if (hash == unnamed_) restore(leaves);
    unnamed_ = 0;
  }
  if (lastSent_ == 0 && followsPoints_ && isShorterAnew(leaves)) {
    for (const Held& held : held_) changes.gone.push_back(held.address);
    held_.clear();
    meshHash_ = 0;
  }
  const bool whole = !followsPoints_ || (changes.anew && !held_.empty());
  scratch_.clear();
  scratch_.reserve(leaves.size());
  auto held = held_.cbegin();
  const auto drop = [&] {
    changes.gone.push_back(held->address);
    meshHash_ -= mesh::hashTerm(held->address, held->hash);
    ++held;
  };
  for (const mesh::LeafState& leaf : leaves) {
    expects(scratch_.empty() || scratch_.back().address < leaf.address, "leaves come in canonical order");
    while (held != held_.cend() && held->address < leaf.address) drop();
    const bool known = held != held_.cend() && held->address == leaf.address;
    if (!known) {
      meshHash_ += mesh::hashTerm(leaf.address, leaf.hash);
      (whole ? changes.whole : changes.come).push_back(leaf.address);
      if (!whole) changes.other.push_back(leaf.address);
    } else {
      const bool differs = held->hash != leaf.hash;
      if (differs) meshHash_ += mesh::hashTerm(leaf.address, leaf.hash) - mesh::hashTerm(held->address, held->hash);
      if (whole && (differs || held->again)) changes.whole.push_back(leaf.address);
      if (!whole && held->points != leaf.points) changes.touched.push_back(leaf.address);
      if (!whole && differs) changes.other.push_back(leaf.address);
      ++held;
    }
    scratch_.push_back({leaf.address, leaf.version, leaf.points, leaf.hash, false});
  }
  while (held != held_.cend()) drop();
  held_.swap(scratch_);
  owes_ = false;

  changes.number = ++lastSent_;
  changes.meshHash = meshHash_;
  unacknowledged_.push_back({changes.number, changes.meshHash});
  return changes;
}

bool Replica::repairs(std::span<const mesh::LeafState> leaves) const {
  return owes_ && std::ranges::any_of(held_, [&](const Held& held) {
           return held.again && std::ranges::binary_search(leaves, held.address, {}, &mesh::LeafState::address);
         });
}

bool Replica::differs(std::span<const mesh::LeafState> leaves) const {
  if (owes_ || leaves.size() != held_.size()) return true;
  return !std::equal(leaves.begin(), leaves.end(), held_.begin(), [](const mesh::LeafState& leaf, const Held& held) {
    return leaf.address == held.address && (leaf.version == held.version || leaf.hash == held.hash);
  });
}

Verdict Replica::acknowledge(std::uint64_t iteration, std::uint64_t meshHash) {
  if (iteration == 0 || iteration > lastSent_) return Verdict::kNeverSent;
  if (unacknowledged_.empty() || iteration < unacknowledged_.front().number) return Verdict::kOutOfOrder;
  while (unacknowledged_.front().number < iteration) unacknowledged_.pop_front();
  expects(unacknowledged_.front().number == iteration, "iterations that wait have all numbers");
  const bool agrees = unacknowledged_.front().meshHash == meshHash;
  unacknowledged_.pop_front();
  if (agrees) {
    repairs_ = 0;
    return Verdict::kAgrees;
  }
  if (iteration <= judgedAfter_) return Verdict::kAgrees;
  if (repairs_ >= kMaxRepairs) return Verdict::kHopeless;
  ++repairs_;
  resend({});
  return Verdict::kRepairs;
}

void Replica::resend(std::span<const lattice::LeafAddress> leaves) {
  // Iterations under way were computed without this loss, so their hashes will differ too.
  judgedAfter_ = lastSent_;
  if (leaves.empty()) {
    for (Held& held : held_) held.again = true;
    owes_ = owes_ || !held_.empty();
    return;
  }
  for (const lattice::LeafAddress& address : leaves) {
    const auto it = std::ranges::lower_bound(held_, address, {}, &Held::address);
    if (it == held_.end() || it->address != address) continue;
    it->again = true;
    owes_ = true;
  }
}

}  // namespace ridgecast::replica
