// What a client says, when, and what it does not let a server say.
#include "client/core/conversation/conversation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "common/wire/wire.h"
#include "tests/support/bytes.h"

namespace ridgecast::core {
namespace {

using namespace std::chrono_literals;
using Instant = Conversation::Instant;
using testing_support::bytesOf;

constexpr Instant kBegin{1h};

wire::World world(std::uint32_t revision = wire::kRevision, std::uint32_t window = 3) {
  return {.serverName = "a test",
          .session = "default",
          .terrainName = "alpine",
          .terrainSource = {},
          .horizon = 1000,
          .window = window,
          .camera = 1,
          .revision = revision};
}

// A conversation, and the server that it has with it.
struct Talk {
  explicit Talk(const wire::Hello& hello = {}) : conversation(hello, "the server at here") {}
  Talk(const wire::Hello& hello, const wire::World& greeting) : Talk(hello) { EXPECT_EQ(hears(greeting), ""); }

  std::string hears(const std::string& bytes) {
    const Wrong wrong = conversation.heard(bytesOf(bytes), now);
    return wrong.value_or("");
  }
  std::string hears(const wire::ServerMessage& message) { return hears(wire::encode(message)); }
  std::optional<wire::ClientMessage> says() {
    const std::optional<std::string> frame = conversation.next(now);
    if (!frame) return std::nullopt;
    auto message = wire::decodeClient(bytesOf(*frame));
    EXPECT_TRUE(message) << message.error().message;
    return *message;
  }
  template <class Message>
  Message saysA() {
    const auto message = says();
    EXPECT_TRUE(message && std::holds_alternative<Message>(*message));
    return message && std::holds_alternative<Message>(*message) ? std::get<Message>(*message) : Message{};
  }
  void isSilent() { EXPECT_FALSE(says()); }

  Conversation conversation;
  Instant now = kBegin;
};

std::string iteration(std::uint64_t number, std::size_t payload = 0) {
  wire::Iteration it;
  it.number = number;
  if (payload > 0) it.whole = {{.address = {}, .vertices = 3, .triangles = 1, .payload = std::vector<std::uint8_t>(payload)}};
  return wire::encode(wire::ServerMessage(it));
}
void expectHas(const std::string& text, const std::string& part) { EXPECT_NE(text.find(part), std::string::npos) << text; }

TEST(Conversation, BeginsWithHelloAndIsSilentUntilTheWorldIsThere) {
  Talk talk({.clientName = "a client"});
  EXPECT_EQ(std::get<wire::Hello>(*wire::decodeClient(bytesOf(talk.conversation.hello()))).clientName, "a client");
  EXPECT_FALSE(talk.conversation.send({.sequence = 1, .camera = {}}));
  talk.isSilent();
  EXPECT_FALSE(talk.conversation.due());
  EXPECT_EQ(talk.hears(world()), "");
  EXPECT_EQ(talk.saysA<wire::PoseMessage>().sequence, 1u);
  EXPECT_EQ(talk.conversation.bytes(), wire::encode(wire::ServerMessage(world())).size());
}

TEST(Conversation, WhatIsMostUrgentLeavesFirst) {
  Talk talk({}, world());
  Conversation& c = talk.conversation;
  c.ask(wire::AskGround{0, {}, 10, 1}, [](auto) {});
  wire::Query query;
  query.x = query.z = {5};
  c.ask(query, [](auto) {});
  EXPECT_FALSE(c.step({1, false}));
  EXPECT_FALSE(c.send({.sequence = 1, .camera = {}}));
  EXPECT_FALSE(c.change({.threshold = 2}));
  EXPECT_FALSE(c.acknowledge({1, 1}));
  EXPECT_FALSE(c.acknowledge({2, 2}));
  EXPECT_FALSE(c.resend({.leaves = {{0, 1, 2}}}));
  EXPECT_FALSE(c.resume({{{{0, 1, 2}, 7}}}));
  talk.saysA<wire::Resume>();
  talk.saysA<wire::ResendLeaves>();  // before the hash that it explains
  EXPECT_EQ(talk.saysA<wire::Acknowledge>().iteration, 2u);
  talk.saysA<wire::ChangeSettings>();
  talk.saysA<wire::PoseMessage>();
  talk.saysA<wire::ClockStep>();
  talk.saysA<wire::Query>();
  talk.saysA<wire::AskGround>();
  talk.isSilent();
}

TEST(Conversation, FreePacingSendsTheNewestPoseAndLockstepEvery) {
  Talk free({}, world()), lockstep({.pacing = wire::Pacing::kLockstep}, world());
  for (std::uint64_t n = 1; n <= kMaxPoses; ++n) {
    EXPECT_FALSE(free.conversation.send({.sequence = n, .camera = {}}));
    EXPECT_FALSE(lockstep.conversation.send({.sequence = n, .camera = {}}));
  }
  expectHas(lockstep.conversation.send({.sequence = 65, .camera = {}}).value_or(""), "64 poses wait to leave");
  EXPECT_EQ(free.saysA<wire::PoseMessage>().sequence, kMaxPoses);
  for (std::uint64_t n = 1; n <= kMaxPoses; ++n) EXPECT_EQ(lockstep.saysA<wire::PoseMessage>().sequence, n);
  free.isSilent();
}

TEST(Conversation, StepsThatCannotLeaveEndIt) {
  Talk talk({}, world());
  for (std::size_t n = 0; n < kMaxWaiting; ++n) EXPECT_FALSE(talk.conversation.step({1, false}));
  EXPECT_EQ(talk.conversation.step({1, false}), "256 messages wait to leave; send fewer at a time");
}

TEST(Conversation, LeavesToBeSentAgainAreCollected) {
  Talk talk({}, world());
  EXPECT_FALSE(talk.conversation.resend({.leaves = {{0, 1, 2}}}));
  EXPECT_FALSE(talk.conversation.resend({.leaves = {{0, 1, 3}, {0, 1, 4}}}));
  EXPECT_EQ(talk.saysA<wire::ResendLeaves>().leaves.size(), 3u);
  EXPECT_FALSE(talk.conversation.resend({.leaves = std::vector<lattice::LeafAddress>(wire::kMaxResendLeaves + 1)}));
  EXPECT_FALSE(talk.conversation.resend({.leaves = {{0, 1, 2}}}));
  EXPECT_TRUE(talk.saysA<wire::ResendLeaves>().leaves.empty()) << "all";
}

// Questions about the time leave ahead of all else: five at 20 ms, then one a second, and one behind each change of the clock.
TEST(Conversation, AsksForTheTime) {
  Talk talk({.clock = true}, world());
  for (int n = 0; n < 20; ++n) {
    EXPECT_FALSE(talk.conversation.send({.sequence = 1, .camera = {}}));
    ASSERT_EQ(talk.conversation.due(), talk.now);
    EXPECT_EQ(talk.saysA<wire::AskClock>().echo, static_cast<std::uint64_t>(n + 1));
    talk.saysA<wire::PoseMessage>();
    talk.isSilent();
    talk.now += n < 5 ? 20ms : 1000ms;
  }
  talk.now -= 999ms;  // long before the next
  EXPECT_FALSE(talk.conversation.setClock({}));
  EXPECT_FALSE(talk.conversation.clock().isSettled());
  talk.saysA<wire::SetClock>();
  const std::uint64_t echo = talk.saysA<wire::AskClock>().echo;
  EXPECT_EQ(talk.hears(wire::Clock{.echo = echo - 1}), "");
  EXPECT_FALSE(talk.conversation.clock().isSettled());
  EXPECT_EQ(talk.hears(wire::Clock{.echo = echo}), "");
  EXPECT_TRUE(talk.conversation.clock().isSettled());
}

TEST(Conversation, StepsMayBeSkipped) {
  Talk talk({}, world());
  wire::Clock waits;
  waits.mode = wire::ClockMode::kStepped;
  waits.step = 4;
  waits.waitsFor = {1, 2};
  EXPECT_EQ(talk.hears(waits), "");
  talk.isSilent();
  EXPECT_FALSE(talk.conversation.skipSteps(true));
  EXPECT_EQ(talk.saysA<wire::StepDone>().step, 4u);
  waits.step = 5;
  EXPECT_EQ(talk.hears(waits), "");
  EXPECT_EQ(talk.saysA<wire::StepDone>().step, 5u);
  waits.waitsFor = {2};
  EXPECT_EQ(talk.hears(waits), "");
  talk.isSilent();
}

TEST(Conversation, EachRequestIsAnsweredOnce) {
  Talk talk({}, world());
  std::vector<std::string> told(kMaxWaiting + 3);
  for (std::string& one : told) {
    wire::Query query;
    query.x = query.z = {5};
    talk.conversation.ask(query, [&one](const Outcome<wire::Answer>& answer) {
      EXPECT_EQ(one, "");
      one = answer ? "edit " + std::to_string(answer->edit) : answer.error().message;
    });
  }
  for (std::size_t n = kMaxWaiting; n < told.size(); ++n) EXPECT_EQ(told[n], "more than 256 questions wait for the server");
  std::vector<std::uint64_t> asked;
  for (std::size_t n = 0; n < wire::kMaxQueries; ++n) asked.push_back(talk.saysA<wire::Query>().id);
  talk.isSilent();
  EXPECT_EQ(talk.hears(wire::Answer{.id = asked[5], .edit = 9}), "");
  EXPECT_EQ(talk.hears(wire::Answer{.id = asked[6], .refusal = "Not this."}), "");
  EXPECT_EQ(told[5], "edit 9");
  EXPECT_EQ(told[6], "Not this.");
  EXPECT_EQ(talk.hears(wire::Answer{.id = asked[5]}), "the server at here broke the protocol: an answer to no query");
  talk.conversation.end({"over"});
  EXPECT_EQ(std::ranges::count(told, "over"), static_cast<std::ptrdiff_t>(kMaxWaiting) - 2);
}

TEST(Conversation, IterationsWaitAtMostAsManyAsTheWindow) {
  Talk talk({}, world());
  for (std::uint64_t n = 1; n <= 3; ++n) EXPECT_EQ(talk.hears(iteration(n)), "");
  EXPECT_EQ(talk.conversation.receive()->iteration.number, 1u);
  EXPECT_EQ(talk.hears(iteration(4)), "");
  expectHas(talk.hears(iteration(5)), "the server at here sent more than the 3 iterations it may");
  for (std::uint64_t n = 2; n <= 4; ++n) EXPECT_EQ(talk.conversation.receive()->iteration.number, n);
  EXPECT_FALSE(talk.conversation.receive());

  Talk large({}, world(wire::kRevision, 64));
  const std::string bytes = iteration(1, 24 << 20);
  for (int n = 0; n < 10; ++n) EXPECT_EQ(large.hears(bytes), "");
  expectHas(large.hears(bytes), "256 MiB of iterations");
  EXPECT_TRUE(large.conversation.receive());
  EXPECT_EQ(large.hears(bytes), "") << "there is room again";
}

TEST(Conversation, WhatNobodyAskedForEndsIt) {
  wire::HeightTiles tiles;
  tiles.tiles.resize(1);
  wire::Squares squares;
  squares.squares.resize(1);
  const wire::Edited edits{{{1, {}, {}, {}, {}}}};
  for (const auto& [message, says] :
       std::vector<std::pair<wire::ServerMessage, std::string>>{{world(), "sent a second world"},
                                                                {tiles, "sent tiles of heights that were not requested"},
                                                                {squares, "sent squares of edits that were not requested"},
                                                                {wire::FoundEdits{}, "where edits are, without being asked"},
                                                                {wire::Members{{}, {}, {7}}, "broke the protocol"},
                                                                {edits, "edits that leave a gap, or that nobody wanted"},
                                                                {wire::Ground{}, "a ground that was not requested"},
                                                                {wire::EditAnswer{}, "an answer to no edit"}}) {
    Talk early, talk({}, world());
    if (message.index() != wire::ServerMessage(world()).index()) expectHas(early.hears(message), "before its world");
    expectHas(talk.hears(message), says);
  }
  Talk talk({}, world());
  EXPECT_FALSE(talk.conversation.want(wire::WantTiles{{{0, 0}}}));
  EXPECT_FALSE(talk.conversation.want(wire::WantSquares{{{0, 0}}}));
  EXPECT_EQ(talk.hears(tiles), "");
  EXPECT_EQ(talk.hears(squares), "");
  EXPECT_EQ(talk.conversation.takeTiles().size(), 1u);
  EXPECT_EQ(talk.conversation.takeEditsFound().squares.size(), 1u);
  expectHas(talk.hears(tiles), "not requested");
  expectHas(talk.hears(squares), "not requested");
}

TEST(Conversation, EditsAreFollowedWithoutAGap) {
  wire::World greeting = world();
  greeting.compacted = 7;
  Talk talk({.edits = true, .editsAfter = 5}, greeting);
  EXPECT_EQ(talk.hears(wire::Edited{{{8, {}, {}, {}, {}}, {9, {}, {}, {}, {}}}}), "");
  EXPECT_EQ(talk.conversation.takeEdits().made.size(), 2u);
  expectHas(talk.hears(wire::Edited{{{11, {}, {}, {}, {}}}}), "leave a gap");
}

TEST(Conversation, AFarewellSaysWhereToGo) {
  Talk talk({}, world());
  EXPECT_EQ(talk.hears(wire::ErrorMessage{wire::ErrorCode::kGoingAway, "Closing\nnow.", "ws://b:1"}),
            "the server at here says: Closing now.");
  EXPECT_EQ(talk.conversation.sentTo(), "ws://b:1");
  Talk refused;
  EXPECT_EQ(refused.hears(wire::ErrorMessage{wire::ErrorCode::kInvalid, "No."}), "the server at here says: No.");
  EXPECT_FALSE(refused.conversation.sentTo());
}

TEST(Conversation, AnotherVersionAndNonsenseAreTold) {
  wire::World other = world();
  other.protocolVersion = 2;
  Talk talk;
  expectHas(talk.hears(other), "speaks protocol version 2, this client 1");
  EXPECT_FALSE(talk.conversation.hasWorld());
  expectHas(talk.hears("garbage"), "the server at here sent something that cannot be read: ");
}

// ---- neighbouring revisions ----

TEST(Conversation, ALaterServersNewsAreIgnored) {
  const std::string field("\xa2\x06\x03new", 6), kind("\x92\x7d\x02hi", 5);  // a field 100; a message with nothing but field 2002
  Talk talk;
  EXPECT_EQ(talk.hears(wire::encode(wire::ServerMessage(world(wire::kRevision + 1))) + field), "");
  EXPECT_EQ(talk.hears(kind), "");
  EXPECT_EQ(talk.hears(iteration(1) + field), "");
  EXPECT_EQ(talk.conversation.receive()->iteration.number, 1u);
}

// Each revision's kinds of messages go to servers of this revision and later ones alone.
TEST(Conversation, AnEarlierServerIsNotToldWhatItDoesNotKnow) {
  const auto kindOf = [](const wire::ClientMessage& m) { return m.index(); };
  const std::vector<std::size_t> since{kindOf(wire::PoseMessage{}), kindOf(wire::Query{}), kindOf(wire::ChangeSettings{}),
                                       kindOf(wire::PassOver{}),    kindOf(wire::Edit{}),  kindOf(wire::FindEdits{})};
  for (std::uint32_t revision = 0; revision <= wire::kRevision; ++revision) {
    Talk talk({}, world(revision));
    Conversation& c = talk.conversation;
    std::string refused, notEdited, notMaterials;
    wire::Query query;
    query.x = query.z = {1};
    c.ask(query, [&](const auto& answer) { refused = answer.error().message; });
    query.kind = wire::QueryKind::kMaterials;
    if (revision < 8) c.ask(query, [&](const auto& answer) { notMaterials = answer.error().message; });
    c.ask(wire::Edit{}, [&](const auto& answer) { notEdited = answer.error().message; });
    EXPECT_FALSE(c.change({.threshold = 2}));
    EXPECT_FALSE(c.passOver(7));
    EXPECT_FALSE(c.find({}));
    EXPECT_FALSE(c.send({.sequence = 1, .camera = {}}));
    std::set<std::size_t> said;
    while (const auto message = talk.says()) said.insert(message->index());
    EXPECT_EQ(said, std::set(since.begin(), since.begin() + std::min<std::ptrdiff_t>(revision + 1, std::ssize(since)))) << revision;
    EXPECT_EQ(refused, revision == 0 ? "the server at here is of a version that answers no queries" : "");
    EXPECT_EQ(notMaterials, revision == 0  ? "the server at here is of a version that answers no queries"
                            : revision < 8 ? "the server at here is of a version that knows no materials"
                                           : "");
    EXPECT_EQ(notEdited, revision < 4 ? "the server at here is of a version that knows no edits" : "");
  }
}

}  // namespace
}  // namespace ridgecast::core
