#pragma once
// What one client holds after applying everything sent: each leaf and its version. Decides what the next iteration must carry and checks
// acknowledgements. Knows only addresses, versions and hashes: no socket, thread or mesh (encoding keeps the points that the client holds).
//
// The stream is ordered and lossless, so what was sent is what will be held. Acknowledgements bound what is in flight and prove, by the
// mesh's hash, that both sides agree.
//
// States of a leaf, and the lists of Changes that move it:
//
//               come, whole           touched, whole
//     not held -------------> held -----------------+
//        ^                    |  ^                  |
//        +--------------------+  +------------------+
//               gone
//
// A client that follows points and holds other leaves than the mesh's when it resumes begins anew: all of them are gone, and all of the
// mesh's come. With the first iteration it has seen all that it had, and points from nothing are fewer bytes than most leaves whole.
//
// Not thread-safe. Memory: about 48 bytes a leaf; a number and a hash for each unacknowledged iteration (at most `window`).

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/wire/messages.h"

namespace ridgecast::replica {

inline constexpr std::uint32_t kDefaultWindow = 4;  // iterations
// Repairs in a row, without a matching hash in between, before the client is given up.
inline constexpr int kMaxRepairs = 3;

// What the next iteration must carry. Addresses in canonical order. No leaf is in two lists, except that a client that begins anew may get
// one back that is gone.
struct Changes {
  std::uint64_t number = 0;                 // of the iteration, ascending by 1 from 1
  std::vector<lattice::LeafAddress> gone;   // held, and no longer part of the mesh
  std::vector<lattice::LeafAddress> whole;  // new, changed or requested again; leaves without triangles are held too, as empty
  // For clients that follow points, which otherwise have nothing whole.
  std::vector<lattice::LeafAddress> come;
  std::vector<lattice::LeafAddress> touched;  // held before: their points may differ
  std::vector<lattice::LeafAddress> other;    // of both: whose triangles have changed
  bool anew = false;                          // the client's points are those of the leaves that it holds then, before others come and go
  std::uint64_t meshHash = 0;                 // of what the client holds afterwards
};

enum class Verdict {
  kAgrees,      // as expected, or an iteration sent before a repair, whose hash no longer counts
  kRepairs,     // another hash: everything will be sent whole again
  kHopeless,    // another hash even after kMaxRepairs repairs
  kNeverSent,   // an iteration that was never sent
  kOutOfOrder,  // an iteration that was acknowledged before
};

class Replica {
 public:
  // window >= 1. Clients that do not follow points get everything whole.
  explicit Replica(std::uint32_t window = kDefaultWindow, bool followsPoints = false);

  // The client still holds these from an earlier connection. Only before the first send(); may come in parts. False, with nothing changed:
  // a leaf is listed twice, or there are more than wire::kMaxResumed in all.
  bool resume(std::span<const wire::HeldLeaf> leaves);
  void setFollowsPoints(bool follows) { followsPoints_ = follows; }
  // The same of a client that follows points and says only the hash of what it holds: it drops all of it with the first iteration, unless
  // that has this hash. False, with nothing changed: leaves were named, or a hash was said before.
  bool resume(std::uint64_t meshHash);
  std::uint64_t resumedHash() const { return unnamed_; }  // 0: none
  // Before the first send(): the client holds exactly these. `leaves` as in send().
  void restore(std::span<const mesh::LeafState> leaves);
  // Before the first send(): whether the client resumed at least half of these leaves, with any content, or did not say which it holds.
  bool resumes(std::span<const mesh::LeafState> leaves) const;

  // Whether another iteration may be sent: fewer than `window` are unacknowledged.
  bool hasRoom() const { return unacknowledged_.size() < window_; }
  std::uint32_t unacknowledged() const { return static_cast<std::uint32_t>(unacknowledged_.size()); }
  std::uint32_t window() const { return window_; }

  // Whether leaves were requested again and not sent since.
  bool owes() const { return owes_; }

  // Compares the mesh with what the client holds and records the difference as sent. `leaves` in canonical order, no address twice.
  // Requires hasRoom(). A leaf with unchanged content is not sent, even if its version is newer.
  Changes send(std::span<const mesh::LeafState> leaves);

  // Whether send() would carry anything, if only that the client keeps what it has not named.
  bool differs(std::span<const mesh::LeafState> leaves) const;

  // The client has applied every iteration up to `iteration` and now holds `meshHash`. Frees the window up to there. kNeverSent and
  // kOutOfOrder change nothing.
  Verdict acknowledge(std::uint64_t iteration, std::uint64_t meshHash);

  // The client lost these; empty: everything. Ignores addresses that it should not hold.
  void resend(std::span<const lattice::LeafAddress> leaves);

  std::size_t leaves() const { return held_.size(); }
  std::uint64_t meshHash() const { return meshHash_; }
  std::uint64_t lastSent() const { return lastSent_; }  // the number of the last iteration; 0: none yet

 private:
  struct Held {
    lattice::LeafAddress address;
    std::uint64_t version = 0, points = 0;
    std::uint64_t hash = 0;
    bool again = false;  // requested again
  };
  struct Sent {
    std::uint64_t number = 0;
    std::uint64_t meshHash = 0;
  };
  bool repairs(std::span<const mesh::LeafState> leaves) const;  // one of these leaves was requested again
  bool isShorterAnew(std::span<const mesh::LeafState> leaves) const;

  std::uint32_t window_;
  bool followsPoints_;
  std::vector<Held> held_;     // in canonical order
  std::vector<Held> scratch_;  // the next held_, kept for its memory
  std::deque<Sent> unacknowledged_;
  std::uint64_t lastSent_ = 0;
  std::uint64_t judgedAfter_ = 0;  // iterations up to this one were sent before a repair
  std::uint64_t meshHash_ = 0;
  std::uint64_t unnamed_ = 0;  // hash of leaves that the client holds and has not named; 0: none
  int repairs_ = 0;            // since hashes last agreed
  bool owes_ = false;
};

}  // namespace ridgecast::replica
