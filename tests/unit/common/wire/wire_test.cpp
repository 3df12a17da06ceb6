// Members of values are the fields that the schema names; what a peer sends wrong is an error that names the field. schema_test judges the
// bytes of random messages.
#include "common/wire/wire.h"

#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/bytes.h"
#include "tests/unit/common/wire/random_message.h"

namespace ridgecast::wire {
namespace {

using google::protobuf::TextFormat;
using testing_support::bytesOf;

const std::string kHello =
    R"(hello { protocol_version: 1 client_name: "a simulator" settings { metric: METRIC_THESIS threshold: 0.25 )"
    R"(triangle_budget: 123456 bytes_per_second: 64000 candidates: 5 colour_error: 0.125 } pacing: PACING_LOCKSTEP )"
    R"(role: ROLE_SENSOR members: true errors: true points: true edits_after: 8 near: 24 states: true places_only: true })";
const std::string kPose =
    R"(pose { sequence: 9 x: -1125899906842624 z: 1125899906842624 y: -12.75 yaw: 100.5 pitch: -1.5 vertical_fov: 0.5 width: 32768 )"
    R"(height: 1 state: "\000\377\n" })";
const std::string kWorld =
    R"(world { protocol_version: 1 server_name: "ridgecast-server" session: "exercise-7" terrain_name: "alpine" )"
    R"(terrain_source: "float h;" seed: 4000000000 content_hash: 18364758544493064720 step_bits: 8 horizon: 32000 )"
    R"(settings { metric: METRIC_PIXELS threshold: 1.5 triangle_budget: 500000 } window: 3 camera: 17 revision: 8 )"
    R"(height_map { origin_x: -5 origin_z: 1125899906842624 width: 10 height: 20 lowest: -300 highest: 4 content: 77 draped: true )"
    R"(pitch_x: 8053063680 pitch_z: 26843546 } shaded_vertices: true edit: 6 compacted: 2 resume_key: "\001k" )"
    R"(materials: "forest mud" known: KNOWN_PROVEN })";
const std::string kIteration =
    R"(iteration { number: 1099511627776 pose_sequence: 77 gone { i: -1 j: 2 } gone { level: 10 i: 4 j: -4 } )"
    R"(whole { address { level: 3 i: 5 j: 6 } vertices: 4 triangles: 2 payload: "\000\377\007" error: 0.5 shades: "s" } )"
    R"(whole { address { level: 4 i: -5 j: 6 } } mesh_hash: 18446744073709551615 settled: true )"
    R"(figures { select_ms: 1.5 generate_ms: 2 refine_ms: 3 triangulate_ms: 4 encode_ms: 5 leaves: 6 valid_leaves: 6 visible_leaves: 8 )"
    R"(generated_leaves: 9 dropped_leaves: 10 triangles: 11 inserted: 12 removed: 13 deferred: 14 heights: 1125899906842624 )"
    R"(effective_threshold: 0.75 insertion_limit: 17 } candidates { x: -7 z: 9 points: 0 points: 0 points: 5 points: 1 points: -2 )"
    R"(points: 6 errors: 3 errors: 2 } come { j: 9 } points: "0" errors: 0.5 errors: 0 shades: "\001" edit: 4 })";

template <class P>
std::string textOf(const std::string& bytes) {
  P message;
  EXPECT_TRUE(message.ParseFromString(bytes));
  std::string text = message.ShortDebugString();
  return text;
}
void expectText(const ClientMessage& message, const std::string& text) { EXPECT_EQ(textOf<pb::ClientMessage>(encode(message)), text); }
void expectText(const ServerMessage& message, const std::string& text) { EXPECT_EQ(textOf<pb::ServerMessage>(encode(message)), text); }

PoseMessage somePose() {
  PoseMessage pose{9, {}, {0, 255, '\n'}};
  pose.camera.pose = {.x = -lattice::kMaxPosition, .z = lattice::kMaxPosition, .y = -12.75, .yaw = 100.5, .pitch = -1.5};
  pose.camera.projection = {.verticalFov = 0.5, .width = 32768, .height = 1};
  return pose;
}

TEST(Wire, ValuesOfAClientAreTheSchemasFields) {
  Hello hello{1, "a simulator", {Metric::kThesis, 0.25, 123'456, 64'000, 5, 0.125}, Pacing::kLockstep, true, Role::kSensor};
  hello.members = hello.errors = true;
  hello.editsAfter = 8;
  hello.near = 24;
  hello.states = hello.placesOnly = true;
  expectText(hello, kHello);
  hello = {};
  hello.clock = hello.edits = true;
  expectText(hello, "hello { protocol_version: 1 settings { } clock: true edits: true }");
  expectText(somePose(), kPose);
  expectText(Acknowledge{5, 6}, R"(acknowledge { iteration: 5 mesh_hash: 6 })");
  expectText(ResendLeaves{{{1, -2, 3}}}, R"(resend_leaves { leaves { level: 1 i: -2 j: 3 } })");
  expectText(Resume{{{{3, -5, 6}, 7}}, {}, 0}, R"(resume { leaves { address { level: 3 i: -5 j: 6 } hash: 7 } })");
  expectText(Resume{{}, "key", 9}, R"(resume { key: "key" mesh_hash: 9 })");
  expectText(AskClock{12}, R"(ask_clock { echo: 12 })");
  expectText(SetClock{true, ClockMode::kStepped, 0.5, 4}, R"(set_clock { own: true mode: CLOCK_STEPPED rate: 0.5 time: 4 })");
  expectText(ClockStep{4, true}, R"(step { time: 4 wait: true })");
  expectText(StepDone{9}, R"(step_done { step: 9 })");
  expectText(PassOver{9}, R"(pass_over { camera: 9 })");
  expectText(Query{3, QueryKind::kHeights, {5, 7}, {-6, 8}, 0, {}}, R"(query { id: 3 heights { x: 5 x: 7 z: -6 z: 8 } })");
  expectText(Query{3, QueryKind::kNormals, {5}, {-6}, 9, {}}, R"(query { id: 3 normals { x: 5 z: -6 spacing: 9 } })");
  expectText(Query{3, QueryKind::kRays, {}, {}, 0, {{1, -2, 3.5, 0.25, -1e-3, 1e6, 7}}},
             R"(query { id: 3 rays { rays { x: 1 z: -2 y: 3.5 direction_x: 0.25 direction_y: -0.001 direction_z: 1000000 reach: 7 } } )"
             R"(})");
  expectText(Query{3, QueryKind::kMaterials, {5}, {-6}, 0, {}}, R"(query { id: 3 materials { x: 5 z: -6 } })");
  expectText(AskGround{5, {1, -2}, 30, 0.05}, R"(ask_ground { id: 5 x: 1 z: -2 radius: 30 error: 0.05 })");
  expectText(WantTiles{{{3, -4}}}, R"(want_tiles { tiles { i: 3 j: -4 } })");
  expectText(ChangeSettings{{Metric::kArea, 2.5, 70'000, 1'000'000}},
             R"(change_settings { metric: METRIC_AREA threshold: 2.5 triangle_budget: 70000 bytes_per_second: 1000000 })");
  expectText(Edit{1, "k", "{}"}, R"(edit { id: 1 key: "k" operation: "{}" })");
  expectText(FindEdits{{-5, 6}, 33'500, 7}, R"(find_edits { x: -5 z: 6 radius: 33500 since: 7 })");
  expectText(WantSquares{{{-7, 8}}}, R"(want_squares { squares { i: -7 j: 8 } })");
}

TEST(Wire, ValuesOfAServerAreTheSchemasFields) {
  World world{1,
              "ridgecast-server",
              "exercise-7",
              "alpine",
              "float h;",
              4'000'000'000u,
              0xfedcba9876543210u,
              8,
              32'000,
              {Metric::kPixels, 1.5, 500'000},
              3,
              17};
  world.heightMap = {{-5, terrain::pitchOf(7680)}, {lattice::kMaxPosition, 26'843'546}, 10, 20, -300, 4, 77, true};
  world.shadedVertices = true;
  world.edit = 6;
  world.compacted = 2;
  world.resumeKey = "\001k";
  world.materials = "forest mud";
  world.known = terrain::Relief::Known::kProven;
  expectText(world, kWorld);
  Iteration it;
  it.number = 1ull << 40;
  it.poseSequence = 77;
  it.gone = {{0, -1, 2}, {10, 4, -4}};
  it.whole = {{{3, 5, 6}, 4, 2, {0, 255, 7}, 0.5f, {'s'}}, {{4, -5, 6}, 0, 0, {}}};
  it.come = {{0, 0, 9}};
  it.points = {'0'};
  it.errors = {0.5f, 0};
  it.shades = {1};
  it.meshHash = ~0ull;
  it.settled = true;
  it.edit = 4;
  it.candidates = {{{-7, 9, 5}, 3}, {{-6, 7, 6}, 2}};
  it.figures = {1.5, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 1ull << 50, 0.75, 17};
  expectText(it, kIteration);
  expectText(ErrorMessage{ErrorCode::kNotFound, "no session 'x'", "ws://b"},
             R"(error { code: CODE_NOT_FOUND message: "no session \'x\'" reconnect_url: "ws://b" })");
  const Moved moved{7, {9, somePose().camera, {1}}, 5};
  expectText(Members{{{7, Role::kSensor, "lidar", moved}, {8, Role::kViewer, "", {}}}, {moved}, {1, 2}},
             R"(members { joined { camera: 7 role: ROLE_SENSOR name: "lidar" moved { pose { sequence: 9 x: -1125899906842624 z: )"
             R"(1125899906842624 y: -12.75 yaw: 100.5 pitch: -1.5 vertical_fov: 0.5 width: 32768 height: 1 state: "\001" } time: 5 } )"
             R"(} joined { camera: 8 } moved { camera: 7 pose { sequence: 9 x: -1125899906842624 z: 1125899906842624 y: -12.75 yaw: )"
             R"(100.5 pitch: -1.5 vertical_fov: 0.5 width: 32768 height: 1 state: "\001" } time: 5 } left: 1 left: 2 })");
  Members crowded{{{7, Role::kViewer, "", {}, true}}, {}, {}, 2000, {5, 6}, Crowd{3, {-1, 17'179'869'184}, {0, 2}, {300, 4}}};
  expectText(crowded,
             "members { joined { camera: 7 clock: true } others: 2000 faded: 5 faded: 6 crowd { level: 3 i: -1 i: 17179869184 "
             "j: 0 j: 2 count: 300 count: 4 } }");
  expectText(Clock{ClockMode::kScaled, 2.5, 10, 3, 4, {5, 6}, 7, "Passed over.", 11, true},
             R"(clock { mode: CLOCK_SCALED rate: 2.5 time: 10 owner: 3 step: 4 waits_for: 5 waits_for: 6 echo: 7 notice: "Passed )"
             R"(over." end: 11 refuses: true })");
  expectText(Answer{4, {1.5f, -0.0f}, {0, 1, 0}, {-1, 12.25}, {9, 'a'}, "", 5},
             R"(answer { id: 4 heights: 1.5 heights: -0 normals: 0 normals: 1 normals: 0 distances: -1 distances: 12.25 edit: 5 )"
             R"(materials: "\ta" })");
  expectText(Ground{5, 0.25, {{{3, 5, 6}, 4, 2, {0, 255}, 0.125f}}, "", 6},
             R"(ground { id: 5 error: 0.25 leaves { address { level: 3 i: 5 j: 6 } vertices: 4 triangles: 2 payload: "\000\377" )"
             R"(error: 0.125 } edit: 6 })");
  expectText(HeightTiles{{{{-1, 9}, {'s'}, {'c'}}}}, R"(height_tiles { tiles { address { i: -1 j: 9 } samples: "s" colours: "c" } })");
  expectText(Granted{{Metric::kArea, 2.5, 70'000, 1'000'000}},
             R"(granted { metric: METRIC_AREA threshold: 2.5 triangle_budget: 70000 bytes_per_second: 1000000 })");
  expectText(EditAnswer{1, 2, "no"}, R"(edit_answer { id: 1 number: 2 refusal: "no" })");
  expectText(Edited{{{3, "a", "n", "{}", {-1, -2, 3, 4}}}},
             R"(edited { edits { number: 3 author: "a" operation: "{}" x0: -1 z0: -2 x1: 3 z1: 4 name: "n" } })");
  expectText(FoundEdits{9, {{-1, -2, 3, 4}}, {{-7, 8}, {0, 0}}},
             R"(found_edits { edit: 9 changed { x0: -1 z0: -2 x1: 3 z1: 4 } squares { i: -7 j: 8 } squares { } })");
  expectText(Squares{9, {{{-7, 8}, {'r'}, {'m'}}}}, R"(squares { edit: 9 squares { address { i: -7 j: 8 } rises: "r" materials: "m" } })");
}

template <class Message>
Message roundTrip(const Message& message) {
  const auto decoded = decodeServer(bytesOf(encode(ServerMessage(message))));
  EXPECT_TRUE(decoded) << decoded.error().message;
  return decoded ? std::get<Message>(*decoded) : Message{};
}

TEST(Wire, ALongErrorIsCut) {
  EXPECT_EQ(roundTrip(ErrorMessage{.code = ErrorCode::kLimit, .message = std::string(10'000, 'x')}).message.size(), kMaxErrorBytes);
}

TEST(Wire, CandidatesTakeFewBytesAndNoneAreNotTheSameAsNotTold) {
  Iteration in;
  in.number = 1;
  EXPECT_FALSE(roundTrip(in).candidates);
  in.candidates.emplace();
  ASSERT_TRUE(roundTrip(in).candidates);
  EXPECT_TRUE(roundTrip(in).candidates->empty());
  const lattice::Step far = lattice::kMaxPosition;
  for (std::uint32_t k = 0; k < kMaxCandidates; ++k)
    in.candidates->push_back(
        {{far - 9'000'000 + k * 400, -far + k, static_cast<std::int32_t>(k) - 10'000}, 20'000.0f - static_cast<float>(k)});
  in.candidates->back() = {{far, -far, -lattice::kMaxHeight}, 0};
  EXPECT_LT(encode(ServerMessage(in)).size(), std::size_t{16} * kMaxCandidates);
  EXPECT_EQ(roundTrip(in).candidates, in.candidates);
}

TEST(Wire, AsManyLeavesAsMayBeResumedFitIntoAMessage) {
  Resume many;
  for (std::size_t k = 0; k < kMaxResumeLeaves; ++k)
    many.leaves.push_back({{static_cast<std::int32_t>(k % 11), -static_cast<std::int64_t>(k), 5}, ~k});
  const std::string bytes = encode(ClientMessage(many));
  EXPECT_LT(bytes.size(), kMaxClientMessageBytes);
  EXPECT_TRUE(decodeClient(bytesOf(bytes)));
}

TEST(Wire, AKindOfALaterRevisionIsToldFromNothing) {
  const std::string later("\x92\x7d\x02hi", 5);  // field 2002
  const auto decoded = decodeServer(bytesOf(later));
  ASSERT_TRUE(decoded);
  EXPECT_TRUE(std::holds_alternative<UnknownKind>(*decoded));
  EXPECT_FALSE(decodeClient(bytesOf(later))) << "a server knows what it is asked, or says that it does not";
}

// ---- what is refused ----

// Of a message in protobuf's words, with a change of it; empty: it is accepted.
template <class P>
std::string refusalOf(const std::string& message, const std::string& change = "") {
  P parsed;
  EXPECT_TRUE(TextFormat::ParseFromString(message, &parsed)) << message;
  EXPECT_TRUE(TextFormat::MergeFromString(change, &parsed)) << change;
  const std::string bytes = parsed.SerializeAsString();
  const auto refusal = [](const auto& decoded) { return decoded ? "" : decoded.error().message; };
  if constexpr (std::is_same_v<P, pb::ServerMessage>) return refusal(decodeServer(bytesOf(bytes)));
  const auto decoded = decodeClient(bytesOf(bytes));
  const auto* query = decoded ? std::get_if<Query>(&*decoded) : nullptr;  // of rays alone
  return query ? query->refusal : refusal(decoded);
}

TEST(Wire, AnotherVersionIsAnsweredNotRefused) {
  EXPECT_EQ(refusalOf<pb::ClientMessage>("hello { protocol_version: 9 pacing: 77 }"), "");  // means something there
  EXPECT_EQ(refusalOf<pb::ServerMessage>("world { protocol_version: 2 }"), "");
}

// Field, message, change: the refusal begins with the field.
using Wrong = std::vector<std::array<std::string, 3>>;
template <class P>
void expectRefused(const Wrong& wrong) {
  for (const auto& [field, message, change] : wrong) {
    EXPECT_EQ(refusalOf<P>(message), "") << message;
    EXPECT_EQ(refusalOf<P>(message, change).find(field + " "), 0u) << change << ": " << refusalOf<P>(message, change);
  }
}
std::string quoted(std::size_t bytes) { return "\"" + std::string(bytes, 'x') + "\""; }
const char* const kBad[] = {"nan", "inf", "-inf"};

TEST(WireRefuses, WhatAClientSaysOutOfRange) {
  const std::string ground = "ask_ground { radius: 10 error: 1 }", ray = "query { rays { rays { direction_x: 1 } } }",
                    clock = "set_clock { }", find = "find_edits { }", tiles = "want_tiles { }";
  Wrong wrong{{"Hello.client_name", kHello, "hello { client_name: " + quoted(129) + " }"},
              {"Hello.client_name", kHello, R"(hello { client_name: "two\nlines" })"},
              {"Hello.pacing", kHello, "hello { pacing: 2 }"},
              {"Hello.pacing", kHello, "hello { pacing: -1 }"},
              {"Settings.metric", kHello, "hello { settings { metric: " + std::to_string(settings::kMetrics.size()) + " } }"},
              {"Settings.threshold", kHello, "hello { settings { threshold: -0.5 } }"},
              {"Settings.threshold", "change_settings { }", "change_settings { threshold: 1e13 }"},
              {"Settings.colour_error", kHello, "hello { settings { colour_error: -0.1 } }"},
              {"Settings.colour_error", kHello, "hello { settings { colour_error: 1.5 } }"},
              {"Pose.sequence", kPose, "pose { sequence: 0 }"},
              {"Pose.x", kPose, "pose { x: " + std::to_string(lattice::kMaxPosition + 1) + " }"},
              {"Pose.x", kPose, "pose { x: -9223372036854775808 }"},
              {"Pose.z", kPose, "pose { z: 9223372036854775807 }"},
              {"Pose.y", kPose, "pose { y: 1.1e6 }"},
              {"Pose.pitch", kPose, "pose { pitch: 1.6 }"},
              {"Pose.vertical_fov", kPose, "pose { vertical_fov: 0 }"},
              {"Pose.width", kPose, "pose { width: 0 }"},
              {"Pose.height", kPose, "pose { height: 40000 }"},
              {"Pose.state", kPose, "pose { state: " + quoted(kMaxStateBytes + 1) + " }"},
              {"SetClock.rate", clock, "set_clock { rate: 1001 }"},
              {"SetClock.mode", clock, "set_clock { mode: 3 }"},
              {"Step.time", "step { time: 1 }", "step { time: 0 }"},
              {"Step.time", "step { time: 1 }", "step { time: " + std::to_string(kMaxStepTime + 1) + " }"},
              {"Places.z", "query { heights { } }", "query { heights { x: 1 } }"},
              {"Places.x", "query { normals { } }", "query { normals { x: " + std::to_string(lattice::kMaxPosition + 1) + " z: 0 } }"},
              {"Ray.direction_x", ray, "query { rays { rays { } } }"},
              {"Ray.y", ray, "query { rays { rays { direction_x: 1 y: nan } } }"},
              {"AskGround.radius", ground, "ask_ground { radius: 0 }"},
              {"AskGround.radius", ground, "ask_ground { radius: 4097 }"},
              {"AskGround.error", ground, "ask_ground { error: 0 }"},
              {"FindEdits.radius", find, "find_edits { radius: " + std::to_string(2 * kMaxReach) + " }"},
              {"TileAddress.i", tiles, "want_tiles { tiles { i: -9223372036854775808 } }"}};
  for (const std::string bad : kBad) {
    wrong.push_back({"Settings.threshold", kHello, "hello { settings { threshold: " + bad + " } }"});
    for (const std::string name : {"y", "yaw", "pitch", "vertical_fov"})
      wrong.push_back({"Pose." + name, kPose, "pose { " + name + ": " + bad + " }"});
    wrong.push_back({"SetClock.rate", clock, "set_clock { rate: " + bad + " }"});
    wrong.push_back({"AskGround.radius", ground, "ask_ground { radius: " + bad + " }"});
  }
  expectRefused<pb::ClientMessage>(wrong);
  EXPECT_EQ(refusalOf<pb::ClientMessage>("query { }").find("Query.kind "), 0u);
}

TEST(WireRefuses, WhatAServerSaysOutOfRange) {
  const std::string whole = "iteration { whole { address { } ", clock = "clock { }",
                    few = "iteration { number: 1 candidates { points: 1 points: 2 points: 3 errors: 1 } }";
  const auto candidates = [](const std::string& change) { return "iteration { candidates { " + change + " } }"; };
  const auto map = [](const std::string& field, std::int64_t value) {
    return std::array{"HeightMap." + field, kWorld, "world { height_map { " + field + ": " + std::to_string(value) + " } }"};
  };
  const std::string edge = std::to_string(lattice::kMaxPosition);
  std::string many;
  for (std::uint32_t k = 0; k < kMaxCandidates; ++k) many += "errors: 1 ";
  Wrong wrong{
      {"World.server_name", kWorld, "world { server_name: " + quoted(129) + " }"},
      {"World.session", kWorld, R"(world { session: "" })"},
      {"World.session", kWorld, R"(world { session: "a b" })"},
      {"World.terrain_source", kWorld, "world { terrain_source: " + quoted(kMaxTerrainSourceBytes + 1) + " }"},
      {"World.step_bits", kWorld, "world { step_bits: 9 }"},
      {"World.window", kWorld, "world { window: 0 }"},
      {"World.window", kWorld, "world { window: 65 }"},
      {"World.horizon", kWorld, "world { horizon: 0 }"},
      map("pitch_x", terrain::kMinPitch - 1),
      map("pitch_z", std::int64_t{terrain::kMaxPitch} + 1),
      map("origin_x", lattice::kMaxPosition + 1),
      map("width", 1),
      map("highest", -301),
      map("highest", terrain::kMaxSample + 1),
      {"Iteration.number", kIteration, "iteration { number: 0 }"},
      {"LeafWhole.triangles", kIteration, whole + "triangles: 1048577 } }"},
      {"LeafWhole.vertices", kIteration, whole + "triangles: 2 vertices: 2 payload: 'p' } }"},
      {"LeafWhole.vertices", kIteration, whole + "triangles: 2 vertices: 7 payload: 'p' } }"},
      {"LeafWhole.vertices", kIteration, whole + "vertices: 3 } }"},
      {"LeafWhole.payload", kIteration, whole + "triangles: 2 vertices: 4 } }"},
      {"LeafWhole.payload", kIteration, whole + "payload: 'x' } }"},
      {"Figures.effective_threshold", kIteration, "iteration { figures { effective_threshold: -1 } }"},
      {"Candidates.points", few, candidates("points: 1")},
      {"Candidates.points", few, candidates("errors: 1")},
      {"Candidates.x", few, candidates("x: " + std::to_string(lattice::kMaxPosition + 1))},
      {"Candidates.points", few, candidates("x: " + edge)},
      {"Candidates.points", few, candidates("points: 0 points: 134217729 points: 0 errors: 1")},
      {"Candidates.points", few, candidates("points: -2147483648 points: 0 points: 0 errors: 1")},
      {"Candidates.points", few, candidates("points: 0 points: 0 points: " + std::to_string(lattice::kMaxHeight + 1) + " errors: 1")},
      {"Candidates.errors", few, candidates("points: 0 points: 0 points: 0 errors: -1")},
      {"Candidates.errors", few, candidates("points: 0 points: 0 points: 0 errors: 2e9")},
      {"Candidates.errors", few, candidates(many)},
      {"Moved.pose", "members { }", "members { moved { } }"},
      {"Member.name", "members { }", R"(members { joined { name: "a\nb" } })"},
      {"Crowd.level", "members { }", "members { crowd { level: 41 } }"},
      {"Crowd.i", "members { }", "members { crowd { i: 17179869185 j: 0 count: 1 } }"},
      {"Crowd.j", "members { }", "members { crowd { i: 0 j: -17179869186 count: 1 } }"},
      {"Crowd.count", "members { }", "members { crowd { i: 0 j: 0 } }"},
      {"Clock.time", clock, "clock { time: " + std::to_string(kMaxTime + 1) + " }"},
      {"Square.rises", "squares { }", "squares { squares { address { } rises: " + quoted(terrain::kMaxTileBytes + 1) + " } }"},
      {"HeightTile.samples", "height_tiles { }",
       "height_tiles { tiles { address { } samples: " + quoted(terrain::kMaxTileBytes + 1) + " } }"},
      {"HeightTile.colours", "height_tiles { }",
       "height_tiles { tiles { address { } colours: " + quoted(terrain::kTileColourBytes + 1) + " } }"}};
  for (const std::string bad : kBad) {
    wrong.push_back({"World.horizon", kWorld, "world { horizon: " + bad + " }"});
    wrong.push_back({"Iteration.errors", kIteration, "iteration { errors: " + bad + " }"});
    wrong.push_back({"Figures.refine_ms", kIteration, "iteration { figures { refine_ms: " + bad + " } }"});
    wrong.push_back({"Candidates.errors", few, candidates("points: 0 points: 0 points: 0 errors: " + bad)});
    wrong.push_back({"Clock.rate", clock, "clock { rate: " + bad + " }"});
    wrong.push_back({"Ground.error", "ground { }", "ground { error: " + bad + " }"});
  }
  expectRefused<pb::ServerMessage>(wrong);
}

TEST(WireRefuses, Addresses) {
  for (const std::string bad :
       {"level: 11", "level: 4294967295", "i: 137438953473", "level: 10 i: 137438953472", "level: 3 i: -9223372036854775808"}) {
    expectRefused<pb::ClientMessage>({{"ResendLeaves.leaves", "resend_leaves { }", "resend_leaves { leaves { " + bad + " } }"},
                                      {"HeldLeaf.address", "resume { }", "resume { leaves { address { " + bad + " } } }"}});
    expectRefused<pb::ServerMessage>({{"Iteration.gone", kIteration, "iteration { gone { " + bad + " } }"},
                                      {"LeafWhole.address", kIteration, "iteration { whole { address { " + bad + " } } }"},
                                      {"Iteration.come", kIteration, "iteration { come { " + bad + " } }"}});
  }
}

std::string nested(const std::string& tag, const std::string& content) {
  std::string out = tag;
  for (std::size_t size = content.size();; size >>= 7) {
    out += static_cast<char>(size >= 0x80 ? (size & 0x7f) | 0x80 : size);
    if (size < 0x80) return out + content;
  }
}
std::string list(const std::string& tag, std::size_t entries, const std::string& entry) {
  std::string out;
  for (std::size_t k = 0; k < entries; ++k) out += nested(tag, entry);
  return out;
}
bool saysAtMost(const auto& decoded, const std::string& list) {
  return !decoded && decoded.error().message.find(list + " must be at most ") == 0;
}

TEST(WireRefuses, TooMuch) {
  EXPECT_NE(decodeClient(bytesOf(std::string(kMaxClientMessageBytes + 1, '\0'))).error().message.find("at most 131072"), std::string::npos);
  EXPECT_NE(decodeServer(bytesOf(std::string(kMaxServerMessageBytes + 1, '\0'))).error().message.find("at most 268435456"),
            std::string::npos);
  EXPECT_TRUE(decodeClient(bytesOf(nested("\x22", list("\x0a", kMaxResendLeaves, "")))));
  EXPECT_TRUE(saysAtMost(decodeServer(bytesOf(nested("\x12", list("\x1a", 20'000'000, "")))), "Iteration.gone"));
  // Split over several occurrences of the same message, which protobuf merges.
  const std::string half = nested("\x12", list("\x1a", kMaxIterationLeaves / 2 + 1, ""));
  EXPECT_TRUE(saysAtMost(decodeServer(bytesOf(half + half)), "Iteration.gone"));
  const auto encoded = [](const std::string& tag, const std::string& content) {
    return decodeServer(bytesOf(nested(tag, content))).error().message;
  };
  EXPECT_NE(encoded("\x32", nested("\x12", std::string(20 << 20, '\0'))).find("16 MiB"), std::string::npos);
  EXPECT_EQ(encoded("\x12", "\x08\x01" + nested("\x4a", nested("\x1a", std::string(1 << 20, '\0')))).find("Iteration.candidates "), 0u);
}

// Entries that protobuf could not even parse: the refusal names the list, so it was counted before anything was built.
TEST(WireRefuses, TooManyEntriesBeforeTheyAreBuilt) {
  struct List {
    std::string name, kind, tag;
    std::size_t most;
  };
  const auto expectCounted = [](const List& l, auto decode) {
    EXPECT_TRUE(saysAtMost(decode(bytesOf(nested(l.kind, list(l.tag, l.most + 1, "\x0b")))), l.name)) << l.name;
    EXPECT_FALSE(saysAtMost(decode(bytesOf(nested(l.kind, list(l.tag, l.most, "\x0b")))), l.name)) << l.name;
  };
  const std::string far = "\xa2\x01";  // field 20
  for (const List& l :
       {List{"ResendLeaves.leaves", "\x22", "\x0a", kMaxResendLeaves}, List{"Resume.leaves", "\x2a", "\x0a", kMaxResumeLeaves},
        List{"WantSquares.squares", "\xca\x01", "\x0a", kMaxSquares}, List{"WantTiles.tiles", far, "\x0a", kMaxTiles}})
    expectCounted(l, decodeClient);
  const auto rays = decodeClient(bytesOf(nested("\x52", nested("\x22", list("\x0a", kMaxRays + 1, "\x0b")))));
  ASSERT_TRUE(rays) << rays.error().message;
  EXPECT_EQ(std::get<Query>(*rays).refusal, "Rays.rays must be at most 256 entries");
  EXPECT_TRUE(
      saysAtMost(decodeClient(bytesOf(nested("\x52", nested("\x12", nested("\x0a", std::string(kMaxPlaces + 1, '\x02')))))), "Places.x"));
  for (const List& l :
       {List{"Iteration.gone", "\x12", "\x1a", kMaxIterationLeaves}, List{"Iteration.whole", "\x12", "\x22", kMaxIterationLeaves},
        List{"Iteration.come", "\x12", "\x52", kMaxIterationLeaves}, List{"Members.joined", "\x22", "\x0a", kMaxMembers},
        List{"Members.moved", "\x22", "\x12", kMaxMembers}, List{"Ground.leaves", "\x3a", "\x1a", kMaxIterationLeaves},
        List{"FoundEdits.changed", "\x52", "\x12", kMaxFoundAreas}, List{"FoundEdits.squares", "\x52", "\x1a", kMaxFoundSquares},
        List{"Squares.squares", "\x5a", "\x12", kMaxSquares}, List{"HeightTiles.tiles", far, "\x0a", kMaxTiles}})
    expectCounted(l, decodeServer);
}

TEST(Wire, PartsOfMembersOneAfterTheOtherAreOne) {
  const Moved moved{7, {9, somePose().camera, {1}}, 5};
  const Members a{{{7, Role::kSensor, "lidar", moved}}, {}, {1}, 3}, b{{{8, Role::kViewer, "", {}}}, {moved, moved}, {2}, 5, {4}, Crowd{}};
  const auto both = decodeServer(bytesOf(encodeMembers(encodePart(a) + encodePart(b))));
  ASSERT_TRUE(both) << both.error().message;
  const Members all{{a.joined[0], b.joined[0]}, {moved, moved}, {1, 2}, 5, {4}, Crowd{}};
  EXPECT_EQ(encode(*both), encode(ServerMessage(all)));
  EXPECT_EQ(encodeMembers(encodePart(all)), encode(ServerMessage(all)));
  EXPECT_TRUE(std::holds_alternative<Members>(*decodeServer(bytesOf(encodeMembers("")))));
}

TEST(WireRefuses, EmptyAndForeign) {
  EXPECT_FALSE(decodeClient({}));
  EXPECT_FALSE(decodeServer({}));
  EXPECT_FALSE(decodeServer(bytesOf("GET / HTTP/1.1\r\n\r\n")));
  // A message that holds itself a hundred thousand times.
  EXPECT_FALSE(decodeClient(bytesOf(std::string(100'000, '\x0b'))));
}

// The outer message is one field, so no prefix of it is well-formed.
TEST(WireRefuses, EveryPrefix) {
  RandomMessage random(3, 0);
  for (int k = 0; k < 100; ++k) {
    pb::ClientMessage client;
    pb::ServerMessage server;
    random.fill(client);
    random.fill(server);
    const std::string fromClient = client.SerializeAsString(), fromServer = server.SerializeAsString();
    for (std::size_t length = 0; length < std::max(fromClient.size(), fromServer.size()); ++length) {
      const auto fresh = [&](const std::string& whole) {
        return std::vector<std::uint8_t>(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
      };
      if (length < fromClient.size()) EXPECT_FALSE(decodeClient(fresh(fromClient))) << length << " of " << client.ShortDebugString();
      if (length < fromServer.size()) EXPECT_FALSE(decodeServer(fresh(fromServer))) << length << " of " << server.ShortDebugString();
    }
  }
}

TEST(SessionNames, AreShortAndPlain) {
  for (const char* good : {"default", "a", "A.b_c-9", "1"}) EXPECT_TRUE(sessionNameIsValid(good));
  for (const char* bad : {"", "a b", "a/b", "a%20", "\xc3\xa4"}) EXPECT_FALSE(sessionNameIsValid(bad));
  EXPECT_TRUE(sessionNameIsValid(std::string(64, 'x')));
  EXPECT_FALSE(sessionNameIsValid(std::string(65, 'x')));
}

}  // namespace
}  // namespace ridgecast::wire
