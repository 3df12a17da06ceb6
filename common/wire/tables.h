#pragma once
// Internal to the room: the tables of all messages (table.h), as they stand in stream.proto.

#include <numbers>

#include "common/camera/camera.h"
#include "common/wire/table.h"
#include "ridgecast/v1/stream.pb.h"

namespace ridgecast::wire {

namespace pb = ridgecast::v1;

// A row a line.
// clang-format off

#define ROW(NAME, MEMBER, ...) Row{#NAME, rule(__VA_ARGS__), MEMBER, [](const auto& p) -> decltype(auto) { return p.NAME(); }, \
    [](auto& p) { return p.mutable_##NAME(); }, [](const auto& p) { return p.has_##NAME(); }, [](auto& p, auto v) { p.set_##NAME(v); }}
// A field of the schema, the member of the value, and its rule; without one it may be anything.
#define FIELD(NAME, MEMBER, ...) ROW(NAME, [](auto& m) -> auto& { return m.MEMBER; } __VA_OPT__(,) __VA_ARGS__)
// A kind of a message: an alternative of the variant. SETTINGS: one that is nothing but settings.
#define KIND(NAME, TYPE, ...) Choice{ROW(NAME, alternative<TYPE> __VA_OPT__(,) __VA_ARGS__), isOf<TYPE>}
#define SETTINGS(NAME, TYPE) Choice{ROW(NAME, [](auto& m) -> auto& { return alternative<TYPE>(m).settings; }), isOf<TYPE>}
// A kind of a query.
#define QUESTION(NAME, WHICH) \
  Choice{ROW(NAME, [](auto& m) -> auto& { return ask<WHICH>(m); }), [](const auto& m) { return m.kind == (WHICH); }}
// A field that is judged, and read elsewhere.
#define JUDGED(NAME, ...) Judged(#NAME, rule(__VA_ARGS__), [](const auto& p) -> decltype(auto) { return p.NAME(); })
#define TABLE(NAME, ...) template <> inline constexpr auto kTable<pb::NAME> = table(#NAME, __VA_ARGS__)
#define ENUM(NAME) pb::NAME##_IsValid, &pb::NAME##_Name<int>

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
inline constexpr auto kOtherVersion = EndsWhere([](const auto& p) { return p.protocol_version() != kProtocolVersion; });
inline constexpr Valid kLeaf{"a valid address", [](const pb::LeafAddress& a) {
  return a.level() <= std::uint32_t{lattice::kMaxLevel} && lattice::addressIsValid({static_cast<std::int32_t>(a.level()), a.i(), a.j()});
}};
inline constexpr auto kPitch = Range{terrain::kMinPitch, terrain::kMaxPitch, "parts"};  // of a step, 2^20 of them
inline constexpr std::int64_t kMaxTile =
    2 * lattice::kMaxPosition / (std::int64_t{terrain::kMinPitch >> terrain::kPitchBits} << terrain::kTileBits) + 1;
inline constexpr auto kTilePlace = Range{-kMaxTile, kMaxTile, "", "on the lattice, or one beyond it"};

// ---- both ways ----

TABLE(LeafAddress, FIELD(level, level), FIELD(i, i), FIELD(j, j));

TABLE(TileAddress, FIELD(i, i, kTilePlace), FIELD(j, j, kTilePlace));

TABLE(Settings,
    FIELD(metric, metric, OneOf{ENUM(Metric)}),
    FIELD(threshold, threshold, Range{0.0, kMaxThreshold}),
    FIELD(triangle_budget, triangleBudget), FIELD(bytes_per_second, bytesPerSecond), FIELD(candidates, candidates),
    FIELD(colour_error, colourError, Range{0.0, settings::kMostColourError}));

TABLE(Pose,
    FIELD(sequence, sequence, atLeast(std::uint64_t{1})),
    FIELD(x, camera.pose.x, kPlace),
    FIELD(z, camera.pose.z, kPlace),
    FIELD(y, camera.pose.y, kHeight),
    FIELD(yaw, camera.pose.yaw, within(1e6, "radians")),
    FIELD(pitch, camera.pose.pitch, Range{-std::numbers::pi / 2 - 1e-9, std::numbers::pi / 2 + 1e-9, "radians", "within +-pi/2"}),
    FIELD(vertical_fov, camera.projection.verticalFov, Range{0.01, 3.0, "radians"}),
    FIELD(width, camera.projection.width, kPixels),
    FIELD(height, camera.projection.height, kPixels),
    FIELD(state, state, Bytes{kMaxStateBytes}));

TABLE(LeafWhole,
    FIELD(address, address, kLeaf),
    FIELD(triangles, triangles, atMost(kMaxLeafTriangles, "")),
    FIELD(vertices, vertices),
    also("vertices", "0 without triangles, else 3 to 3 x triangles", [](const pb::LeafWhole& p) {
      const std::uint64_t n = p.triangles();
      return n == 0 ? p.vertices() == 0 : p.vertices() >= 3 && p.vertices() <= 3 * n;
    }),
    also("payload", "absent exactly when there are no triangles", [](const pb::LeafWhole& p) {
      return p.payload().empty() == (p.triangles() == 0);
    }),
    FIELD(payload, payload, Bytes{kMaxPayloadBytes}),
    FIELD(error, error, kLeafError),
    FIELD(shades, shades, Bytes{kMaxShadeBytes}));

TABLE(Moved,
    FIELD(camera, camera),
    also("pose", "present", [](const pb::Moved& p) { return p.has_pose(); }),
    FIELD(pose, pose),
    FIELD(time, time, kMicroseconds));

// ---- client to server ----

TABLE(Hello,
    FIELD(protocol_version, protocolVersion),
    FIELD(client_name, clientName, kName),
    kOtherVersion,
    FIELD(settings, settings),
    FIELD(pacing, pacing, OneOf{ENUM(Pacing)}),
    FIELD(points, points),
    FIELD(role, role, OneOfOrFirst{ENUM(Role)}),
    FIELD(members, members), FIELD(clock, clock), FIELD(errors, errors), FIELD(edits, edits), FIELD(edits_after, editsAfter));

TABLE(Acknowledge, FIELD(iteration, iteration), FIELD(mesh_hash, meshHash));

TABLE(ResendLeaves, FIELD(leaves, leaves, Entries{kMaxResendLeaves, kLeaf}));

TABLE(HeldLeaf, FIELD(address, address, kLeaf), FIELD(hash, hash));
TABLE(Resume, FIELD(leaves, leaves, Entries{kMaxResumeLeaves}));

TABLE(AskClock, FIELD(echo, echo));

TABLE(SetClock,
    FIELD(own, own),
    FIELD(mode, mode, OneOf{ENUM(ClockMode)}),
    FIELD(rate, rate, kRate),
    FIELD(time, time, kMicroseconds));

TABLE(Step,
    FIELD(time, time, Range{std::uint64_t{1}, kMaxStepTime, "microseconds"}),
    FIELD(wait, wait));

TABLE(StepDone, FIELD(step, step));

TABLE(PassOver, FIELD(camera, camera));

TABLE(Places,
    FIELD(x, x, Entries{kMaxPlaces, kPlace}),
    FIELD(z, z, Entries{kMaxPlaces, kPlace}),
    also("z", "as many as x", [](const pb::Places& p) { return p.x_size() == p.z_size(); }),
    FIELD(spacing, spacing, atMost(kMaxSpacing, "steps")));

TABLE(Ray,
    FIELD(x, x, kPlace),
    FIELD(z, z, kPlace),
    FIELD(y, y, kHeight),
    FIELD(direction_x, directionX, kDirection),
    FIELD(direction_y, directionY, kDirection),
    FIELD(direction_z, directionZ, kDirection),
    also("direction_x", "at least 1e-6 in size, or one of the others", [](const pb::Ray& p) {
      return std::max({std::abs(p.direction_x()), std::abs(p.direction_y()), std::abs(p.direction_z())}) >= 1e-6;
    }),
    FIELD(reach, reach, Range{0.0, kMaxReach, "m"}));
TABLE(Rays, FIELD(rays, rays, Entries{kMaxRays}));

TABLE(Query,
    FIELD(id, id),
    also("kind", "heights, normals or rays", [](const pb::Query& p) { return p.kind_case() != pb::Query::KIND_NOT_SET; }),
    QUESTION(heights, QueryKind::kHeights),
    QUESTION(normals, QueryKind::kNormals),
    Excused{QUESTION(rays, QueryKind::kRays)});

TABLE(AskGround,
    FIELD(id, id),
    FIELD(x, at.x, kPlace),
    FIELD(z, at.z, kPlace),
    FIELD(radius, radius, Range{1.0, 4096.0, "m"}),
    FIELD(error, error, Range{0.02, 100.0, "m"}));

TABLE(WantTiles, FIELD(tiles, tiles, Entries{kMaxTiles}));

TABLE(Edit,
    FIELD(id, id),
    FIELD(key, key, Text{kMaxEditKeyBytes}),
    FIELD(operation, operation, Bytes{kMaxClientMessageBytes}));

TABLE(FindEdits,
    FIELD(x, at.x, kPlace),
    FIELD(z, at.z, kPlace),
    FIELD(radius, radius, Range{0.0, kMaxReach, "m"}),
    FIELD(since, since));

TABLE(WantSquares, FIELD(squares, squares, Entries{kMaxSquares}));

TABLE(ClientMessage,
    KIND(hello, Hello), KIND(pose, PoseMessage), KIND(acknowledge, Acknowledge), KIND(resend_leaves, ResendLeaves), KIND(resume, Resume),
    KIND(ask_clock, AskClock), KIND(set_clock, SetClock), KIND(step, ClockStep), KIND(step_done, StepDone), KIND(query, Query),
    KIND(ask_ground, AskGround), KIND(want_tiles, WantTiles), SETTINGS(change_settings, ChangeSettings), KIND(pass_over, PassOver),
    KIND(edit, Edit), KIND(find_edits, FindEdits), KIND(want_squares, WantSquares));

// ---- server to client ----

TABLE(HeightMap,
    FIELD(pitch_x, x.pitch, kPitch),
    FIELD(pitch_z, z.pitch, kPitch),
    FIELD(origin_x, x.origin, kPlace),
    FIELD(origin_z, z.origin, kPlace),
    FIELD(width, width, atLeast(2u)),
    FIELD(height, height, atLeast(2u)),
    FIELD(lowest, lowest, within(terrain::kMaxSample, "steps")),
    FIELD(highest, highest, within(terrain::kMaxSample, "steps")),
    also("highest", "no lower than lowest", [](const pb::HeightMap& p) { return p.lowest() <= p.highest(); }),
    FIELD(content, content),
    FIELD(draped, draped));

TABLE(World,
    FIELD(protocol_version, protocolVersion),
    FIELD(server_name, serverName, kName),
    kOtherVersion,
    FIELD(session, session, Valid{"1 to 64 of A-Z a-z 0-9 . _ -", sessionNameIsValid}),
    FIELD(terrain_name, terrainName, kName),
    FIELD(terrain_source, terrainSource, Bytes{kMaxTerrainSourceBytes}),
    FIELD(seed, seed), FIELD(content_hash, contentHash),
    FIELD(step_bits, stepBits, Range{unsigned{lattice::kStepBits}, unsigned{lattice::kStepBits}}),
    FIELD(horizon, horizon, Range{1.0, kMaxHorizon, "m"}),
    FIELD(settings, settings),
    FIELD(window, window, Range{1u, kMaxWindow}),
    FIELD(camera, camera), FIELD(revision, revision), FIELD(height_map, heightMap), FIELD(shaded_vertices, shadedVertices),
    FIELD(edit, edit), FIELD(compacted, compacted));

TABLE(Figures,
    FIELD(select_ms, selectMs, kMs),
    FIELD(generate_ms, generateMs, kMs),
    FIELD(refine_ms, refineMs, kMs),
    FIELD(triangulate_ms, triangulateMs, kMs),
    FIELD(encode_ms, encodeMs, kMs),
    FIELD(valid_leaves, leaves), FIELD(leaves, leaves),  // one number; the second is what is read
    FIELD(visible_leaves, visibleLeaves), FIELD(generated_leaves, generatedLeaves), FIELD(dropped_leaves, droppedLeaves),
    FIELD(triangles, triangles), FIELD(inserted, inserted), FIELD(removed, removed), FIELD(deferred, deferred), FIELD(heights, heights),
    FIELD(effective_threshold, effectiveThreshold, Range{0.0, 1e15}), FIELD(insertion_limit, insertionLimit));

// Points are counted from (x, z). Those of a camera lie within twice the horizon of each other, far below kMaxCandidateReach.
inline bool pointsAreValid(const pb::Candidates& p) {
  if (p.points_size() != 3 * p.errors_size()) return false;
  for (int k = 0; k < p.points_size(); k += 3) {
    const std::int64_t x = p.points(k), z = p.points(k + 1), y = p.points(k + 2);
    if (!within(kMaxCandidateReach, "").holds(x) || !within(kMaxCandidateReach, "").holds(z) ||
        !lattice::positionIsValid(p.x() + x, p.z() + z) || !within(lattice::kMaxHeight, "").holds(y))
      return false;
  }
  return true;
}
inline void readPoints(std::vector<Candidate>& out, const pb::Candidates& p) {
  out.reserve(static_cast<std::size_t>(p.errors_size()));
  for (int k = 0; k < p.errors_size(); ++k)
    out.push_back({{p.x() + p.points(3 * k), p.z() + p.points(3 * k + 1), p.points(3 * k + 2)}, p.errors(k)});
}
inline void writePoints(const std::vector<Candidate>& in, pb::Candidates& p) {
  if (in.empty()) return;
  const lattice::Vertex from = in.front().at;
  p.set_x(from.x);
  p.set_z(from.z);
  p.mutable_points()->Reserve(static_cast<int>(3 * in.size()));
  p.mutable_errors()->Reserve(static_cast<int>(in.size()));
  for (const Candidate& c : in) {
    p.add_points(static_cast<std::int32_t>(c.at.x - from.x));
    p.add_points(static_cast<std::int32_t>(c.at.z - from.z));
    p.add_points(c.at.y);
    p.add_errors(c.pixels);
  }
}

TABLE(Candidates,
    JUDGED(x, kPlace),
    JUDGED(z, kPlace),
    JUDGED(errors, Entries{kMaxCandidates, Range{0.0, kMaxErrorPixels, "pixels"}}),
    also("points", "x, z, y for each error: x and z within +-2^27 steps of the message's and on the lattice, y within +-2^25 steps",
         pointsAreValid),
    Then(readPoints, writePoints));

TABLE(Iteration,
    FIELD(number, number, atLeast(std::uint64_t{1})),
    FIELD(pose_sequence, poseSequence),
    FIELD(gone, gone, Entries{kMaxIterationLeaves, kLeaf}),
    FIELD(whole, whole, Entries{kMaxIterationLeaves}),
    FIELD(come, come, Entries{kMaxIterationLeaves, kLeaf}),
    FIELD(points, points, Bytes{kMaxPayloadBytes}),
    FIELD(errors, errors, Entries{kMaxIterationLeaves, kLeafError}),
    FIELD(shades, shades, Bytes{kMaxShadeBytes}),
    FIELD(mesh_hash, meshHash), FIELD(settled, settled), FIELD(figures, figures), FIELD(edit, edit),
    FIELD(candidates, candidates, Encoded{&kMaxCandidatesBytes}));

TABLE(Error,
    FIELD(code, code, OneOfOrFirst{ENUM(Error_Code)}),
    FIELD(message, message, Bytes{kMaxErrorBytes}),
    FIELD(reconnect_url, reconnectUrl, Bytes{kMaxErrorBytes}),
    Then([](auto&, auto&) {}, [](const auto&, pb::Error& p) {
      for (std::string* text : {p.mutable_message(), p.mutable_reconnect_url()}) text->resize(std::min(text->size(), kMaxErrorBytes));
    }));

TABLE(Member,
    FIELD(camera, camera),
    FIELD(role, role, OneOfOrFirst{ENUM(Role)}),
    FIELD(name, name, kName),
    FIELD(moved, moved),
    Then([](Member& m, auto&) { if (m.moved) m.moved->camera = m.camera; },
         [](const Member& m, pb::Member& p) { if (m.moved) p.mutable_moved()->clear_camera(); }));

TABLE(Members,
    FIELD(joined, joined, Entries{kMaxMembers}),
    FIELD(moved, moved, Entries{kMaxMembers}),
    FIELD(left, left, Entries{kMaxMembers}));

TABLE(Clock,
    FIELD(mode, mode, OneOf{ENUM(ClockMode)}),
    FIELD(rate, rate, kRate),
    FIELD(time, time, kMicroseconds),
    FIELD(owner, owner), FIELD(step, step),
    FIELD(waits_for, waitsFor, Entries{kMaxMembers}),
    FIELD(echo, echo),
    FIELD(notice, notice, Bytes{kMaxErrorBytes}),
    FIELD(end, end, kMicroseconds));

TABLE(Answer,
    FIELD(id, id),
    FIELD(heights, heights, Entries{kMaxPlaces}),
    FIELD(normals, normals, Entries{3 * kMaxPlaces}),
    FIELD(distances, distances, Entries{kMaxRays}),
    FIELD(refusal, refusal, Bytes{kMaxErrorBytes}), FIELD(edit, edit));

TABLE(Ground,
    FIELD(id, id),
    FIELD(error, error, kLeafError),
    FIELD(leaves, leaves, Entries{kMaxIterationLeaves}),
    FIELD(refusal, refusal, Bytes{kMaxErrorBytes}), FIELD(edit, edit));

TABLE(EditAnswer,
    FIELD(id, id),
    FIELD(number, number),
    FIELD(refusal, refusal, Bytes{kMaxErrorBytes}));

TABLE(MadeEdit,
    FIELD(number, number, atLeast(std::uint64_t{1})),
    FIELD(author, author, kName),
    FIELD(name, name, kName),
    FIELD(operation, operation, Bytes{kMaxSmallMessageBytes}),
    FIELD(x0, ground.x0, kEdge), FIELD(z0, ground.z0, kEdge), FIELD(x1, ground.x1, kEdge), FIELD(z1, ground.z1, kEdge));
TABLE(Edited,
    FIELD(edits, edits, Entries{kMaxMadeEdits}),
    also("edits", "numbered without gaps", [](const pb::Edited& p) {
      for (int k = 1; k < p.edits_size(); ++k)
        if (p.edits(k).number() != p.edits(k - 1).number() + 1) return false;
      return true;
    }));

TABLE(Area, FIELD(x0, x0, kEdge), FIELD(z0, z0, kEdge), FIELD(x1, x1, kEdge), FIELD(z1, z1, kEdge));
TABLE(FoundEdits,
    FIELD(edit, edit),
    FIELD(changed, changed, Entries{kMaxFoundAreas}),
    FIELD(squares, squares, Entries{kMaxFoundSquares}));

TABLE(Square,
    FIELD(address, address),
    FIELD(rises, rises, Bytes{terrain::kMaxTileBytes}),
    FIELD(materials, materials, Bytes{terrain::kMaxTileBytes}));
TABLE(Squares, FIELD(edit, edit), FIELD(squares, squares, Entries{kMaxSquares}));

TABLE(HeightTile,
    FIELD(address, address),
    FIELD(samples, samples, Bytes{terrain::kMaxTileBytes}),
    FIELD(colours, colours, Bytes{terrain::kTileColourBytes}));
TABLE(HeightTiles, FIELD(tiles, tiles, Entries{kMaxTiles}));

TABLE(ServerMessage,
    KIND(world, World), KIND(iteration, Iteration), KIND(error, ErrorMessage),
    KIND(members, Members, Encoded{&kMaxSmallMessageBytes}),
    KIND(clock, Clock, Encoded{&kMaxSmallMessageBytes}),
    KIND(answer, Answer, Encoded{&kMaxSmallMessageBytes}),
    KIND(ground, Ground),
    KIND(edit_answer, EditAnswer),
    KIND(edited, Edited, Encoded{&kMaxSmallMessageBytes}),
    KIND(found_edits, FoundEdits), KIND(squares, Squares),
    KIND(height_tiles, HeightTiles), SETTINGS(granted, Granted));

}  // namespace ridgecast::wire
