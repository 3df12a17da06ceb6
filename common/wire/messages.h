#pragma once
// The messages of the stream as plain values. wire.h turns them into bytes and back; nothing else sees generated code.
// Units and meaning are those of proto/ridgecast/v1/stream.proto.

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"

namespace ridgecast::wire {

inline constexpr std::uint32_t kProtocolVersion = 1;

enum class Metric { kDefault = 0, kPixels = 1, kThesis = 2 };
enum class Pacing { kFree = 0, kLockstep = 1 };

struct Settings {
  Metric metric = Metric::kDefault;
  double threshold = 0;              // 0: the default of the metric
  std::uint32_t triangleBudget = 0;  // 0: the server's default
  std::uint64_t bytesPerSecond = 0;  // 0: as many as there are
};

struct Hello {
  std::uint32_t protocolVersion = kProtocolVersion;
  std::string clientName;
  Settings settings;
  Pacing pacing = Pacing::kFree;
  bool deltas = true;  // the client applies Iteration::changed
};

struct PoseMessage {
  std::uint64_t sequence = 0;
  camera::Camera camera;  // checked with camera::isValid when decoded
};

struct Acknowledge {
  std::uint64_t iteration = 0;
  std::uint64_t meshHash = 0;
};

struct ResendLeaves {
  std::vector<lattice::LeafAddress> leaves;
};

struct HeldLeaf {
  lattice::LeafAddress address;
  std::uint64_t hash = 0;
};

// After hello and before the first pose: what is still held of an earlier connection.
struct Resume {
  std::vector<HeldLeaf> leaves;
};

using ClientMessage = std::variant<Hello, PoseMessage, Acknowledge, ResendLeaves, Resume>;

struct World {
  std::uint32_t protocolVersion = kProtocolVersion;
  std::string serverName;
  std::string session;
  std::string terrainName;
  std::string terrainSource;
  std::uint32_t seed = 0;
  std::uint64_t contentHash = 0;
  std::uint32_t stepBits = lattice::kStepBits;
  double horizon = 0;  // metres
  Settings settings;
  std::uint32_t window = 0;
  std::uint64_t camera = 0;
};

// What an iteration did. Milliseconds are wall time.
struct Figures {
  double selectMs = 0, generateMs = 0, refineMs = 0, triangulateMs = 0, encodeMs = 0;
  std::uint32_t leaves = 0, validLeaves = 0, visibleLeaves = 0, generatedLeaves = 0, droppedLeaves = 0;
  std::uint32_t triangles = 0, inserted = 0, removed = 0, deferred = 0;
  std::uint64_t heights = 0;
  double effectiveThreshold = 0;
};

struct LeafWhole {
  lattice::LeafAddress address;
  std::uint32_t vertices = 0, triangles = 0;
  std::vector<std::uint8_t> payload;  // empty when the leaf is held and empty
};

// Made from the leaf that is held, or, where leaves split or merged, from those that are gone (mesh::gather).
struct LeafDelta {
  lattice::LeafAddress address;
  std::vector<std::uint8_t> payload;  // empty: the triangles stay as they are
};

struct Iteration {
  std::uint64_t number = 0;
  std::uint64_t poseSequence = 0;
  std::vector<lattice::LeafAddress> gone;
  std::vector<LeafWhole> whole;
  std::vector<LeafDelta> changed;
  std::uint64_t meshHash = 0;
  bool settled = false;
  Figures figures;
};

enum class ErrorCode { kUnspecified = 0, kVersion = 1, kMalformed = 2, kInvalid = 3, kLimit = 4, kNotFound = 5, kInternal = 6 };

struct ErrorMessage {
  ErrorCode code = ErrorCode::kUnspecified;
  std::string message;
};

using ServerMessage = std::variant<World, Iteration, ErrorMessage>;

}  // namespace ridgecast::wire
