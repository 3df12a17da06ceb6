#pragma once
// Internal to the room: the tables of all messages (table.h), as they stand in stream.proto.

#include <numbers>

#include "common/camera/camera.h"
#include "common/terrain/materials.h"
#include "common/text/text.h"
#include "common/wire/table.h"

namespace ridgecast::wire {

// A row a line.
// clang-format off

// A field of the schema: its number, its name, the member of the value, and its rule; without one it may be anything. FIELD_OF: one whose
// table is not that of its value's type.
#define ROW(TABLE_OF_IT, NUMBER, NAME, MEMBER, ...) row<TABLE_OF_IT>(NUMBER, #NAME, rule(__VA_ARGS__), MEMBER)
#define FIELD_OF(TAG, NUMBER, NAME, MEMBER, ...) \
  ROW(TAG, NUMBER, NAME, [](auto& m) -> auto& { return m.MEMBER; } __VA_OPT__(,) __VA_ARGS__)
#define FIELD(NUMBER, NAME, MEMBER, ...) FIELD_OF(void, NUMBER, NAME, MEMBER __VA_OPT__(,) __VA_ARGS__)
// A kind of a message: an alternative of the variant. SETTINGS: one that is nothing but settings.
#define KIND(NUMBER, NAME, TYPE, ...) Choice{ROW(void, NUMBER, NAME, alternative<TYPE> __VA_OPT__(,) __VA_ARGS__), isOf<TYPE>}
#define SETTINGS(NUMBER, NAME, TYPE) \
  Choice{ROW(void, NUMBER, NAME, [](auto& m) -> auto& { return alternative<TYPE>(m).settings; }), isOf<TYPE>}
// A kind of a query, with the table of what it asks.
#define QUESTION(TAG, NUMBER, NAME, WHICH) \
  Choice{ROW(TAG, NUMBER, NAME, [](auto& m) -> auto& { return ask<WHICH>(m); }), [](const auto& m) { return m.kind == (WHICH); }}
// The table of a message, and that of a value's type; a further table of one.
#define FURTHER_TABLE(TAG, NAME, ...) struct TAG {}; template <> inline constexpr auto kTable<TAG> = table(#NAME, __VA_ARGS__)
#define TABLE(NAME, VALUE, ...) FURTHER_TABLE(NAME##Table, NAME, __VA_ARGS__); \
    template <> struct TableOf<VALUE> { using type = NAME##Table; }

// Where the value's type does not say how the schema holds a number.
struct Numbered {
  std::uint32_t number;
  Form form = Form::kOfType;
  constexpr Numbered(std::uint32_t n, Form f = Form::kOfType) : number(n), form(f) {}
};
constexpr Numbered fixed64(std::uint32_t number) { return {number, Form::kFixed64}; }
constexpr Numbered uint32(std::uint32_t number) { return {number, Form::kUnsigned}; }

template <class Inner, class Rule, class Member>
constexpr auto row(Numbered numbered, const char* name, Rule rule, Member member) {
  return Row<Inner, Rule, Member>{numbered.number, numbered.form, name, rule, member};
}

constexpr Any rule() { return {}; }
constexpr auto rule(auto given) { return given; }

template <class T>
constexpr auto isOf = [](const auto& m) { return std::holds_alternative<T>(m); };
template <class T>
constexpr auto alternative = [](auto& m) -> auto& {
  if constexpr (std::is_const_v<std::remove_reference_t<decltype(m)>>) return std::get<T>(m);
  else return m.template emplace<T>();
};
template <QueryKind kind>
Query& ask(Query& m) { return m.kind = kind, m; }
template <QueryKind>
const Query& ask(const Query& m) { return m; }

inline constexpr auto materialsAreValid = [](std::string_view names) {
  std::size_t count = 0;
  while (!names.empty())
    if (++count > terrain::kMaxOwnMaterials || !terrain::isMaterialName(text::takePart(names, ' '))) return false;
  return true;
};

inline constexpr auto kPlace = within(lattice::kMaxPosition, "steps");
inline constexpr auto kEdge = within(2 * lattice::kMaxPosition, "steps");  // of an area
inline constexpr auto kHeight = within(1e6, "m");
inline constexpr auto kRate = Range{0.0, 1000.0};
inline constexpr auto kMicroseconds = atMost(kMaxTime, "microseconds");
inline constexpr auto kLeafError = Range{0.0, 1e6, "m"};
inline constexpr auto kMs = Range{0.0, 1e15, "ms"};
inline constexpr auto kPixels = Range{1u, 32'768u, "pixels"};
inline constexpr auto kDirection = within(1e6, "");
inline constexpr Text kName{kMaxNameBytes};
inline constexpr auto kOtherVersion = EndsWhere([](const auto& m) { return m.protocolVersion != kProtocolVersion; });
inline constexpr Valid kLeaf{"a valid address", lattice::addressIsValid};
inline constexpr const char* kMetricNames[] = {"METRIC_DEFAULT", "METRIC_PIXELS", "METRIC_THESIS", "METRIC_AREA"};
inline constexpr const char* kPacingNames[] = {"PACING_FREE", "PACING_LOCKSTEP"};
inline constexpr const char* kRoleNames[] = {"ROLE_VIEWER", "ROLE_SENSOR"};
inline constexpr const char* kClockModeNames[] = {"CLOCK_REAL_TIME", "CLOCK_SCALED", "CLOCK_STEPPED"};
inline constexpr const char* kKnownNames[] = {"KNOWN_SAMPLED", "KNOWN_MEASURED", "KNOWN_PROVEN"};
inline constexpr const char* kErrorCodeNames[] = {"CODE_UNSPECIFIED", "CODE_VERSION", "CODE_MALFORMED", "CODE_INVALID",
                                                  "CODE_LIMIT", "CODE_NOT_FOUND", "CODE_INTERNAL", "CODE_GOING_AWAY"};
inline constexpr auto kPitch = Range{terrain::kMinPitch, terrain::kMaxPitch, "parts"};  // of a step, 2^20 of them
inline constexpr std::int64_t kMaxTile =
    2 * lattice::kMaxPosition / (std::int64_t{terrain::kMinPitch >> terrain::kPitchBits} << terrain::kTileBits) + 1;
inline constexpr auto kTilePlace = Range{-kMaxTile, kMaxTile, "", "on the lattice, or one beyond it"};

// ---- both ways ----

TABLE(LeafAddress, lattice::LeafAddress, FIELD(uint32(1), level, level), FIELD(2, i, i), FIELD(3, j, j));

TABLE(TileAddress, terrain::TileAddress, FIELD(1, i, i, kTilePlace), FIELD(2, j, j, kTilePlace));

TABLE(Settings, Settings,
    FIELD(1, metric, metric, OneOf{kMetricNames}),
    FIELD(2, threshold, threshold, Range{0.0, kMaxThreshold}),
    FIELD(3, triangle_budget, triangleBudget), FIELD(4, bytes_per_second, bytesPerSecond), FIELD(5, candidates, candidates),
    FIELD(6, colour_error, colourError, Range{0.0, settings::kMaxColourError}));

TABLE(Pose, PoseMessage,
    FIELD(1, sequence, sequence, atLeast(std::uint64_t{1})),
    FIELD(2, x, camera.pose.x, kPlace),
    FIELD(3, z, camera.pose.z, kPlace),
    FIELD(4, y, camera.pose.y, kHeight),
    FIELD(5, yaw, camera.pose.yaw, within(1e6, "radians")),
    FIELD(6, pitch, camera.pose.pitch, Range{-std::numbers::pi / 2 - 1e-9, std::numbers::pi / 2 + 1e-9, "radians", "within +-pi/2"}),
    FIELD(7, vertical_fov, camera.projection.verticalFov, Range{0.01, 3.0, "radians"}),
    FIELD(8, width, camera.projection.width, kPixels),
    FIELD(9, height, camera.projection.height, kPixels),
    FIELD(10, state, state, Bytes{kMaxStateBytes}));

TABLE(LeafWhole, LeafWhole,
    FIELD(1, address, address, kLeaf),
    FIELD(3, triangles, triangles, atMost(kMaxLeafTriangles, "")),
    FIELD(2, vertices, vertices),
    also("vertices", "0 without triangles, else 3 to 3 x triangles", [](const LeafWhole& m) {
      const std::uint64_t n = m.triangles;
      return n == 0 ? m.vertices == 0 : m.vertices >= 3 && m.vertices <= 3 * n;
    }),
    FIELD(4, payload, payload, Bytes{kMaxPayloadBytes}),
    also("payload", "absent exactly when there are no triangles", [](const LeafWhole& m) {
      return m.payload.empty() == (m.triangles == 0);
    }),
    FIELD(5, error, error, kLeafError),
    FIELD(20, shades, shades, Bytes{kMaxShadeBytes}));

TABLE(Moved, Moved,
    FIELD(1, camera, camera),
    FIELD(2, pose, pose, Present{}),
    FIELD(3, time, time, kMicroseconds));

// ---- client to server ----

TABLE(Hello, Hello,
    FIELD(1, protocol_version, protocolVersion),
    FIELD(2, client_name, clientName, kName),
    kOtherVersion,
    FIELD(3, settings, settings),
    FIELD(4, pacing, pacing, OneOf{kPacingNames}),
    FIELD(10, points, points),
    FIELD(6, role, role, OneOfOrFirst{kRoleNames}),
    FIELD(7, members, members), FIELD(8, clock, clock), FIELD(9, errors, errors), FIELD(11, edits, edits),
    FIELD(12, edits_after, editsAfter), FIELD(13, near, near), FIELD(14, states, states), FIELD(15, places_only, placesOnly));

TABLE(Acknowledge, Acknowledge, FIELD(1, iteration, iteration), FIELD(fixed64(2), mesh_hash, meshHash));

TABLE(ResendLeaves, ResendLeaves, FIELD(1, leaves, leaves, Entries{kMaxResendLeaves, kLeaf}));

TABLE(HeldLeaf, HeldLeaf, FIELD(1, address, address, kLeaf), FIELD(fixed64(2), hash, hash));
TABLE(Resume, Resume,
    FIELD(1, leaves, leaves, Entries{kMaxResumeLeaves}),
    FIELD(2, key, key, Bytes{kMaxResumeKeyBytes}),
    FIELD(fixed64(3), mesh_hash, meshHash));

TABLE(AskClock, AskClock, FIELD(1, echo, echo));

TABLE(SetClock, SetClock,
    FIELD(1, own, own),
    FIELD(2, mode, mode, OneOf{kClockModeNames}),
    FIELD(3, rate, rate, kRate),
    FIELD(4, time, time, kMicroseconds));

TABLE(Step, ClockStep,
    FIELD(1, time, time, Range{std::uint64_t{1}, kMaxStepTime, "microseconds"}),
    FIELD(2, wait, wait));

TABLE(StepDone, StepDone, FIELD(1, step, step));

TABLE(PassOver, PassOver, FIELD(1, camera, camera));

FURTHER_TABLE(PlacesTable, Places,
    FIELD(1, x, x, Entries{kMaxPlaces, kPlace}),
    FIELD(2, z, z, Entries{kMaxPlaces, kPlace}),
    also("z", "as many as x", [](const Query& m) { return m.x.size() == m.z.size(); }),
    FIELD(3, spacing, spacing, atMost(kMaxSpacing, "steps")));

TABLE(Ray, Ray,
    FIELD(1, x, x, kPlace),
    FIELD(2, z, z, kPlace),
    FIELD(3, y, y, kHeight),
    FIELD(4, direction_x, directionX, kDirection),
    FIELD(5, direction_y, directionY, kDirection),
    FIELD(6, direction_z, directionZ, kDirection),
    also("direction_x", "at least 1e-6 in size, or one of the others", [](const Ray& m) {
      return std::max({std::abs(m.directionX), std::abs(m.directionY), std::abs(m.directionZ)}) >= 1e-6;
    }),
    FIELD(7, reach, reach, Range{0.0, kMaxReach, "m"}));
FURTHER_TABLE(RaysTable, Rays, FIELD(1, rays, rays, Entries{kMaxRays}));

TABLE(Query, Query,
    FIELD(1, id, id),
    AnyKind("kind", "heights, normals, rays or materials"),
    QUESTION(PlacesTable, 2, heights, QueryKind::kHeights),
    QUESTION(PlacesTable, 3, normals, QueryKind::kNormals),
    Excused{QUESTION(RaysTable, 4, rays, QueryKind::kRays)},
    QUESTION(PlacesTable, 5, materials, QueryKind::kMaterials));

TABLE(AskGround, AskGround,
    FIELD(1, id, id),
    FIELD(2, x, at.x, kPlace),
    FIELD(3, z, at.z, kPlace),
    FIELD(4, radius, radius, Range{1.0, 4096.0, "m"}),
    FIELD(5, error, error, Range{0.02, 100.0, "m"}));

TABLE(WantTiles, WantTiles, FIELD(1, tiles, tiles, Entries{kMaxTiles}));

TABLE(Edit, Edit,
    FIELD(1, id, id),
    FIELD(2, key, key, Text{kMaxEditKeyBytes}),
    FIELD(3, operation, operation, Bytes{kMaxClientMessageBytes}));

TABLE(FindEdits, FindEdits,
    FIELD(1, x, at.x, kPlace),
    FIELD(2, z, at.z, kPlace),
    FIELD(3, radius, radius, Range{0.0, kMaxReach, "m"}),
    FIELD(4, since, since));

TABLE(WantSquares, WantSquares, FIELD(1, squares, squares, Entries{kMaxSquares}));

TABLE(ClientMessage, ClientMessage,
    KIND(1, hello, Hello), KIND(2, pose, PoseMessage), KIND(3, acknowledge, Acknowledge), KIND(4, resend_leaves, ResendLeaves),
    KIND(5, resume, Resume), KIND(6, ask_clock, AskClock), KIND(7, set_clock, SetClock), KIND(8, step, ClockStep),
    KIND(9, step_done, StepDone), KIND(10, query, Query), KIND(11, ask_ground, AskGround), KIND(20, want_tiles, WantTiles),
    SETTINGS(21, change_settings, ChangeSettings), KIND(22, pass_over, PassOver), KIND(23, edit, Edit),
    KIND(24, find_edits, FindEdits), KIND(25, want_squares, WantSquares));

// ---- server to client ----

TABLE(HeightMap, terrain::RasterShape,
    FIELD(10, pitch_x, x.pitch, kPitch),
    FIELD(11, pitch_z, z.pitch, kPitch),
    FIELD(2, origin_x, x.origin, kPlace),
    FIELD(3, origin_z, z.origin, kPlace),
    FIELD(4, width, width, atLeast(2u)),
    FIELD(5, height, height, atLeast(2u)),
    FIELD(6, lowest, lowest, within(terrain::kMaxSample, "steps")),
    FIELD(7, highest, highest, within(terrain::kMaxSample, "steps")),
    also("highest", "no lower than lowest", [](const terrain::RasterShape& m) { return m.lowest <= m.highest; }),
    FIELD(fixed64(8), content, content),
    FIELD(9, draped, draped));

TABLE(World, World,
    FIELD(1, protocol_version, protocolVersion),
    FIELD(2, server_name, serverName, kName),
    kOtherVersion,
    FIELD(3, session, session, Valid{"1 to 64 of A-Z a-z 0-9 . _ -", sessionNameIsValid}),
    FIELD(4, terrain_name, terrainName, kName),
    FIELD(5, terrain_source, terrainSource, Bytes{kMaxTerrainSourceBytes}),
    FIELD(6, seed, seed), FIELD(fixed64(7), content_hash, contentHash),
    FIELD(8, step_bits, stepBits, Range{unsigned{lattice::kStepBits}, unsigned{lattice::kStepBits}}),
    FIELD(9, horizon, horizon, Range{1.0, kMaxHorizon, "m"}),
    FIELD(10, settings, settings),
    FIELD(11, window, window, Range{1u, kMaxWindow}),
    FIELD(12, camera, camera), FIELD(13, revision, revision), FIELD(20, height_map, heightMap), FIELD(21, shaded_vertices, shadedVertices),
    FIELD(22, edit, edit), FIELD(23, compacted, compacted),
    FIELD(24, resume_key, resumeKey, Bytes{kMaxResumeKeyBytes}),
    FIELD(25, materials, materials, Valid{"at most 64 names of 1 to 32 of a-z 0-9 _ -, by spaces", materialsAreValid}),
    FIELD(26, known, known, OneOfOrFirst{{kKnownNames}}));

TABLE(Figures, IterationStats,
    FIELD(1, select_ms, selectMs, kMs),
    FIELD(2, generate_ms, generateMs, kMs),
    FIELD(3, refine_ms, refineMs, kMs),
    FIELD(4, triangulate_ms, triangulateMs, kMs),
    FIELD(5, encode_ms, encodeMs, kMs),
    FIELD(7, valid_leaves, leaves), FIELD(6, leaves, leaves),  // one number; the second is what is read
    FIELD(8, visible_leaves, visibleLeaves), FIELD(9, generated_leaves, generatedLeaves), FIELD(10, dropped_leaves, droppedLeaves),
    FIELD(11, triangles, triangles), FIELD(12, inserted, inserted), FIELD(13, removed, removed), FIELD(14, deferred, deferred),
    FIELD(15, heights, heights),
    FIELD(16, effective_threshold, effectiveThreshold, Range{0.0, 1e15}), FIELD(17, insertion_limit, insertionLimit));

// Points are counted from (x, z). Those of a camera lie within twice the horizon of each other, far below kMaxCandidateReach.
struct SentCandidates {
  lattice::Step x = 0, z = 0;
  std::vector<std::int32_t> points{};
  std::vector<float> errors{};

  SentCandidates() = default;
  explicit SentCandidates(const std::vector<Candidate>& in) {
    if (in.empty()) return;
    x = in.front().at.x, z = in.front().at.z;
    points.reserve(3 * in.size());
    errors.reserve(in.size());
    for (const Candidate& c : in) {
      points.insert(points.end(), {static_cast<std::int32_t>(c.at.x - x), static_cast<std::int32_t>(c.at.z - z), c.at.y});
      errors.push_back(c.pixels);
    }
  }
  static std::size_t mostBytes(const std::vector<Candidate>& in) { return 50 + 19 * in.size(); }  // three numbers of 5 bytes and a float
  std::vector<Candidate> value() const {
    std::vector<Candidate> out;
    out.reserve(errors.size());
    for (std::size_t k = 0; k < errors.size(); ++k)
      out.push_back({{x + points[3 * k], z + points[3 * k + 1], points[3 * k + 2]}, errors[k]});
    return out;
  }
  bool isValid() const {
    if (points.size() != 3 * errors.size()) return false;
    const auto reach = within(kMaxCandidateReach, "");
    for (std::size_t k = 0; k < points.size(); k += 3)
      if (!reach.holds(points[k]) || !reach.holds(points[k + 1]) || !lattice::positionIsValid(x + points[k], z + points[k + 1]) ||
          !within(lattice::kMaxHeight, "").holds(points[k + 2]))
        return false;
    return true;
  }
};

TABLE(Candidates, SentCandidates,
    FIELD(1, x, x, kPlace),
    FIELD(2, z, z, kPlace),
    FIELD(3, points, points, Entries{3 * kMaxCandidates}),
    FIELD(4, errors, errors, Entries{kMaxCandidates, Range{0.0, kMaxErrorPixels, "pixels"}}),
    also("points", "x, z, y for each error: x and z within +-2^27 steps of the message's and on the lattice, y within +-2^25 steps",
         [](const SentCandidates& m) { return m.isValid(); }));

TABLE(Iteration, Iteration,
    FIELD(1, number, number, atLeast(std::uint64_t{1})),
    FIELD(2, pose_sequence, poseSequence),
    FIELD(3, gone, gone, Entries{kMaxIterationLeaves, kLeaf}),
    FIELD(4, whole, whole, Entries{kMaxIterationLeaves}),
    FIELD(10, come, come, Entries{kMaxIterationLeaves, kLeaf}),
    FIELD(11, points, points, Bytes{kMaxPayloadBytes}),
    FIELD(12, errors, errors, Entries{kMaxIterationLeaves, kLeafError}),
    FIELD(13, shades, shades, Bytes{kMaxShadeBytes}),
    FIELD(fixed64(5), mesh_hash, meshHash), FIELD(6, settled, settled), FIELD(7, figures, figures), FIELD(14, edit, edit),
    sentAs<SentCandidates>(FIELD(9, candidates, candidates, Encoded{kMaxCandidatesBytes})));

TABLE(Error, ErrorMessage,
    FIELD(1, code, code, OneOfOrFirst{kErrorCodeNames}),
    Cut{FIELD(2, message, message, Bytes{kMaxErrorBytes})},
    Cut{FIELD(3, reconnect_url, reconnectUrl, Bytes{kMaxErrorBytes})});

FURTHER_TABLE(MovedOfMemberTable, Moved,
    FIELD(2, pose, pose, Present{}),
    FIELD(3, time, time, kMicroseconds));
TABLE(Member, Member,
    FIELD(1, camera, camera),
    FIELD(2, role, role, OneOfOrFirst{kRoleNames}),
    FIELD(3, name, name, kName),
    FIELD_OF(MovedOfMemberTable, 4, moved, moved),
    FIELD(5, clock, clock),
    Then([](Member& m) { if (m.moved) m.moved->camera = m.camera; }));

inline constexpr std::int64_t kMaxCell = lattice::kMaxPosition >> kCellBits;
inline constexpr auto kCell = within(kMaxCell, "");
TABLE(Crowd, Crowd,
    FIELD(1, level, level, atMost(kMaxCrowdLevel, "")),
    FIELD(2, i, i, Entries{kMaxCells, kCell}),
    FIELD(3, j, j, Entries{kMaxCells, kCell}),
    FIELD(4, count, count, Entries{kMaxCells}),
    also("count", "as many as i and j", [](const Crowd& m) { return m.i.size() == m.j.size() && m.i.size() == m.count.size(); }));
TABLE(Members, Members,
    FIELD(1, joined, joined, Entries{kMaxMembers}),
    FIELD(2, moved, moved, Entries{kMaxMembers}),
    FIELD(3, left, left, Entries{kMaxMembers}),
    FIELD(4, others, others),
    FIELD(5, faded, faded, Entries{kMaxMembers}),
    FIELD(6, crowd, crowd));

TABLE(Clock, Clock,
    FIELD(1, mode, mode, OneOf{kClockModeNames}),
    FIELD(2, rate, rate, kRate),
    FIELD(3, time, time, kMicroseconds),
    FIELD(4, owner, owner), FIELD(5, step, step),
    FIELD(6, waits_for, waitsFor, Entries{kMaxMembers}),
    FIELD(7, echo, echo),
    FIELD(8, notice, notice, Bytes{kMaxErrorBytes}),
    FIELD(9, end, end, kMicroseconds),
    FIELD(10, refuses, refuses));

TABLE(Answer, Answer,
    FIELD(1, id, id),
    FIELD(2, heights, heights, Entries{kMaxPlaces}),
    FIELD(3, normals, normals, Entries{3 * kMaxPlaces}),
    FIELD(4, distances, distances, Entries{kMaxRays}),
    FIELD(5, refusal, refusal, Bytes{kMaxErrorBytes}), FIELD(6, edit, edit),
    FIELD(7, materials, materials, Bytes{kMaxPlaces}));

TABLE(Ground, Ground,
    FIELD(1, id, id),
    FIELD(2, error, error, kLeafError),
    FIELD(3, leaves, leaves, Entries{kMaxIterationLeaves}),
    FIELD(4, refusal, refusal, Bytes{kMaxErrorBytes}), FIELD(5, edit, edit));

TABLE(EditAnswer, EditAnswer,
    FIELD(1, id, id),
    FIELD(2, number, number),
    FIELD(3, refusal, refusal, Bytes{kMaxErrorBytes}));

TABLE(MadeEdit, MadeEdit,
    FIELD(1, number, number, atLeast(std::uint64_t{1})),
    FIELD(2, author, author, kName),
    FIELD(8, name, name, kName),
    FIELD(3, operation, operation, Bytes{kMaxSmallMessageBytes}),
    FIELD(4, x0, ground.x0, kEdge), FIELD(5, z0, ground.z0, kEdge), FIELD(6, x1, ground.x1, kEdge), FIELD(7, z1, ground.z1, kEdge));
TABLE(Edited, Edited,
    FIELD(1, edits, edits, Entries{kMaxMadeEdits}),
    also("edits", "numbered without gaps", [](const Edited& m) {
      for (std::size_t k = 1; k < m.edits.size(); ++k)
        if (m.edits[k].number != m.edits[k - 1].number + 1) return false;
      return true;
    }));

TABLE(Area, lattice::Area, FIELD(1, x0, x0, kEdge), FIELD(2, z0, z0, kEdge), FIELD(3, x1, x1, kEdge), FIELD(4, z1, z1, kEdge));
TABLE(FoundEdits, FoundEdits,
    FIELD(1, edit, edit),
    FIELD(2, changed, changed, Entries{kMaxFoundAreas}),
    FIELD(3, squares, squares, Entries{kMaxFoundSquares}));

TABLE(Square, Square,
    FIELD(1, address, address),
    FIELD(2, rises, rises, Bytes{terrain::kMaxTileBytes}),
    FIELD(3, materials, materials, Bytes{terrain::kMaxTileBytes}));
TABLE(Squares, Squares, FIELD(1, edit, edit), FIELD(2, squares, squares, Entries{kMaxSquares}));

TABLE(HeightTile, HeightTile,
    FIELD(1, address, address),
    FIELD(2, samples, samples, Bytes{terrain::kMaxTileBytes}),
    FIELD(3, colours, colours, Bytes{terrain::kTileColourBytes}));
TABLE(HeightTiles, HeightTiles, FIELD(1, tiles, tiles, Entries{kMaxTiles}));

TABLE(ServerMessage, ServerMessage,
    KIND(1, world, World), KIND(2, iteration, Iteration), KIND(3, error, ErrorMessage),
    KIND(4, members, Members, Encoded{kMaxSmallMessageBytes}),
    KIND(5, clock, Clock, Encoded{kMaxSmallMessageBytes}),
    KIND(6, answer, Answer, Encoded{kMaxSmallMessageBytes}),
    KIND(7, ground, Ground),
    KIND(8, edit_answer, EditAnswer),
    KIND(9, edited, Edited, Encoded{kMaxSmallMessageBytes}),
    KIND(10, found_edits, FoundEdits), KIND(11, squares, Squares),
    KIND(20, height_tiles, HeightTiles), SETTINGS(21, granted, Granted));

}  // namespace ridgecast::wire
