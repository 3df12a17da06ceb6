#pragma once
// What a recording holds: every input of a session that determines its meshes, in the order in which it took effect.
//
// A camera's mesh is a function of its inputs alone: the ground it begins on and the settings it was granted (Joined), then for each
// iteration the settings, bound, ground and camera that it was given (Iterated), and the edits that make the ground (Edited). Threads and
// time do not affect it, so repeating these calls gives the same hashes. The clock and the questions are for people and onlookers.

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/camera/camera.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/outcome/outcome.h"
#include "common/settings/settings.h"
#include "common/wire/messages.h"

namespace ridgecast::recording {

// What the session's ground is made of; the first record of every part.
struct World {
  std::string session, terrain;  // terrain by name
  std::uint32_t seed = 1;
  std::vector<std::pair<std::string, double>> parameters{};  // those that differ from the terrain's defaults
  std::uint64_t contentHash = 0;                             // terrain::contentHash, without edits
  bool colours = false;                                      // the terrain was made with colours (glsl::Build::colours)
  std::string server{};                                      // name and version of the program that recorded
  std::int64_t began = 0;                                    // microseconds since 1970
  friend bool operator==(const World&, const World&) = default;
};

// A camera's mesh begins, on the ground of this edit. Again: the mesh is older than the part of the recording that says so.
struct Joined {
  std::uint64_t camera = 0;
  std::string name;
  wire::Role role = wire::Role::kViewer;
  wire::Pacing pacing = wire::Pacing::kFree;
  settings::Settings granted{};
  std::uint64_t edit = 0;
  bool again = false;
  friend bool operator==(const Joined&, const Joined&) = default;
};

struct Left {
  std::uint64_t camera = 0;
  friend bool operator==(const Left&, const Left&) = default;
};

// One iteration: its inputs in the order in which the mesh took them, and the hash of the mesh after it.
struct Iterated {
  std::uint64_t camera = 0;
  std::optional<settings::Settings> granted{};  // changed before this iteration
  std::uint32_t insertions = 0;                 // the bound that held, as IterationStats::insertionLimit
  std::uint64_t edit = 0;                       // of the ground
  std::vector<lattice::Area> changed{};         // where the ground differs from that of the iteration before, as setGround was told
  std::uint64_t pose = 0;                       // sequence
  camera::Camera view{};
  bool settled = false;
  // hashOf the leaves. Of an iteration at the pose of the one before, the low half alone is kept; the high half is then 0.
  std::uint64_t hash = 0;
  friend bool operator==(const Iterated&, const Iterated&) = default;
};

struct Edited {
  std::uint64_t number = 0;
  std::string author, operation;  // as edit_store::Applied; the operations of older recordings are edits::toJson
  friend bool operator==(const Edited&, const Edited&) = default;
};

inline Outcome<edits::Operation> operationOf(const Edited& edited) {
  return edited.operation.starts_with('{') ? edits::fromJson(edited.operation) : edits::unpack(edited.operation);
}

// The clock after something other than the time changed it.
struct Clocked {
  wire::ClockMode mode = wire::ClockMode::kRealTime;
  double rate = 1;
  std::uint64_t time = 0, owner = 0, step = 0;  // microseconds; 0: nobody
  friend bool operator==(const Clocked&, const Clocked&) = default;
};

// A question that a member asked over the stream; they do not change the mesh.
struct Asked {
  static constexpr std::size_t kMaxBytes = 512;
  std::uint64_t camera = 0;
  std::uint32_t places = 0;  // or rays
  std::string message{};     // wire::encode of the ClientMessage; empty: it has more than kMaxBytes
  friend bool operator==(const Asked&, const Asked&) = default;
};

// A part begins on the ground of this edit, which is in the file of edits (reader.h) with those before it. A Reader gives those instead.
struct EditsBefore {
  std::uint64_t number = 0;
  friend bool operator==(const EditsBefore&, const EditsBefore&) = default;
};

using Event = std::variant<World, Joined, Left, Iterated, Edited, Clocked, Asked, EditsBefore>;

struct Record {
  std::int64_t time = 0;  // microseconds since the recording began
  Event event;
  friend bool operator==(const Record&, const Record&) = default;
};

// A mesh's hash, by its leaves.
inline std::uint64_t hashOf(std::span<const mesh::LeafState> leaves) {
  std::uint64_t hash = 0;
  for (const mesh::LeafState& leaf : leaves) hash += mesh::hashTerm(leaf.address, leaf.hash);
  return hash;
}

// Told of a session's events as they take effect: an edit before it is in anybody's ground, an iteration after it was made. Any thread;
// never waits. A session without one is not recorded.
class Observer {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  virtual ~Observer() = default;
  virtual void note(Instant when, Event event) = 0;
};

}  // namespace ridgecast::recording
