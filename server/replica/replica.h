#pragma once
// What one client holds: which leaf in which version, once it has applied everything that was sent. Decides what the next iteration
// must carry and checks what the client acknowledges. Knows no socket, no thread and no mesh, only addresses, versions and hashes
// (bases.h remembers the meshes that deltas start from).
//
// The stream is ordered and loses nothing, so what was sent is what will be held; acknowledgements bound what is under way and prove,
// by the hash of the mesh, that both sides agree.
//
// A leaf goes through these states, told by the lists of Changes it is named in:
//
//               whole, changed (from leaves that are gone)        changed, whole
//     not held ------------------------------------------> held ---------------+
//        ^                                                 |  ^                |
//        +-------------------------------------------------+  +----------------+
//                              gone
//
// Not thread-safe. Memory: about 48 bytes a leaf, and a number and a hash an unacknowledged iteration (at most `window`).

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_state.h"
#include "common/wire/messages.h"

namespace ridgecast::replica {

inline constexpr std::uint32_t kDefaultWindow = 4;  // iterations
// So often is everything sent again without a hash that agrees in between; then the client is beyond help.
inline constexpr int kMaxRepairs = 3;

// A leaf that the client can make from what it holds before the iteration.
struct Derived {
  lattice::LeafAddress address;
  std::uint64_t hash = 0;              // of the leaf
  std::uint32_t first = 0, count = 0;  // of Changes::sources: the leaf itself, or leaves that are gone and cover or lie in it
};

// What the next iteration must carry. Addresses in canonical order; a leaf is never in two lists.
struct Changes {
  std::uint64_t number = 0;                 // of the iteration, ascending by 1 from 1
  std::vector<lattice::LeafAddress> gone;   // held, and no longer part of the mesh
  std::vector<lattice::LeafAddress> whole;  // new or asked for again; leaves without triangles are held as well, and empty
  std::vector<Derived> changed;
  std::vector<lattice::LeafAddress> sources;  // of `changed`
  std::uint64_t meshHash = 0;                 // of what the client holds afterwards
};

enum class Verdict {
  kAgrees,      // as expected, or an iteration sent before a repair, whose hash is no longer judged
  kRepairs,     // another hash: everything will be sent whole again
  kHopeless,    // another hash even after kMaxRepairs repairs
  kNeverSent,   // an iteration that was never sent
  kOutOfOrder,  // an iteration that was acknowledged before
};

class Replica {
 public:
  // window >= 1. Without deltas nothing is ever `changed`, everything whole.
  explicit Replica(std::uint32_t window = kDefaultWindow, bool deltas = false);

  // The client still holds these of an earlier connection. Only before the first send(); may come in parts. False, and nothing has
  // happened: a leaf twice, or more than wire::kMaxResumed in all.
  bool resume(std::span<const wire::HeldLeaf> leaves);
  void setDeltas(bool deltas) { deltas_ = deltas; }
  // Before the first send(): whether the client resumed at least half of these leaves, with whatever content. `leaves` as in send().
  bool resumes(std::span<const mesh::LeafState> leaves) const;

  // Whether another iteration may be sent: fewer than `window` are unacknowledged.
  bool hasRoom() const { return unacknowledged_.size() < window_; }
  std::uint32_t unacknowledged() const { return static_cast<std::uint32_t>(unacknowledged_.size()); }
  std::uint32_t window() const { return window_; }

  // Whether leaves were asked for again and not sent since.
  bool owes() const { return owes_; }

  // Compares the mesh with what the client holds and takes the difference as sent. `leaves` in canonical order, no address twice.
  // Only when hasRoom(). A leaf whose content is what the client holds is not sent, even when its version moved on.
  Changes send(std::span<const mesh::LeafState> leaves);

  // Whether send() would carry anything.
  bool differs(std::span<const mesh::LeafState> leaves) const;

  // The client says: applied every iteration up to `iteration`, and now holds `meshHash`. Frees the window up to there. After
  // kNeverSent and kOutOfOrder nothing has changed.
  Verdict acknowledge(std::uint64_t iteration, std::uint64_t meshHash);

  // The client lost these; none named: everything. Addresses that it should not hold are ignored.
  void resend(std::span<const lattice::LeafAddress> leaves);

  std::size_t leaves() const { return held_.size(); }
  std::uint64_t meshHash() const { return meshHash_; }
  std::uint64_t lastSent() const { return lastSent_; }  // the number of the last iteration; 0: none yet

 private:
  struct Held {
    lattice::LeafAddress address;
    std::uint64_t version = 0;
    std::uint64_t hash = 0;
    bool again = false;  // was asked for again
  };
  struct Sent {
    std::uint64_t number = 0;
    std::uint64_t meshHash = 0;
  };
  struct Arrival {
    lattice::LeafAddress address;
    std::uint64_t hash = 0;
  };

  void derive(Changes& changes, std::span<const Arrival> arrivals, std::span<const lattice::LeafAddress> sources) const;

  std::uint32_t window_;
  bool deltas_;
  std::vector<Held> held_;     // in canonical order
  std::vector<Held> scratch_;  // the next held_: kept for its memory
  std::deque<Sent> unacknowledged_;
  std::uint64_t lastSent_ = 0;
  std::uint64_t judgedAfter_ = 0;  // iterations up to this one were sent before a repair
  std::uint64_t meshHash_ = 0;
  int repairs_ = 0;  // since hashes last agreed
  bool owes_ = false;
};

}  // namespace ridgecast::replica
