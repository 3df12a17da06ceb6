#pragma once
// The messages of the stream as plain values. wire.h turns them into bytes and back.
// Units and meaning are those of proto/ridgecast/v1/stream.proto.

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/camera/camera.h"
#include "common/ground/ground.h"
#include "common/lattice/lattice.h"
#include "common/settings/settings.h"
#include "common/terrain/raster.h"

namespace ridgecast::wire {

inline constexpr std::uint32_t kProtocolVersion = 1;
// Of that version. 1: members, clock, queries and grounds are known; 2: changes of settings; 3: passing over; 4: edits; 5: their posts; 6:
// a clock that is set to a time; 7: a resume by its hash, near members, crowds, and members that only place themselves.
inline constexpr std::uint32_t kRevision = 8;

using lattice::Candidate;
using settings::IterationStats;
using settings::kMaxCandidates;
using settings::Metric;
using settings::Settings;
enum class Pacing { kFree = 0, kLockstep = 1 };
enum class Role { kViewer = 0, kSensor = 1 };
enum class ClockMode { kRealTime = 0, kScaled = 1, kStepped = 2 };

struct Hello {
  std::uint32_t protocolVersion = kProtocolVersion;
  std::string clientName{};
  Settings settings{};
  Pacing pacing = Pacing::kFree;
  bool points = false;  // the client follows Iteration::points
  Role role = Role::kViewer;
  bool members = false;  // wants Members
  bool clock = false;    // wants Clock, and answers steps that wait
  bool errors = false;   // wants the error of every leaf
  bool edits = false;    // wants Edited
  std::uint64_t editsAfter = 0;
  std::uint32_t near = 0;   // wants at most this many members told often, and far ones as counts; 0: wants each, with its state
  bool states = false;      // with near: wants the others' states
  bool placesOnly = false;  // wants no iterations: its poses only say where it is
};

struct PoseMessage {
  std::uint64_t sequence = 0;
  camera::Camera camera;
  std::vector<std::uint8_t> state{};  // what the member tells the others of itself; at most kMaxStateBytes
  friend bool operator==(const PoseMessage&, const PoseMessage&) = default;
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

// After hello and before the first pose: what is still held of an earlier connection. Either the leaves, or the hash of all of them.
struct Resume {
  std::vector<HeldLeaf> leaves;
  std::string key;             // World::resumeKey of that connection
  std::uint64_t meshHash = 0;  // of leaves that are not named; 0: none are held but those named
};

struct AskClock {
  std::uint64_t echo = 0;
};

struct SetClock {
  bool own = true;
  ClockMode mode = ClockMode::kRealTime;
  double rate = 1;         // kScaled
  std::uint64_t time = 0;  // microseconds; 0: no jump
};

struct ClockStep {
  std::uint64_t time = 0;  // microseconds
  bool wait = false;
};

struct StepDone {
  std::uint64_t step = 0;
};

// The clock's owner no longer waits for this member.
struct PassOver {
  std::uint64_t camera = 0;
};

enum class QueryKind { kHeights, kNormals, kRays, kMaterials };

using ground::Ray;

struct Query {
  std::uint64_t id = 0;
  QueryKind kind = QueryKind::kHeights;
  std::vector<lattice::Step> x, z;  // heights, normals, materials: equally many of both
  std::uint32_t spacing = 0;        // normals: steps; 0: the default
  std::vector<Ray> rays;
  std::string refusal{};  // of a decoded one: which of its rays' fields is out of range; it gets no other answer
};

struct AskGround {
  std::uint64_t id = 0;
  lattice::Point at;
  double radius = 0, error = 0;  // metres
};

// Tiles of World::heightMap that the client would like to hold.
struct WantTiles {
  std::vector<terrain::TileAddress> tiles;
};

// Other settings than hello's, from the next iteration on. Answered by Granted.
struct ChangeSettings {
  Settings settings;
};

// Changes the ground for everybody; answered by EditAnswer.
struct Edit {
  std::uint64_t id = 0;
  std::string key;        // at most kMaxEditKeyBytes; an edit resent with its key is made once
  std::string operation;  // edits::fromJson
};

// Where has the ground changed? Answered by FoundEdits.
struct FindEdits {
  lattice::Point at;
  double radius = 0;        // metres: which squares within it have edits; 0: none are named
  std::uint64_t since = 0;  // an edit
};

// Squares of posts (edits::Square) that the client would like to hold.
struct WantSquares {
  std::vector<terrain::TileAddress> squares;
};

using ClientMessage = std::variant<Hello, PoseMessage, Acknowledge, ResendLeaves, Resume, AskClock, SetClock, ClockStep, StepDone, Query,
                                   AskGround, WantTiles, ChangeSettings, PassOver, Edit, FindEdits, WantSquares>;

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
  Settings settings{};
  std::uint32_t window = 0;
  std::uint64_t camera = 0;
  std::uint32_t revision = kRevision;
  std::optional<terrain::RasterShape> heightMap{};  // nothing: heights are a formula, or private
  bool shadedVertices = false;                      // colours and normals travel with the vertices
  std::uint64_t edit = 0;                           // the last of the ground
  std::uint64_t compacted = 0;                      // edits up to this one are never sent
  std::string resumeKey{};                          // names this camera to the server that goes on with it; empty: none would
  std::string materials{};                          // the terrain's own, by spaces (terrain/materials.h)
  terrain::Relief::Known known{};                   // of heights between places, for rays
  // Where a client that asked for no place starts, instead of `at`: a map may lie elsewhere (place=geo).
  lattice::Point onMap(lattice::Point at) const { return heightMap && !heightMap->area().holds(at) ? heightMap->middle() : at; }
};

struct LeafWhole {
  lattice::LeafAddress address;
  std::uint32_t vertices = 0, triangles = 0;
  std::vector<std::uint8_t> payload;   // empty when the leaf is held and empty
  float error = 0;                     // metres; 0 when it was not asked for
  std::vector<std::uint8_t> shades{};  // terrain::Shade of every vertex, where World::shadedVertices; else empty
};

struct Iteration {
  std::uint64_t number = 0;
  std::uint64_t poseSequence = 0;
  std::vector<lattice::LeafAddress> gone;
  std::vector<LeafWhole> whole;
  std::vector<lattice::LeafAddress> come;  // held from now on, made by points
  std::vector<std::uint8_t> points;        // common/points; empty for clients that do not follow them
  std::vector<float> errors;               // LeafWhole::error of the leaves that points made or changed, in canonical order
  std::vector<std::uint8_t> shades;        // terrain::Shade of the points that came or were raised, where World::shadedVertices
  std::uint64_t meshHash = 0;
  bool settled = false;
  std::uint64_t edit = 0;  // the last that the mesh knows
  IterationStats figures;
  std::optional<std::vector<Candidate>> candidates{};  // the worst first; nothing: the previous ones stay, if requested
};

enum class ErrorCode {
  kUnspecified = 0,
  kVersion = 1,
  kMalformed = 2,
  kInvalid = 3,
  kLimit = 4,
  kNotFound = 5,
  kInternal = 6,
  kGoingAway = 7
};

struct ErrorMessage {
  ErrorCode code = ErrorCode::kUnspecified;
  std::string message;
  std::string reconnectUrl{};  // kGoingAway: where to connect again; empty: where the client came from
};

struct Moved {
  std::uint64_t camera = 0;
  PoseMessage pose;
  std::uint64_t time = 0;  // session time when the server received it, microseconds
  friend bool operator==(const Moved&, const Moved&) = default;
};

struct Member {
  std::uint64_t camera = 0;
  Role role = Role::kViewer;
  std::string name;
  std::optional<Moved> moved;  // nothing until it has sent a pose; its `camera` is the member's
  bool clock = false;          // follows the clock
  friend bool operator==(const Member&, const Member&) = default;
};

// How many members are where, all of the session that have a place.
struct Crowd {
  std::uint32_t level = 0;             // a cell's side: 256 m x 2^level
  std::vector<std::int64_t> i{}, j{};  // the cell's least x and z in sides
  std::vector<std::uint32_t> count{};  // of that cell; as many as i and j
  friend bool operator==(const Crowd&, const Crowd&) = default;
};

// How the other members changed: joined, then moved, then left or faded.
struct Members {
  std::vector<Member> joined{};
  std::vector<Moved> moved{};
  std::vector<std::uint64_t> left{};
  std::uint32_t others = 0;            // with Hello::near: in the session now, named here or not
  std::vector<std::uint64_t> faded{};  // still there, but not named any longer
  std::optional<Crowd> crowd{};        // replaces the last one
};

struct Clock {
  ClockMode mode = ClockMode::kRealTime;
  double rate = 1;          // session seconds a second; 0 when it is stepped
  std::uint64_t time = 0;   // microseconds, when it was sent
  std::uint64_t owner = 0;  // 0: none
  std::uint64_t step = 0;
  std::vector<std::uint64_t> waitsFor{};
  std::uint64_t echo = 0;
  std::string notice{};   // one sentence for a person; mostly empty
  std::uint64_t end = 0;  // microseconds, of a recording; 0: it is none
  bool refuses = false;   // what this member said last has no effect: `notice` says why
};

struct Answer {
  std::uint64_t id = 0;
  std::vector<float> heights{};           // metres
  std::vector<float> normals{};           // x, y, z of each
  std::vector<double> distances{};        // metres; -1: none
  std::vector<std::uint8_t> materials{};  // terrain/materials.h
  std::string refusal{};                  // why there is no answer; then nothing else is set
  std::uint64_t edit = 0;                 // the last that it knows
};

struct Ground {
  std::uint64_t id = 0;
  double error = 0;  // metres
  std::vector<LeafWhole> leaves;
  std::string refusal{};   // as Answer's
  std::uint64_t edit = 0;  // as Answer's
};

struct EditAnswer {
  std::uint64_t id = 0;
  std::uint64_t number = 0;  // 0: refused
  std::string refusal{};
};

struct MadeEdit {
  std::uint64_t number = 0;
  std::string author;     // the client as the server knows it
  std::string name;       // what it calls itself
  std::string operation;  // JSON
  lattice::Area ground;   // bounds what it changed
};
struct Edited {
  std::vector<MadeEdit> edits;  // numbers ascend by 1
};

struct FoundEdits {
  std::uint64_t edit = 0;                     // the last that it knows
  std::vector<lattice::Area> changed;         // since FindEdits::since
  std::vector<terrain::TileAddress> squares;  // that have edits, the nearest first
};

struct Square {
  terrain::TileAddress address;
  std::vector<std::uint8_t> rises, materials;  // edits::encode
};
struct Squares {
  std::uint64_t edit = 0;  // the last that they know
  std::vector<Square> squares;
};

struct HeightTile {
  terrain::TileAddress address;
  std::vector<std::uint8_t> samples;    // terrain::encodeTile
  std::vector<std::uint8_t> colours{};  // terrain::Raster::tileColours
};
struct HeightTiles {
  std::vector<HeightTile> tiles;
};

// Precedes the first iteration made by it.
struct Granted {
  Settings settings;
};

struct UnknownKind {};  // of a later revision: to be ignored

using ServerMessage = std::variant<World, Iteration, ErrorMessage, Members, Clock, Answer, Ground, HeightTiles, Granted, EditAnswer, Edited,
                                   FoundEdits, Squares, UnknownKind>;

}  // namespace ridgecast::wire
