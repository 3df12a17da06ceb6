#include "server/replica/replica.h"

#include <algorithm>
#include <cassert>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::replica {

Replica::Replica(std::uint32_t window) : window_(std::max(window, 1u)) {}

Changes Replica::send(std::span<const pipeline::LeafState> leaves) {
  assert(hasRoom());
  Changes changes;
  scratch_.clear();
  scratch_.reserve(leaves.size());
  auto held = held_.cbegin();
  const auto drop = [&] {
    changes.gone.push_back(held->address);
    meshHash_ -= mesh::hashTerm(held->address, held->hash);
    ++held;
  };
  for (const pipeline::LeafState& leaf : leaves) {
    assert(scratch_.empty() || scratch_.back().address < leaf.address);
    while (held != held_.cend() && held->address < leaf.address) drop();
    const bool known = held != held_.cend() && held->address == leaf.address;
    if (!known || held->hash != leaf.hash) {
      if (known) meshHash_ -= mesh::hashTerm(held->address, held->hash);
      meshHash_ += mesh::hashTerm(leaf.address, leaf.hash);
      changes.whole.push_back(leaf.address);
    } else if (held->again) {
      changes.whole.push_back(leaf.address);
    }
    if (known) ++held;
    scratch_.push_back({leaf.address, leaf.version, leaf.hash, false});
  }
  while (held != held_.cend()) drop();
  held_.swap(scratch_);
  owes_ = false;

  changes.number = ++lastSent_;
  changes.meshHash = meshHash_;
  unacknowledged_.push_back({changes.number, changes.meshHash});
  return changes;
}

bool Replica::differs(std::span<const pipeline::LeafState> leaves) const {
  if (owes_ || leaves.size() != held_.size()) return true;
  return !std::equal(leaves.begin(), leaves.end(), held_.begin(), [](const pipeline::LeafState& leaf, const Held& held) {
    return leaf.address == held.address && (leaf.version == held.version || leaf.hash == held.hash);
  });
}

Verdict Replica::acknowledge(std::uint64_t iteration, std::uint64_t meshHash) {
  if (iteration == 0 || iteration > lastSent_) return Verdict::kNeverSent;
  if (unacknowledged_.empty() || iteration < unacknowledged_.front().number) return Verdict::kOutOfOrder;
  while (unacknowledged_.front().number < iteration) unacknowledged_.pop_front();
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
  // What is under way was computed without knowing of the loss, so its hashes will differ too.
  judgedAfter_ = lastSent_;
  if (leaves.empty()) {
    for (Held& held : held_) held.again = true;
    owes_ = owes_ || !held_.empty();
    return;
  }
  for (const lattice::LeafAddress& address : leaves) {
    const auto it = std::lower_bound(held_.begin(), held_.end(), address,
                                     [](const Held& held, const lattice::LeafAddress& a) { return held.address < a; });
    if (it == held_.end() || it->address != address) continue;
    it->again = true;
    owes_ = true;
  }
}

}  // namespace ridgecast::replica
