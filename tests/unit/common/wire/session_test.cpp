// Sessions' names; members, clock, queries and grounds survive the wire; what is out of range is refused with the field's name.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "common/wire/wire.h"
#include "ridgecast/v1/stream.pb.h"
#include "tests/support/bytes.h"

namespace ridgecast::wire {
namespace {

using testing_support::bytesOf;

namespace pb = ridgecast::v1;

template <class Message>
Message throughServer(const Message& message) {  // from a client
  const auto decoded = decodeClient(bytesOf(encode(ClientMessage(message))));
  EXPECT_TRUE(decoded) << decoded.error().message;
  return decoded ? std::get<Message>(*decoded) : Message{};
}
template <class Message>
Message throughClient(const Message& message) {  // from a server
  const auto decoded = decodeServer(bytesOf(encode(ServerMessage(message))));
  EXPECT_TRUE(decoded) << decoded.error().message;
  return decoded ? std::get<Message>(*decoded) : Message{};
}
Moved moved(std::uint64_t camera, std::uint64_t sequence) {
  Moved m{camera, {sequence, {}}, 5'000'000};
  m.pose.camera.pose = {.x = -lattice::kMaxPosition, .z = 77, .remainderX = 0, .remainderZ = 0, .y = 5.5, .yaw = -1, .pitch = 0.5};
  m.pose.state.assign(kMaxStateBytes, 0xff);
  return m;
}

TEST(WireSession, AHelloSaysWhatItsClientWants) {
  Hello hello;
  hello.role = Role::kSensor;
  hello.members = hello.errors = true;
  const Hello out = throughServer(hello);
  EXPECT_EQ(out.role, Role::kSensor);
  EXPECT_TRUE(out.members && out.errors && !out.clock);
  // A role of a later revision is a viewer, no error.
  pb::ClientMessage later;
  later.mutable_hello()->set_protocol_version(1);
  later.mutable_hello()->set_role(static_cast<pb::Role>(17));
  const auto read = decodeClient(bytesOf(later.SerializeAsString()));
  ASSERT_TRUE(read);
  EXPECT_EQ(std::get<Hello>(*read).role, Role::kViewer);
}

TEST(WireSession, AWorldOfAnOlderServerHasNoRevision) {
  World world;
  world.session = "default";
  world.horizon = world.window = 1;
  EXPECT_EQ(throughClient(world).revision, kRevision);
  world.revision = 0;
  EXPECT_EQ(throughClient(world).revision, 0u);
}

TEST(WireSession, ChangesOfSettingsSurviveAndAreJudged) {
  const Settings asked{Metric::kArea, 2.5, 70'000, 1'000'000};
  EXPECT_EQ(throughServer(ChangeSettings{asked}).settings, asked);
  EXPECT_EQ(throughClient(Granted{asked}).settings, asked);
  for (const Settings& wrong : {Settings{Metric::kPixels, -1, 0, 0}, Settings{Metric::kPixels, std::nan(""), 0, 0},
                                Settings{Metric::kPixels, 1e13, 0, 0}, Settings{static_cast<Metric>(9), 1, 0, 0}}) {
    const std::string bytes = encode(ClientMessage(ChangeSettings{wrong}));
    const auto read = decodeClient({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    ASSERT_FALSE(read);
    EXPECT_NE(read.error().message.find("Settings."), std::string::npos) << read.error().message;
  }
}

TEST(WireSession, CandidatesSurviveAndAreAskedForBySettings) {
  Settings asked;
  asked.candidates = 12'345;
  EXPECT_EQ(throughServer(ChangeSettings{asked}).settings, asked);
  Iteration in;
  in.number = 1;
  EXPECT_FALSE(throughClient(in).candidates);
  in.candidates.emplace();
  ASSERT_TRUE(throughClient(in).candidates);  // none is not the same as not told
  EXPECT_TRUE(throughClient(in).candidates->empty());
  const lattice::Step far = lattice::kMaxPosition;
  for (std::uint32_t k = 0; k < kMaxCandidates; ++k)
    in.candidates->push_back(
        {{far - 9'000'000 + k * 400, -far + k, static_cast<std::int32_t>(k) - 10'000}, 20'000.0f - static_cast<float>(k)});
  in.candidates->back() = {{far, -far, -lattice::kMaxHeight}, 0};
  const std::string bytes = encode(ServerMessage(in));
  EXPECT_LT(bytes.size(), std::size_t{16} * kMaxCandidates);
  EXPECT_EQ(throughClient(in).candidates, in.candidates);
}

TEST(WireSession, MembersSurvive) {
  Members in;
  in.joined = {{7, Role::kSensor, "lidar", moved(7, 3)}, {8, Role::kViewer, "", {}}};
  in.moved = {moved(9, 1ull << 40)};
  in.left = {1, ~0ull};
  const Members out = throughClient(in);
  ASSERT_EQ(out.joined.size(), 2u);
  EXPECT_EQ(out.joined[0].name, "lidar");
  EXPECT_EQ(out.joined[0].role, Role::kSensor);
  ASSERT_TRUE(out.joined[0].moved);
  EXPECT_EQ(out.joined[0].moved->camera, 7u);
  EXPECT_EQ(out.joined[0].moved->pose.camera.pose, in.joined[0].moved->pose.camera.pose);
  EXPECT_FALSE(out.joined[1].moved);
  ASSERT_EQ(out.moved.size(), 1u);
  EXPECT_EQ(out.moved[0].pose.sequence, 1ull << 40);
  EXPECT_EQ(out.moved[0].time, 5'000'000u);
  EXPECT_EQ(out.joined[0].moved->pose.state, in.joined[0].moved->pose.state);
  EXPECT_EQ(out.moved[0].pose.state, in.moved[0].pose.state);
  EXPECT_EQ(out.left, in.left);
  EXPECT_TRUE(throughClient(Members{}).joined.empty());
}

TEST(WireSession, ClockMessagesSurvive) {
  Clock in{ClockMode::kScaled, 2.5, kMaxTime, 3, 4, {5, 6}, 7, "Member 5 was passed over.", kMaxTime - 1};
  const Clock out = throughClient(in);
  EXPECT_EQ(out.mode, in.mode);
  EXPECT_EQ(out.rate, in.rate);
  EXPECT_EQ(out.time, in.time);
  EXPECT_EQ(out.owner, in.owner);
  EXPECT_EQ(out.step, in.step);
  EXPECT_EQ(out.waitsFor, in.waitsFor);
  EXPECT_EQ(out.echo, in.echo);
  EXPECT_EQ(out.notice, in.notice);
  EXPECT_EQ(out.end, in.end);
  EXPECT_EQ(throughServer(AskClock{12}).echo, 12u);
  const SetClock set = throughServer(SetClock{true, ClockMode::kStepped, 0.5, kMaxTime});
  EXPECT_TRUE(set.own);
  EXPECT_EQ(set.mode, ClockMode::kStepped);
  EXPECT_EQ(set.rate, 0.5);
  EXPECT_EQ(set.time, kMaxTime);
  const ClockStep step = throughServer(ClockStep{kMaxStepTime, true});
  EXPECT_EQ(step.time, kMaxStepTime);
  EXPECT_TRUE(step.wait);
  EXPECT_EQ(throughServer(StepDone{9}).step, 9u);
  EXPECT_EQ(throughServer(PassOver{~0ull}).camera, ~0ull);
}

TEST(WireSession, QueriesAndAnswersSurvive) {
  Query heights;
  heights.id = 3;
  for (std::size_t k = 0; k < kMaxPlaces; ++k) {
    heights.x.push_back(static_cast<lattice::Step>(k) - 4000);
    heights.z.push_back(lattice::kMaxPosition - static_cast<lattice::Step>(k));
  }
  Query out = throughServer(heights);
  EXPECT_EQ(out.id, 3u);
  EXPECT_EQ(out.kind, QueryKind::kHeights);
  EXPECT_EQ(out.x, heights.x);
  EXPECT_EQ(out.z, heights.z);
  Query normals{1, QueryKind::kNormals, {5}, {-6}, 9, {}};
  out = throughServer(normals);
  EXPECT_EQ(out.kind, QueryKind::kNormals);
  EXPECT_EQ(out.spacing, 9u);
  Query rays;
  rays.kind = QueryKind::kRays;
  EXPECT_EQ(throughServer(rays).kind, QueryKind::kRays) << "none is a query, too";
  rays.rays.assign(kMaxRays, {1, -2, 3.5, 0, -1e-3, 1e6, kMaxReach});
  out = throughServer(rays);
  ASSERT_EQ(out.rays.size(), kMaxRays);
  EXPECT_EQ(out.rays[7].z, -2);
  EXPECT_EQ(out.rays[7].directionY, -1e-3);
  EXPECT_EQ(out.rays[7].reach, kMaxReach);

  Answer answer{4, {1.5f, -0.0f, 1e30f}, {0, 1, 0}, {-1, 12.25}};
  const Answer read = throughClient(answer);
  EXPECT_EQ(read.heights, answer.heights);
  EXPECT_TRUE(std::signbit(read.heights[1]));
  EXPECT_EQ(read.normals, answer.normals);
  EXPECT_EQ(read.distances, answer.distances);
}

TEST(WireSession, GroundsAndErrorsOfLeavesSurvive) {
  const AskGround ask = throughServer(AskGround{5, {1, -2}, 30, 0.05});
  EXPECT_EQ(ask.at, (lattice::Point{1, -2}));
  EXPECT_EQ(ask.radius, 30);
  EXPECT_EQ(ask.error, 0.05);
  Ground ground{5, 0.25, {{{3, 5, 6}, 4, 2, {0, 255}, 0.125f}}};
  const Ground out = throughClient(ground);
  EXPECT_EQ(out.error, 0.25);
  ASSERT_EQ(out.leaves.size(), 1u);
  EXPECT_EQ(out.leaves[0].error, 0.125f);
  Iteration it;
  it.number = 1;
  it.errors = {2.5f};
  EXPECT_EQ(throughClient(it).errors, it.errors);
}

std::string whyServer(const std::function<void(pb::ClientMessage&)>& fill) {
  pb::ClientMessage m;
  fill(m);
  const auto out = decodeClient(bytesOf(m.SerializeAsString()));
  if (!out) return out.error().message;
  const auto* query = std::get_if<Query>(&*out);  // of rays alone
  return query ? query->refusal : "";
}
std::string whyClient(const std::function<void(pb::ServerMessage&)>& fill) {
  pb::ServerMessage m;
  fill(m);
  const auto out = decodeServer(bytesOf(m.SerializeAsString()));
  return out ? "" : out.error().message;
}
void expectNames(const std::string& error, const std::string& field) {
  EXPECT_NE(error.find(field), std::string::npos) << "'" << error << "' should name " << field;
}

TEST(WireSession, WhatIsOutOfRangeIsRefusedByName) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  expectNames(whyServer([](auto& m) { m.mutable_set_clock()->set_rate(1001); }), "SetClock.rate");
  expectNames(whyServer([&](auto& m) { m.mutable_set_clock()->set_rate(kNan); }), "SetClock.rate");
  expectNames(whyServer([](auto& m) { m.mutable_set_clock()->set_mode(static_cast<pb::ClockMode>(3)); }), "SetClock.mode");
  expectNames(whyServer([](auto& m) { m.mutable_step(); }), "Step.time");
  expectNames(whyServer([](auto& m) { m.mutable_step()->set_time(kMaxStepTime + 1); }), "Step.time");
  expectNames(whyServer([](auto& m) { m.mutable_query(); }), "Query");
  expectNames(whyServer([](auto& m) { m.mutable_query()->mutable_heights()->add_x(1); }), "Places.z");
  expectNames(whyServer([](auto& m) {
                for (std::size_t k = 0; k <= kMaxPlaces; ++k) m.mutable_query()->mutable_heights()->add_x(1);
              }),
              "Places.x");
  expectNames(whyServer([](auto& m) {
                m.mutable_query()->mutable_normals()->add_x(lattice::kMaxPosition + 1);
                m.mutable_query()->mutable_normals()->add_z(0);
              }),
              "Places");
  expectNames(whyServer([](auto& m) { m.mutable_query()->mutable_rays()->add_rays(); }), "Ray.direction");
  expectNames(whyServer([&](auto& m) {
                auto& ray = *m.mutable_query()->mutable_rays()->add_rays();
                ray.set_direction_x(1);
                ray.set_y(kNan);
              }),
              "Ray.y");
  expectNames(whyServer([](auto& m) {
                for (std::size_t k = 0; k <= kMaxRays; ++k) m.mutable_query()->mutable_rays()->add_rays()->set_direction_x(1);
              }),
              "Rays.rays");
  for (const double radius : {0.0, 4097.0, kNan})
    expectNames(whyServer([&](auto& m) {
                  m.mutable_ask_ground()->set_radius(radius);
                  m.mutable_ask_ground()->set_error(1);
                }),
                "AskGround.radius");
  expectNames(whyServer([](auto& m) {
                m.mutable_ask_ground()->set_radius(10);
                m.mutable_ask_ground()->set_error(0);
              }),
              "AskGround.error");
  const auto candidates = [&](auto change) {
    return whyClient([&](auto& m) {
      m.mutable_iteration()->set_number(1);
      auto& c = *m.mutable_iteration()->mutable_candidates();
      for (const int v : {1, 2, 3}) c.add_points(v);
      c.add_errors(1);
      change(c);
    });
  };
  expectNames(candidates([](auto& c) { c.add_points(1); }), "Candidates.points");
  expectNames(candidates([](auto& c) { c.add_errors(1); }), "Candidates.points");
  expectNames(candidates([](auto& c) { c.set_x(lattice::kMaxPosition + 1); }), "Candidates.x");
  expectNames(candidates([](auto& c) { c.set_x(lattice::kMaxPosition); }), "Candidates.points");
  expectNames(candidates([](auto& c) { c.set_points(1, (1 << 27) + 1); }), "Candidates.points");
  expectNames(candidates([](auto& c) { c.set_points(0, std::numeric_limits<std::int32_t>::min()); }), "Candidates.points");
  expectNames(candidates([](auto& c) { c.set_points(2, lattice::kMaxHeight + 1); }), "Candidates.points");
  for (const float wrong : {-1.0f, 2e9f, static_cast<float>(kNan)})
    expectNames(candidates([&](auto& c) { c.set_errors(0, wrong); }), "Candidates.errors");
  expectNames(candidates([](auto& c) {
                for (std::uint32_t k = 0; k < kMaxCandidates; ++k) c.add_errors(1);
              }),
              "Candidates.errors");
  expectNames(candidates([](auto& c) { c.mutable_points()->Resize(1 << 20, 0); }), "Iteration.candidates");  // counted before they are read
  expectNames(whyClient([](auto& m) { m.mutable_members()->add_moved(); }), "Moved.pose");
  expectNames(whyClient([](auto& m) { m.mutable_members()->add_joined()->set_name("a\nb"); }), "Member.name");
  expectNames(whyClient([](auto& m) {
                for (std::size_t k = 0; k <= kMaxMembers; ++k) m.mutable_members()->add_joined();
              }),
              "Members.joined");
  expectNames(whyClient([](auto& m) { m.mutable_clock()->set_time(kMaxTime + 1); }), "Clock.time");
  expectNames(whyClient([&](auto& m) { m.mutable_clock()->set_rate(kNan); }), "Clock.rate");
  expectNames(whyClient([&](auto& m) { m.mutable_ground()->set_error(kNan); }), "Ground.error");
  expectNames(whyClient([](auto& m) { m.mutable_answer()->mutable_heights()->Resize(static_cast<int>(5 << 20), 0); }), "16 MiB");
}

TEST(SessionNames, AreShortAndPlain) {
  for (const char* good : {"default", "a", "A.b_c-9", "1"}) EXPECT_TRUE(sessionNameIsValid(good));
  for (const char* bad : {"", "a b", "a/b", "a%20", "\xc3\xa4"}) EXPECT_FALSE(sessionNameIsValid(bad));
  EXPECT_TRUE(sessionNameIsValid(std::string(64, 'x')));
  EXPECT_FALSE(sessionNameIsValid(std::string(65, 'x')));
}

}  // namespace
}  // namespace ridgecast::wire
