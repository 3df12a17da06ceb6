// Values survive the wire; what a peer sends wrong is an error that names the field.
#include "common/wire/wire.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "ridgecast/v1/stream.pb.h"
#include "tests/support/bytes.h"

namespace ridgecast::wire {
namespace {

using testing_support::bytesOf;

namespace pb = ridgecast::v1;
using Random = std::mt19937_64;

Hello anyHello() {
  return {.clientName = "a simulator",
          .settings = {Metric::kThesis, 0.25, 123'456, 64'000, 0, 0.125},
          .pacing = Pacing::kLockstep,
          .points = true};
}
Resume anyResume() { return {{{{3, -5, 6}, 7}, {{0, 1, 2}, ~0ull}}}; }
PoseMessage anyPose() {
  PoseMessage pose{.sequence = 9, .camera = {}};
  pose.camera.pose = {
      .x = -lattice::kMaxPosition, .z = lattice::kMaxPosition, .remainderX = 0, .remainderZ = 0, .y = -12.75, .yaw = 100.5, .pitch = -1.5};
  pose.camera.projection = {.verticalFov = 0.5, .width = 32768, .height = 1};
  pose.state = {0, 255, '\n'};
  return pose;
}
World anyWorld() {
  return {.serverName = "ridgecast-server 0.1",
          .session = "exercise-7",
          .terrainName = "alpine",
          .terrainSource = "float terrainHeight();\n",
          .seed = 4'000'000'000u,
          .contentHash = 0xfedcba9876543210u,
          .horizon = 32'000,
          .settings = {Metric::kPixels, 1.5, 500'000},
          .window = 3,
          .camera = 17};
}
Iteration anyIteration() {
  Iteration it;
  it.number = 1ull << 40;
  it.poseSequence = 77;
  it.gone = {{0, -1, 2}, {10, 4, -4}};
  it.whole = {{.address = {3, 5, 6}, .vertices = 4, .triangles = 2, .payload = {0, 255, 7, 0, 1}},
              {.address = {4, -5, 6}, .vertices = 0, .triangles = 0, .payload = {}}};
  it.come = {{0, 9, -9}, {1, 7, 7}};
  it.points = {0x30, 0, 255};
  it.errors = {0.5f, 0};
  it.shades = {1, 2, 3, 4, 5};
  it.meshHash = ~0ull;
  it.settled = true;
  it.figures = {.selectMs = 1.5,
                .generateMs = 2,
                .refineMs = 3,
                .triangulateMs = 4,
                .encodeMs = 5,
                .leaves = 6,
                .visibleLeaves = 8,
                .generatedLeaves = 9,
                .droppedLeaves = 10,
                .triangles = 11,
                .inserted = 12,
                .removed = 13,
                .deferred = 14,
                .heights = 1ull << 50,
                .effectiveThreshold = 0.75,
                .insertionLimit = 17};
  return it;
}

template <class Message>
Message roundTrip(const Message& message) {
  if constexpr (std::is_constructible_v<ClientMessage, Message>) {
    const auto decoded = decodeClient(bytesOf(encode(ClientMessage(message))));
    EXPECT_TRUE(decoded) << decoded.error().message;
    return decoded ? std::get<Message>(*decoded) : Message{};
  } else {
    const auto decoded = decodeServer(bytesOf(encode(ServerMessage(message))));
    EXPECT_TRUE(decoded) << decoded.error().message;
    return decoded ? std::get<Message>(*decoded) : Message{};
  }
}

void expectEqual(const Settings& a, const Settings& b) {
  EXPECT_EQ(a.metric, b.metric);
  EXPECT_EQ(a.threshold, b.threshold);
  EXPECT_EQ(a.triangleBudget, b.triangleBudget);
  EXPECT_EQ(a.bytesPerSecond, b.bytesPerSecond);
  EXPECT_EQ(a.colourError, b.colourError);
}

const std::string kLaterKind("\x92\x7d\x02hi", 5);  // field 2002

TEST(Wire, HelloSurvives) {
  const Hello in = anyHello(), out = roundTrip(in);
  EXPECT_EQ(out.protocolVersion, kProtocolVersion);
  EXPECT_EQ(out.clientName, in.clientName);
  EXPECT_EQ(out.pacing, in.pacing);
  expectEqual(out.settings, in.settings);
  EXPECT_EQ(roundTrip(Hello{}).settings.metric, Metric::kDefault);
}

TEST(Wire, PoseSurvives) {
  const PoseMessage in = anyPose(), out = roundTrip(in);
  EXPECT_EQ(out.sequence, in.sequence);
  EXPECT_EQ(out.camera.pose.x, in.camera.pose.x);
  EXPECT_EQ(out.camera.pose.z, in.camera.pose.z);
  EXPECT_EQ(out.camera.pose.y, in.camera.pose.y);
  EXPECT_EQ(out.camera.pose.yaw, in.camera.pose.yaw);
  EXPECT_EQ(out.camera.pose.pitch, in.camera.pose.pitch);
  EXPECT_EQ(out.camera.projection.verticalFov, in.camera.projection.verticalFov);
  EXPECT_EQ(out.camera.projection.width, in.camera.projection.width);
  EXPECT_EQ(out.camera.projection.height, in.camera.projection.height);
  EXPECT_EQ(out.state, in.state);
  EXPECT_TRUE(roundTrip(PoseMessage{1, in.camera}).state.empty());
}

TEST(Wire, AcknowledgeAndResendSurvive) {
  const Acknowledge ack = roundTrip(Acknowledge{.iteration = 5, .meshHash = 0x8000000000000001u});
  EXPECT_EQ(ack.iteration, 5u);
  EXPECT_EQ(ack.meshHash, 0x8000000000000001u);
  EXPECT_TRUE(roundTrip(ResendLeaves{}).leaves.empty());
  ResendLeaves many;
  for (std::size_t k = 0; k < kMaxResendLeaves; ++k)
    many.leaves.push_back({static_cast<std::int32_t>(k % 11), -static_cast<std::int64_t>(k), (std::int64_t{1} << 26) - 1});
  EXPECT_EQ(roundTrip(many).leaves, many.leaves);
}

TEST(Wire, ResumeSurvives) {
  Resume many;
  for (std::size_t k = 0; k < kMaxResumeLeaves; ++k)
    many.leaves.push_back({{static_cast<std::int32_t>(k % 11), -static_cast<std::int64_t>(k), 5}, ~k});
  for (const Resume& in : {Resume{}, anyResume(), many}) {
    EXPECT_LT(encode(ClientMessage(in)).size(), kMaxClientMessageBytes);
    const Resume out = roundTrip(in);
    ASSERT_EQ(out.leaves.size(), in.leaves.size());
    for (std::size_t k = 0; k < in.leaves.size(); ++k) {
      EXPECT_EQ(out.leaves[k].address, in.leaves[k].address);
      EXPECT_EQ(out.leaves[k].hash, in.leaves[k].hash);
    }
  }
  many.leaves.push_back({});
  const auto decoded = decodeClient(bytesOf(encode(ClientMessage(many))));
  ASSERT_FALSE(decoded);
  EXPECT_EQ(decoded.error().message.find("Resume.leaves must be at most 2,048"), 0u) << decoded.error().message;
}

TEST(Wire, PointsInHelloSurvive) {
  EXPECT_FALSE(roundTrip(Hello{}).points);
  EXPECT_TRUE(roundTrip(Hello{.clientName = "", .settings = {}, .pacing = Pacing::kFree, .points = true}).points);
}

TEST(Wire, WorldSurvives) {
  const World in = anyWorld(), out = roundTrip(in);
  EXPECT_EQ(out.serverName, in.serverName);
  EXPECT_EQ(out.session, in.session);
  EXPECT_EQ(out.terrainName, in.terrainName);
  EXPECT_EQ(out.terrainSource, in.terrainSource);
  EXPECT_EQ(out.seed, in.seed);
  EXPECT_EQ(out.contentHash, in.contentHash);
  EXPECT_EQ(out.horizon, in.horizon);
  EXPECT_EQ(out.window, in.window);
  EXPECT_EQ(out.camera, in.camera);
  expectEqual(out.settings, in.settings);
}

TEST(Wire, IterationSurvives) {
  const Iteration in = anyIteration(), out = roundTrip(in);
  EXPECT_EQ(out.number, in.number);
  EXPECT_EQ(out.poseSequence, in.poseSequence);
  EXPECT_EQ(out.gone, in.gone);
  ASSERT_EQ(out.whole.size(), in.whole.size());
  for (std::size_t k = 0; k < in.whole.size(); ++k) {
    EXPECT_EQ(out.whole[k].address, in.whole[k].address);
    EXPECT_EQ(out.whole[k].vertices, in.whole[k].vertices);
    EXPECT_EQ(out.whole[k].triangles, in.whole[k].triangles);
    EXPECT_EQ(out.whole[k].payload, in.whole[k].payload);
  }
  EXPECT_EQ(out.come, in.come);
  EXPECT_EQ(out.points, in.points);
  EXPECT_EQ(out.errors, in.errors);
  EXPECT_EQ(out.shades, in.shades);
  EXPECT_EQ(out.meshHash, in.meshHash);
  EXPECT_EQ(out.settled, in.settled);
  const IterationStats &a = in.figures, &b = out.figures;
  EXPECT_EQ(std::tie(a.selectMs, a.generateMs, a.refineMs, a.triangulateMs, a.encodeMs, a.heights, a.effectiveThreshold),
            std::tie(b.selectMs, b.generateMs, b.refineMs, b.triangulateMs, b.encodeMs, b.heights, b.effectiveThreshold));
  EXPECT_EQ(std::tie(a.leaves, a.visibleLeaves, a.generatedLeaves, a.droppedLeaves, a.triangles, a.inserted, a.removed, a.deferred,
                     a.insertionLimit),
            std::tie(b.leaves, b.visibleLeaves, b.generatedLeaves, b.droppedLeaves, b.triangles, b.inserted, b.removed, b.deferred,
                     b.insertionLimit));
}

TEST(Wire, ErrorSurvivesAndIsCut) {
  const ErrorMessage out = roundTrip(ErrorMessage{.code = ErrorCode::kNotFound, .message = "no session 'x'"});
  EXPECT_EQ(out.code, ErrorCode::kNotFound);
  EXPECT_EQ(out.message, "no session 'x'");
  EXPECT_EQ(roundTrip(ErrorMessage{.code = ErrorCode::kLimit, .message = std::string(10'000, 'x')}).message.size(), kMaxErrorBytes);
}

TEST(Wire, TheGeneratedCodeReadsWhatIsWritten) {  // the schema, not only this room's idea of it
  pb::ServerMessage message;
  ASSERT_TRUE(message.ParseFromString(encode(ServerMessage(anyIteration()))));
  ASSERT_EQ(message.kind_case(), pb::ServerMessage::kIteration);
  EXPECT_EQ(message.iteration().whole(0).payload(), std::string("\0\xff\x07\0\x01", 5));
  EXPECT_FALSE(message.iteration().whole(1).address().i() != -5);
  EXPECT_EQ(message.iteration().mesh_hash(), ~0ull);
  EXPECT_EQ(message.iteration().figures().leaves(), 6u);
  EXPECT_EQ(message.iteration().figures().valid_leaves(), 6u);  // for clients that read the older name
}

TEST(Wire, UnknownFieldsAreIgnored) {
  std::string bytes = encode(ClientMessage(anyHello()));
  bytes += std::string("\xa2\x06\x03new", 6);  // field 100
  EXPECT_TRUE(decodeClient(bytesOf(bytes)));
}

TEST(Wire, AKindOfALaterRevisionIsToldFromNothing) {
  const auto later = decodeServer(bytesOf(kLaterKind));
  ASSERT_TRUE(later);
  EXPECT_TRUE(std::holds_alternative<UnknownKind>(*later));
  EXPECT_FALSE(decodeClient(bytesOf(kLaterKind))) << "a server knows what it is asked, or says that it does not";
}

TEST(Wire, AnotherVersionIsAnsweredNotRefused) {
  pb::ClientMessage client;
  client.mutable_hello()->set_protocol_version(9);
  client.mutable_hello()->set_pacing(static_cast<pb::Pacing>(77));  // means something there
  const auto hello = decodeClient(bytesOf(client.SerializeAsString()));
  ASSERT_TRUE(hello);
  EXPECT_EQ(std::get<Hello>(*hello).protocolVersion, 9u);
  pb::ServerMessage server;
  server.mutable_world()->set_protocol_version(2);
  const auto world = decodeServer(bytesOf(server.SerializeAsString()));
  ASSERT_TRUE(world);
  EXPECT_EQ(std::get<World>(*world).protocolVersion, 2u);
}

// ---- what is refused ----

pb::ClientMessage client(const ClientMessage& message) {
  pb::ClientMessage out;
  EXPECT_TRUE(out.ParseFromString(encode(message)));
  return out;
}
pb::ServerMessage server(const ServerMessage& message) {
  pb::ServerMessage out;
  EXPECT_TRUE(out.ParseFromString(encode(message)));
  return out;
}
void expectRefused(const pb::ClientMessage& message, const std::string& field) {
  const auto decoded = decodeClient(bytesOf(message.SerializeAsString()));
  ASSERT_FALSE(decoded) << field;
  EXPECT_EQ(decoded.error().message.find(field + " "), 0u) << decoded.error().message;
}
void expectRefused(const pb::ServerMessage& message, const std::string& field) {
  const auto decoded = decodeServer(bytesOf(message.SerializeAsString()));
  ASSERT_FALSE(decoded) << field;
  EXPECT_EQ(decoded.error().message.find(field + " "), 0u) << decoded.error().message;
}
const double kBad[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                       -std::numeric_limits<double>::infinity()};

TEST(WireRefuses, Hello) {
  const auto with = [](const std::string& field, auto change) {
    pb::ClientMessage message = client(anyHello());
    change(*message.mutable_hello());
    expectRefused(message, field);
  };
  with("Hello.client_name", [](pb::Hello& m) { m.set_client_name(std::string(129, 'x')); });
  with("Hello.client_name", [](pb::Hello& m) { m.set_client_name("two\nlines"); });
  with("Hello.pacing", [](pb::Hello& m) { m.set_pacing(static_cast<pb::Pacing>(2)); });
  with("Hello.pacing", [](pb::Hello& m) { m.set_pacing(static_cast<pb::Pacing>(-1)); });
  with("Settings.metric", [](pb::Hello& m) { m.mutable_settings()->set_metric(static_cast<pb::Metric>(settings::kMetrics.size())); });
  with("Settings.threshold", [](pb::Hello& m) { m.mutable_settings()->set_threshold(-0.5); });
  for (double bad : kBad) with("Settings.threshold", [&](pb::Hello& m) { m.mutable_settings()->set_threshold(bad); });
  for (double bad : {-0.1, 1.5}) with("Settings.colour_error", [&](pb::Hello& m) { m.mutable_settings()->set_colour_error(bad); });
}

TEST(WireRefuses, Pose) {
  const auto with = [](const std::string& field, auto change) {
    pb::ClientMessage message = client(anyPose());
    change(*message.mutable_pose());
    expectRefused(message, field);
  };
  with("Pose.sequence", [](pb::Pose& m) { m.set_sequence(0); });
  with("Pose.x", [](pb::Pose& m) { m.set_x(lattice::kMaxPosition + 1); });
  with("Pose.x", [](pb::Pose& m) { m.set_x(INT64_MIN); });
  with("Pose.z", [](pb::Pose& m) { m.set_z(INT64_MAX); });
  with("Pose.y", [](pb::Pose& m) { m.set_y(1.1e6); });
  with("Pose.pitch", [](pb::Pose& m) { m.set_pitch(1.6); });
  with("Pose.vertical_fov", [](pb::Pose& m) { m.set_vertical_fov(0); });
  with("Pose.width", [](pb::Pose& m) { m.set_width(0); });
  with("Pose.height", [](pb::Pose& m) { m.set_height(40'000); });
  with("Pose.state", [](pb::Pose& m) { m.set_state(std::string(kMaxStateBytes + 1, 0)); });
  for (double bad : kBad) {
    with("Pose.y", [&](pb::Pose& m) { m.set_y(bad); });
    with("Pose.yaw", [&](pb::Pose& m) { m.set_yaw(bad); });
    with("Pose.pitch", [&](pb::Pose& m) { m.set_pitch(bad); });
    with("Pose.vertical_fov", [&](pb::Pose& m) { m.set_vertical_fov(bad); });
  }
}

TEST(WireRefuses, Addresses) {
  for (auto [level, i] : std::vector<std::pair<std::uint32_t, std::int64_t>>{
           {11, 0}, {~0u, 0}, {0, (std::int64_t{1} << 37) + 1}, {10, std::int64_t{1} << 37}, {3, INT64_MIN}}) {
    pb::ClientMessage resend = client(ResendLeaves{.leaves = {{0, 0, 0}}});
    resend.mutable_resend_leaves()->mutable_leaves(0)->set_level(level);
    resend.mutable_resend_leaves()->mutable_leaves(0)->set_i(i);
    expectRefused(resend, "ResendLeaves.leaves");
    pb::ServerMessage gone = server(anyIteration());
    *gone.mutable_iteration()->mutable_gone(1) = resend.resend_leaves().leaves(0);
    expectRefused(gone, "Iteration.gone");
    pb::ServerMessage whole = server(anyIteration());
    *whole.mutable_iteration()->mutable_whole(0)->mutable_address() = resend.resend_leaves().leaves(0);
    expectRefused(whole, "LeafWhole.address");
    pb::ServerMessage come = server(anyIteration());
    *come.mutable_iteration()->mutable_come(0) = resend.resend_leaves().leaves(0);
    expectRefused(come, "Iteration.come");
    pb::ClientMessage resume = client(anyResume());
    *resume.mutable_resume()->mutable_leaves(1)->mutable_address() = resend.resend_leaves().leaves(0);
    expectRefused(resume, "HeldLeaf.address");
  }
}

TEST(WireRefuses, World) {
  const auto with = [](const std::string& field, auto change) {
    pb::ServerMessage message = server(anyWorld());
    change(*message.mutable_world());
    expectRefused(message, field);
  };
  with("World.server_name", [](pb::World& m) { m.set_server_name(std::string(129, 'x')); });
  with("World.session", [](pb::World& m) { m.set_session(""); });
  with("World.session", [](pb::World& m) { m.set_session("a b"); });
  with("World.terrain_source", [](pb::World& m) { m.set_terrain_source(std::string(kMaxTerrainSourceBytes + 1, ' ')); });
  with("World.step_bits", [](pb::World& m) { m.set_step_bits(9); });
  with("World.window", [](pb::World& m) { m.set_window(0); });
  with("World.window", [](pb::World& m) { m.set_window(65); });
  with("World.horizon", [](pb::World& m) { m.set_horizon(0); });
  for (double bad : kBad) with("World.horizon", [&](pb::World& m) { m.set_horizon(bad); });
}

TEST(WireRefuses, Iteration) {
  const auto with = [](const std::string& field, auto change) {
    pb::ServerMessage message = server(anyIteration());
    change(*message.mutable_iteration());
    expectRefused(message, field);
  };
  with("Iteration.number", [](pb::Iteration& m) { m.set_number(0); });
  with("LeafWhole.triangles", [](pb::Iteration& m) { m.mutable_whole(0)->set_triangles((1u << 20) + 1); });
  with("LeafWhole.vertices", [](pb::Iteration& m) { m.mutable_whole(0)->set_vertices(2); });
  with("LeafWhole.vertices", [](pb::Iteration& m) { m.mutable_whole(0)->set_vertices(7); });
  with("LeafWhole.vertices", [](pb::Iteration& m) { m.mutable_whole(1)->set_vertices(3); });
  with("LeafWhole.payload", [](pb::Iteration& m) { m.mutable_whole(0)->clear_payload(); });
  with("LeafWhole.payload", [](pb::Iteration& m) { m.mutable_whole(1)->set_payload("x"); });
  for (double bad : kBad) with("Iteration.errors", [&](pb::Iteration& m) { m.set_errors(0, static_cast<float>(bad)); });
  for (double bad : kBad) with("Figures.refine_ms", [&](pb::Iteration& m) { m.mutable_figures()->set_refine_ms(bad); });
  with("Figures.effective_threshold", [](pb::Iteration& m) { m.mutable_figures()->set_effective_threshold(-1); });
}

TEST(WireRefuses, TooMuch) {
  EXPECT_NE(decodeClient(bytesOf(std::string(kMaxClientMessageBytes + 1, '\0'))).error().message.find("at most 131072"), std::string::npos);
  EXPECT_NE(decodeServer(bytesOf(std::string(kMaxServerMessageBytes + 1, '\0'))).error().message.find("at most 268435456"),
            std::string::npos);
  // Two bytes an entry on the wire: counted before one is built.
  const auto entries = [](char outerTag, char innerTag, std::size_t n) {
    std::string inner;
    for (std::size_t k = 0; k < n; ++k) inner += {innerTag, '\0'};
    std::string out(1, outerTag);
    for (std::size_t size = inner.size();; size >>= 7) {
      out += static_cast<char>(size >= 0x80 ? (size & 0x7f) | 0x80 : size);
      if (size < 0x80) break;
    }
    return out + inner;
  };
  const auto messageOf = [](const auto& decoded) { return decoded ? std::string("accepted") : decoded.error().message; };
  EXPECT_NE(messageOf(decodeClient(bytesOf(entries(0x22, 0x0a, kMaxResendLeaves + 1)))).find("ResendLeaves.leaves must be at most 4,096"),
            std::string::npos);
  EXPECT_TRUE(decodeClient(bytesOf(entries(0x22, 0x0a, kMaxResendLeaves))));
  EXPECT_NE(messageOf(decodeServer(bytesOf(entries(0x12, 0x1a, 20'000'000)))).find("Iteration.gone must be at most 65,536"),
            std::string::npos);
  EXPECT_NE(messageOf(decodeServer(bytesOf(entries(0x12, 0x22, kMaxIterationLeaves + 1)))).find("Iteration.whole must be at most 65,536"),
            std::string::npos);
  // Split over several occurrences of the same message, which protobuf merges.
  const std::string half = entries(0x12, 0x1a, kMaxIterationLeaves / 2 + 1);
  EXPECT_NE(messageOf(decodeServer(bytesOf(half + half))).find("Iteration.gone must be at most 65,536"), std::string::npos);
}

TEST(Wire, PostsOfEditsSurvive) {
  const FindEdits find = roundTrip(FindEdits{{-5, lattice::kMaxPosition}, 33'500, 7});
  EXPECT_EQ(find.at, (lattice::Point{-5, lattice::kMaxPosition}));
  EXPECT_EQ(find.radius, 33'500);
  EXPECT_EQ(find.since, 7u);
  const FoundEdits found = roundTrip(FoundEdits{9, {{-1, -2, 3, 4}}, {{-7, 8}, {0, 0}}});
  EXPECT_EQ(found.edit, 9u);
  EXPECT_EQ(found.changed, (std::vector<lattice::Area>{{-1, -2, 3, 4}}));
  EXPECT_EQ(found.squares, (std::vector<terrain::TileAddress>{{-7, 8}, {0, 0}}));
  EXPECT_EQ(roundTrip(WantSquares{{{-7, 8}}}).squares, (std::vector<terrain::TileAddress>{{-7, 8}}));
  const Squares squares = roundTrip(Squares{9, {{{-7, 8}, {1, 2}, {3}}, {{1, 1}, {}, {}}}});
  EXPECT_EQ(squares.edit, 9u);
  ASSERT_EQ(squares.squares.size(), 2u);
  EXPECT_EQ(squares.squares[0].rises, (std::vector<std::uint8_t>{1, 2}));
  EXPECT_EQ(squares.squares[0].materials, (std::vector<std::uint8_t>{3}));
  EXPECT_FALSE(decodeClient(bytesOf(encode(ClientMessage(FindEdits{{}, 2 * kMaxReach, 0})))));
  EXPECT_FALSE(decodeServer(bytesOf(encode(ServerMessage(Squares{1, {{{}, std::vector<std::uint8_t>(terrain::kMaxTileBytes + 1), {}}}})))));
}

// Entries that protobuf could not even parse: the refusal names the list, so it was counted before anything was built.
TEST(WireRefuses, TooManyEntriesBeforeTheyAreBuilt) {
  const auto nested = [](const std::string& tag, const std::string& content) {
    std::string out = tag;
    for (std::size_t size = content.size();; size >>= 7) {
      out += static_cast<char>(size >= 0x80 ? (size & 0x7f) | 0x80 : size);
      if (size < 0x80) return out + content;
    }
  };
  const auto list = [&](const std::string& tag, std::size_t most) {
    std::string out;
    for (std::size_t k = 0; k <= most; ++k) out += nested(tag, "\x0b");
    return out;
  };
  const std::string far = "\xa2\x01";  // field 20
  for (const auto& [name, bytes] :
       std::vector<std::pair<std::string, std::string>>{{"ResendLeaves.leaves", nested("\x22", list("\x0a", kMaxResendLeaves))},
                                                        {"Resume.leaves", nested("\x2a", list("\x0a", kMaxResumeLeaves))},
                                                        {"WantSquares.squares", nested("\xca\x01", list("\x0a", kMaxSquares))},
                                                        {"WantTiles.tiles", nested(far, list("\x0a", kMaxTiles))}}) {
    const auto decoded = decodeClient(bytesOf(bytes));
    ASSERT_FALSE(decoded) << name;
    EXPECT_EQ(decoded.error().message.find(name + " must be at most "), 0u) << decoded.error().message;
  }
  const auto rays = decodeClient(bytesOf(nested("\x52", nested("\x22", list("\x0a", kMaxRays)))));
  ASSERT_TRUE(rays) << rays.error().message;
  EXPECT_EQ(std::get<Query>(*rays).refusal, "Rays.rays must be at most 256 entries");
  for (const auto& [name, bytes] :
       std::vector<std::pair<std::string, std::string>>{{"Iteration.gone", nested("\x12", list("\x1a", kMaxIterationLeaves))},
                                                        {"Iteration.whole", nested("\x12", list("\x22", kMaxIterationLeaves))},
                                                        {"Iteration.come", nested("\x12", list("\x52", kMaxIterationLeaves))},
                                                        {"Members.joined", nested("\x22", list("\x0a", kMaxMembers))},
                                                        {"Members.moved", nested("\x22", list("\x12", kMaxMembers))},
                                                        {"Ground.leaves", nested("\x3a", list("\x1a", kMaxIterationLeaves))},
                                                        {"FoundEdits.changed", nested("\x52", list("\x12", kMaxFoundAreas))},
                                                        {"FoundEdits.squares", nested("\x52", list("\x1a", kMaxFoundSquares))},
                                                        {"Squares.squares", nested("\x5a", list("\x12", kMaxSquares))},
                                                        {"HeightTiles.tiles", nested(far, list("\x0a", kMaxTiles))}}) {
    const auto decoded = decodeServer(bytesOf(bytes));
    ASSERT_FALSE(decoded) << name;
    EXPECT_EQ(decoded.error().message.find(name + " must be at most "), 0u) << decoded.error().message;
  }
}

TEST(WireRefuses, EmptyAndForeign) {
  EXPECT_FALSE(decodeClient({}));
  EXPECT_FALSE(decodeServer({}));
  EXPECT_FALSE(decodeServer(bytesOf("GET / HTTP/1.1\r\n\r\n")));
  // A message that holds itself a hundred thousand times.
  EXPECT_FALSE(decodeClient(bytesOf(std::string(100'000, '\x0b'))));
}

template <class Decode, class Encode>
void expectTruncationsRefused(const std::string& bytes, Decode decode, Encode encodeAgain) {
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const std::vector<char> fresh(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length));
    const auto decoded = decode(std::span<const std::uint8_t>(reinterpret_cast<const std::uint8_t*>(fresh.data()), fresh.size()));
    // The outer message is one field, so no prefix of it is well-formed.
    EXPECT_FALSE(decoded) << length << " of " << bytes.size();
  }
  Random random(bytes.size());
  for (int round = 0; round < 5000; ++round) {
    std::string changed = bytes;
    for (int k = 0; k < 1 + round % 3; ++k) changed[random() % changed.size()] ^= static_cast<char>(1u << (random() % 8));
    const auto decoded = decode(bytesOf(changed));
    if (decoded) {
      EXPECT_TRUE(decode(bytesOf(encodeAgain(*decoded))));  // what is accepted is valid
    } else {
      EXPECT_FALSE(decoded.error().message.empty());
    }
  }
}

TEST(WireRefuses, TruncatedAndDamagedMessages) {
  for (const ClientMessage& m : {ClientMessage(anyHello()), ClientMessage(anyPose()), ClientMessage(Acknowledge{4, 5}),
                                 ClientMessage(ResendLeaves{{{0, 1, 2}, {3, 4, 5}}}), ClientMessage(anyResume())})
    expectTruncationsRefused(
        encode(m), [](auto bytes) { return decodeClient(bytes); }, [](const ClientMessage& d) { return encode(d); });
  for (const ServerMessage& m :
       {ServerMessage(anyWorld()), ServerMessage(anyIteration()), ServerMessage(ErrorMessage{ErrorCode::kLimit, "too much"})})
    expectTruncationsRefused(
        encode(m), [](auto bytes) { return decodeServer(bytes); },
        [](const ServerMessage& d) { return std::holds_alternative<UnknownKind>(d) ? kLaterKind : encode(d); });
}

}  // namespace
}  // namespace ridgecast::wire
