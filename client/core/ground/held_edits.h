#pragma once
// The edited ground that a client holds: squares of posts around the camera, fetched nearest first, and again when an edit changes them.
// Not thread-safe; one owner. No OpenGL, no sockets.
//
// Bounds: the kMaxHeld nearest squares that have edits (64 m a side; 83 MiB at most). Beyond them the ground here is the terrain's own,
// although the mesh has the edits.

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "common/edits/layer.h"
#include "common/edits/square.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

class HeldEdits {
 public:
  static constexpr std::size_t kMaxHeld = 1024;
  static constexpr std::size_t kMaxPending = 64;  // requests for squares

  explicit HeldEdits(double reach) : reach_(reach) {}  // metres around the camera

  void moveTo(lattice::Point camera);
  // The session has this edit.
  void know(std::uint64_t edit);
  // A new connection to the session, whose last edit is this: forgets pending requests and fetches everything again, since the session may
  // have ended and its edits started over. What is held stays until then.
  void reconnected(std::uint64_t edit);

  // Requests to send now; pending until their answers are put.
  struct Questions {
    std::optional<wire::FindEdits> find;
    wire::WantSquares want;
  };
  Questions take();
  // Error: undecodable, or not requested.
  Outcome<void> put(const wire::FoundEdits& found);
  Outcome<void> put(const wire::Squares& squares);

  // Everything around the camera is held, as of the last edit that is known.
  bool complete() const;
  std::uint64_t known() const { return edit_; }       // changes up to this edit are known
  std::uint64_t version() const { return version_; }  // grows when what is held changes
  const std::shared_ptr<const edits::Layer>& layer() const { return layer_; }
  // Those that have posts, each with a number that grows when it changes.
  const std::map<edits::SquareAddress, std::uint64_t>& squares() const { return squares_; }

 private:
  struct Known {
    std::uint64_t needs = 0;            // good as of this edit
    std::optional<std::uint64_t> held;  // is good as of this one
    bool isOld = false;                 // of an earlier connection
    bool good() const { return held && !isOld && *held >= needs; }
  };
  void changed(const lattice::Area& area, std::uint64_t edit);
  void name(const lattice::Area& area, std::uint64_t edit);
  void sort();
  void drop(edits::SquareAddress address);
  double distance(edits::SquareAddress address) const;

  double reach_;
  lattice::Point camera_;
  std::optional<lattice::Point> foundAt_;        // where squares were looked for last
  bool finding_ = false, named_ = false;         // FindEdits is pending; it asks for squares
  std::uint64_t last_ = 0, edit_ = 0;            // of the session; changes up to this one are known here
  std::map<edits::SquareAddress, Known> known_;  // that have edits, or may: at most twice wire::kMaxFoundSquares
  std::vector<edits::SquareAddress> nearest_;    // of these the nearest, to be held
  bool sorted_ = true;
  std::set<edits::SquareAddress> pending_;
  std::map<edits::SquareAddress, std::uint64_t> squares_;
  std::shared_ptr<const edits::Layer> layer_ = std::make_shared<const edits::Layer>();
  std::uint64_t version_ = 0;
};

}  // namespace ridgecast::core
