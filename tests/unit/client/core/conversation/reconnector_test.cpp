// How a client comes back, to whom, and with what.
#include "client/core/conversation/reconnector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "common/wire/wire.h"
#include "tests/support/bytes.h"

namespace ridgecast::core {
namespace {

using namespace std::chrono_literals;
using testing_support::bytesOf;

constexpr std::uint64_t kWorld = 7;  // content hash

wire::ServerMessage greeting(std::uint64_t edit = 0, std::uint64_t contentHash = kWorld) {
  return wire::World{.serverName = "a test",
                     .session = "default",
                     .terrainName = "alpine",
                     .terrainSource = {},
                     .contentHash = contentHash,
                     .horizon = 1000,
                     .window = 3,
                     .camera = 1,
                     .edit = edit};
}
wire::ServerMessage meshOf(std::uint64_t number, std::uint64_t edit = 0) {
  wire::Iteration it;
  it.number = number;
  it.edit = edit;
  return it;
}
wire::ServerMessage edited(std::uint64_t first, std::uint64_t last) {
  wire::Edited page;
  for (; first <= last; ++first) page.edits.push_back({.number = first, .author = "somebody", .operation = "{}"});
  return page;
}
wire::ServerMessage farewell(const std::string& to) { return wire::ErrorMessage{wire::ErrorCode::kGoingAway, "I go", to}; }

// A reconnector, and the servers that it meets.
struct Journey {
  explicit Journey(const wire::Hello& hello = {}, const std::string& url = "ws://here:1", Returns returns = Returns::kToItsWorld,
                   std::uint32_t random = 1)
      : reconnector(withToken(url), hello, returns, random) {}
  static Url withToken(const std::string& text) {
    Url url = parseUrl(text).value();
    url.token = "secret";
    return url;
  }

  std::string hears(const wire::ServerMessage& message) {
    const std::string bytes = wire::encode(message);
    const Wrong wrong = reconnector.heard(bytesOf(bytes), now);
    if (wrong) reconnector.ended({*wrong}, now);
    return wrong.value_or("");
  }
  // What it says, in order.
  std::vector<wire::ClientMessage> says() {
    std::vector<wire::ClientMessage> out;
    while (const auto frame = reconnector.next(now)) out.push_back(wire::decodeClient(bytesOf(*frame)).value());
    return out;
  }
  wire::Hello hello() { return std::get<wire::Hello>(wire::decodeClient(bytesOf(reconnector.opened())).value()); }
  void loses() { reconnector.ended({"lost"}, now); }
  Url dials() {
    if (const auto due = reconnector.due()) now = std::max(now, *due);
    const auto url = reconnector.dial(now);
    EXPECT_TRUE(url);
    return url.value_or(Url{.host = "nobody"});
  }
  void begins(const wire::ServerMessage& first = greeting()) {
    dials();
    EXPECT_EQ(hears(first), "");
  }
  void returns(const wire::ServerMessage& first = greeting()) {
    begins(first);
    ASSERT_TRUE(reconnector.hasReturned());
    reconnector.goOn({});
  }

  Reconnector reconnector;
  Reconnector::Instant now{1h};
};

TEST(Reconnector, TheFirstLossIsTheEndWhereItDoesNotReconnectOrHasSeenNoWorld) {
  for (const Returns returns : {Returns::kNever, Returns::kToItsWorld}) {
    Journey journey({}, "ws://here:1", returns);
    EXPECT_EQ(journey.dials().where(), "here:1");
    EXPECT_FALSE(journey.reconnector.dial(journey.now)) << "one line at a time";
    if (returns == Returns::kNever) {
      EXPECT_EQ(journey.hears(greeting()), "");
    }
    EXPECT_FALSE(journey.reconnector.lost());
    journey.loses();
    ASSERT_TRUE(journey.reconnector.lost());
    EXPECT_EQ(journey.reconnector.lost()->message, "lost");
    EXPECT_FALSE(journey.reconnector.comesBack());
    EXPECT_FALSE(journey.reconnector.due());
    EXPECT_FALSE(journey.reconnector.dial(journey.now + 1h));
  }
}

TEST(Reconnector, PausesGrowUntilAConversationLastedAndAreRandom) {
  std::set<std::int64_t> firsts;
  for (std::uint32_t random = 0; random < 50; ++random) {
    Journey journey({}, "ws://here:1", Returns::kToItsWorld, random);
    journey.begins();
    const auto pause = [&] {
      journey.loses();
      EXPECT_FALSE(journey.reconnector.dial(*journey.reconnector.due() - 1ms));
      return *journey.reconnector.due() - journey.now;
    };
    for (const auto longest : {50ms, 100ms, 200ms, 400ms, 800ms, 1600ms, 2000ms, 2000ms}) {
      const auto paused = pause();
      EXPECT_GE(paused, longest / 2);
      EXPECT_LE(paused, longest);
      if (longest == 50ms) firsts.insert(paused.count());
      journey.dials();
    }
    EXPECT_EQ(journey.hears(greeting()), "");
    journey.reconnector.goOn({});
    EXPECT_GE(pause(), 1s) << "a world alone is no return";
    journey.returns();
    journey.now += Reconnector::kLongestPause - 1ms;
    EXPECT_GE(pause(), 1s);
    journey.returns();
    journey.now += Reconnector::kLongestPause;
    EXPECT_LE(pause(), 50ms) << "also of a client that gets no mesh";
  }
  EXPECT_GT(firsts.size(), 10u) << "everybody comes back at once";
}

// Two servers that both leave must not have a client run between them.
TEST(Reconnector, WhoIsSentAwayComesAtOnceOnce) {
  Journey journey;
  journey.begins();
  const auto pause = [&] {
    journey.hears(farewell("ws://there:2"));
    return *journey.reconnector.due() - journey.now;
  };
  EXPECT_EQ(pause(), 0ms);
  journey.returns();
  EXPECT_GE(pause(), 50ms);
}

TEST(Reconnector, WhatCameBeforeTheEndIsTakenFirst) {
  Journey journey;
  journey.begins();
  EXPECT_EQ(journey.hears(meshOf(1)), "");
  EXPECT_EQ(journey.hears(meshOf(2)), "");
  const std::uint64_t bytes = journey.reconnector.bytes();
  journey.loses();
  journey.begins(greeting(0));
  EXPECT_EQ(journey.reconnector.conversation().receive()->iteration.number, 1u);
  EXPECT_FALSE(journey.reconnector.hasReturned());
  EXPECT_TRUE(journey.reconnector.lost());
  EXPECT_EQ(journey.reconnector.conversation().receive()->iteration.number, 2u);
  ASSERT_TRUE(journey.reconnector.hasReturned());
  EXPECT_EQ(journey.reconnector.reconnections(), 0u);
  journey.reconnector.goOn({});
  EXPECT_EQ(journey.reconnector.reconnections(), 1u);
  EXPECT_FALSE(journey.reconnector.lost());
  EXPECT_FALSE(journey.reconnector.hasReturned());
  EXPECT_EQ(journey.reconnector.bytes(), bytes + wire::encode(greeting()).size());
}

TEST(Reconnector, BeginsWithWhatIsHeldAndTheNewestOfThePoseAndTheSettings) {
  Journey journey({.settings = {.threshold = 1}});
  journey.begins();
  EXPECT_FALSE(journey.reconnector.send({.sequence = 1, .camera = {}}));
  EXPECT_FALSE(journey.reconnector.change({.threshold = 2}));
  EXPECT_EQ(journey.says().size(), 2u);
  journey.loses();
  EXPECT_FALSE(journey.reconnector.send({.sequence = 2, .camera = {}}));
  EXPECT_FALSE(journey.reconnector.change({.threshold = 3}));
  journey.dials();
  EXPECT_EQ(journey.hello().settings.threshold, 3);
  EXPECT_EQ(journey.hears(greeting()), "");
  EXPECT_FALSE(journey.reconnector.send({.sequence = 3, .camera = {}}));
  EXPECT_FALSE(journey.reconnector.change({.threshold = 4})) << "after hello, and before it goes on";
  EXPECT_TRUE(journey.says().empty());
  journey.reconnector.goOn({{}, {}});
  const auto said = journey.says();
  ASSERT_EQ(said.size(), 4u);
  EXPECT_TRUE(std::holds_alternative<wire::Resume>(said[0]));
  EXPECT_TRUE(std::holds_alternative<wire::Resume>(said[1]));
  EXPECT_EQ(std::get<wire::ChangeSettings>(said[2]).settings.threshold, 4);
  EXPECT_EQ(std::get<wire::PoseMessage>(said[3]).sequence, 3u);

  journey.loses();
  journey.returns();
  EXPECT_EQ(journey.says().size(), 1u) << "the pose; hello had the settings";
}

TEST(Reconnector, StepsAreSkippedAfterAReturnToo) {
  Journey journey({.clock = true});
  journey.begins();
  EXPECT_FALSE(journey.reconnector.skipSteps(true));
  journey.loses();
  journey.begins();
  const wire::Clock clock{.mode = wire::ClockMode::kStepped, .owner = 2, .step = 5, .waitsFor = {1}};
  EXPECT_EQ(journey.hears(clock), "");
  journey.reconnector.goOn({});
  const auto said = journey.says();
  EXPECT_TRUE(std::ranges::any_of(said, [](const wire::ClientMessage& message) {
    const auto* done = std::get_if<wire::StepDone>(&message);
    return done && done->step == 5;
  }));
}

TEST(Reconnector, RequestsFailAtOnceWhileThereIsNobodyToAnswer) {
  Journey journey;
  journey.begins();
  std::vector<std::string> answers;
  const auto ask = [&] {
    journey.reconnector.conversation().ask(
        wire::Query{}, [&](const Outcome<wire::Answer>& answer) { answers.push_back(answer ? "answered" : answer.error().message); });
  };
  ask();
  EXPECT_EQ(journey.says().size(), 1u);
  ask();
  journey.loses();
  ask();
  EXPECT_EQ(answers, (std::vector<std::string>{"lost", "lost", "lost"}));
  journey.returns();
  ask();
  EXPECT_EQ(journey.says().size(), 1u);
  EXPECT_EQ(answers.size(), 3u);
}

TEST(Reconnector, GoesWhereItIsSentAndComesBackFromNobody) {
  Journey journey;
  journey.begins();
  EXPECT_EQ(journey.hears(farewell("ws://there:2?session=ignored")), "the server at here:1 says: I go");
  const Url there = journey.dials();
  EXPECT_EQ(there.where(), "there:2");
  EXPECT_EQ(there.session, "default");
  journey.loses();
  EXPECT_EQ(journey.dials().where(), "here:1");
  EXPECT_EQ(journey.hears(farewell("ws://there:2")), "the server at here:1 says: I go");
  EXPECT_EQ(journey.dials().where(), "there:2") << "one that is sent on before its world";
  EXPECT_EQ(journey.hears(greeting()), "");
  journey.reconnector.goOn({});
  EXPECT_EQ(journey.hears(farewell("")), "the server at there:2 says: I go");
  EXPECT_EQ(journey.dials().where(), "here:1");
  EXPECT_EQ(journey.hears(farewell("no address at all")), "the server at here:1 says: I go");
  EXPECT_EQ(journey.dials().where(), "here:1");
}

// A host that another one names gets no token, and nothing that was secret travels in the clear.
TEST(Reconnector, ATokenStaysWithItsHostAndItsSecrecy) {
  struct Case {
    const char *from, *to, *where;
    bool hasToken;
  };
  for (const Case& c : {Case{"ws://here:1", "ws://here:2", "here:2", true}, Case{"ws://here:1", "ws://there:1", "there:1", false},
                        Case{"ws://here:1", "wss://here:2", "here:2", true}, Case{"wss://here:1", "ws://here:2", "here:1", true},
                        Case{"wss://here:1", "wss://there:2", "there:2", false}}) {
    Journey journey({}, c.from);
    journey.begins();
    journey.hears(farewell(c.to));
    const Url url = journey.dials();
    EXPECT_EQ(url.where(), c.where) << c.from << " to " << c.to;
    EXPECT_EQ(url.token, c.hasToken ? "secret" : "") << c.from << " to " << c.to;
    EXPECT_EQ(url.secure, std::string(c.where) == "here:1" ? std::string(c.from).starts_with("wss") : std::string(c.to).starts_with("wss"));
  }
}

TEST(Reconnector, AnotherWorldIsTheEnd) {
  Journey journey;
  journey.begins();
  journey.loses();
  journey.dials();
  EXPECT_EQ(journey.hears(greeting(0, kWorld + 1)), "the server has another world now");
  EXPECT_TRUE(journey.reconnector.otherWorld());
  EXPECT_EQ(journey.reconnector.lost()->message, "the server has another world now");
  EXPECT_FALSE(journey.reconnector.comesBack());
  EXPECT_FALSE(journey.reconnector.hasReturned());
  EXPECT_FALSE(journey.reconnector.dial(journey.now + 1h));
  EXPECT_EQ(std::get<wire::World>(greeting()).contentHash, journey.reconnector.conversation().world().contentHash);
}

TEST(Reconnector, AServerThatHasLostEditsHasAnotherWorld) {
  const wire::ServerMessage answered = wire::EditAnswer{.id = 1, .number = 3};
  const auto hasHeard = [&](const std::function<void(Journey&)>& before) {
    bool same[2];
    for (const std::uint64_t edit : {2, 3}) {
      Journey journey({.edits = true});
      journey.begins(greeting(1));
      before(journey);
      while (journey.reconnector.conversation().receive()) {
      }
      journey.loses();
      journey.dials();
      same[edit - 2] = journey.hears(greeting(edit)).empty();
      EXPECT_EQ(journey.reconnector.otherWorld(), !same[edit - 2]);
    }
    return !same[0] && same[1];
  };
  EXPECT_TRUE(hasHeard([](Journey& journey) { journey.hears(meshOf(1, 3)); }));
  EXPECT_TRUE(hasHeard([](Journey& journey) { journey.hears(edited(1, 3)); }));
  EXPECT_TRUE(hasHeard([&](Journey& journey) {
    journey.reconnector.conversation().ask(wire::Edit{}, [](const Outcome<wire::EditAnswer>& answer) { EXPECT_TRUE(answer); });
    EXPECT_EQ(journey.says().size(), 1u);
    EXPECT_EQ(journey.hears(answered), "");
  }));
  EXPECT_TRUE(hasHeard([](Journey& journey) {
    journey.loses();
    journey.returns(greeting(3));
  }));
}

TEST(Reconnector, ARecordingMayGoBackBeforeItsEdits) {
  Journey journey({.clock = true, .edits = true});
  journey.begins(greeting(9));
  EXPECT_EQ(journey.hears(wire::Clock{.mode = wire::ClockMode::kStepped, .end = 1}), "");
  EXPECT_EQ(journey.hears(edited(1, 9)), "");
  EXPECT_EQ(journey.reconnector.conversation().takeEdits().made.size(), 9u);
  journey.loses();
  EXPECT_EQ(journey.reconnector.conversation().takeEdits().after, 9u) << "none are void until it is back";
  journey.returns(greeting(2));
  EXPECT_FALSE(journey.reconnector.otherWorld());
  EXPECT_EQ(journey.hello().editsAfter, 0u);
  EXPECT_EQ(journey.hears(edited(1, 2)), "");
  const EditsMade edits = journey.reconnector.conversation().takeEdits();
  EXPECT_EQ(edits.after, 0u);
  EXPECT_EQ(edits.there, 2u);
  EXPECT_EQ(edits.made.size(), 2u);
}

TEST(Reconnector, EditsGoOnAfterTheLastThatWasTaken) {
  Journey journey({.edits = true, .editsAfter = 2});
  journey.begins(greeting(9));
  EXPECT_EQ(journey.hello().editsAfter, 2u);
  const auto numbers = [&] {
    std::vector<std::uint64_t> out;
    for (const wire::MadeEdit& made : journey.reconnector.conversation().takeEdits().made) out.push_back(made.number);
    return out;
  };
  EXPECT_EQ(journey.hears(edited(3, 5)), "");
  EXPECT_EQ(numbers(), (std::vector<std::uint64_t>{3, 4, 5}));
  EXPECT_EQ(journey.hears(edited(6, 7)), "");
  journey.loses();
  EXPECT_TRUE(numbers().empty()) << "they are told again";
  journey.dials();
  EXPECT_EQ(journey.hello().editsAfter, 5u);
  journey.loses();
  journey.dials();
  EXPECT_EQ(journey.hello().editsAfter, 5u) << "after an attempt that failed";
  EXPECT_EQ(journey.hears(greeting(9)), "");
  EXPECT_EQ(journey.hears(edited(6, 9)), "") << "before it goes on";
  journey.reconnector.goOn({});
  EXPECT_EQ(numbers(), (std::vector<std::uint64_t>{6, 7, 8, 9}));
  journey.loses();
  journey.dials();
  EXPECT_EQ(journey.hello().editsAfter, 9u);
}

TEST(Reconnector, ALineThatEndsBeforeItIsGoneOnWithIsAnAttemptThatFailed) {
  Journey journey;
  journey.begins();
  EXPECT_FALSE(journey.reconnector.send({.sequence = 4, .camera = {}}));
  journey.loses();
  journey.begins();
  journey.reconnector.ended({"again"}, journey.now);
  EXPECT_FALSE(journey.reconnector.hasReturned());
  EXPECT_EQ(journey.reconnector.lost()->message, "again");
  EXPECT_EQ(journey.reconnector.reconnections(), 0u);
  journey.returns();
  ASSERT_EQ(journey.says().size(), 1u);
  EXPECT_EQ(journey.reconnector.reconnections(), 1u);
}

TEST(Reconnector, AlwaysComesFromTheFirstAttemptOnAndIntoWhateverWorld) {
  Journey journey({}, "ws://here:1", Returns::kAlways);
  for (int attempt = 0; attempt < 3; ++attempt) {
    journey.dials();
    journey.loses();
    EXPECT_TRUE(journey.reconnector.comesBack());
  }
  journey.returns();
  EXPECT_FALSE(journey.reconnector.otherWorld());
  journey.loses();
  wire::World other = std::get<wire::World>(greeting());
  other.contentHash += 1;
  journey.begins(other);
  EXPECT_TRUE(journey.reconnector.hasReturned());
  EXPECT_TRUE(journey.reconnector.otherWorld());
  EXPECT_EQ(journey.reconnector.coming().contentHash, other.contentHash);
  journey.reconnector.goOn({});
  journey.loses();
  EXPECT_TRUE(journey.reconnector.comesBack());
  journey.returns(other);
  EXPECT_FALSE(journey.reconnector.otherWorld());
}

TEST(Reconnector, AServerOfAnotherVersionIsNotAskedAgain) {
  wire::World newer = std::get<wire::World>(greeting());
  newer.protocolVersion += 1;
  for (const wire::ServerMessage& message :
       {wire::ServerMessage(newer), wire::ServerMessage(wire::ErrorMessage{wire::ErrorCode::kVersion, "no"})}) {
    Journey journey({}, "ws://here:1", Returns::kAlways);
    journey.begins();
    journey.loses();
    journey.dials();
    EXPECT_NE(journey.hears(message), "");
    EXPECT_FALSE(journey.reconnector.comesBack());
    EXPECT_FALSE(journey.reconnector.due());
    EXPECT_FALSE(journey.reconnector.dial(journey.now + 1h));
  }
}

TEST(Reconnector, WhoHurriesDialsAtOnceAndPausesShortly) {
  Journey journey;
  journey.begins();
  for (int attempt = 0; attempt < 8; ++attempt) {
    journey.loses();
    if (attempt < 7) journey.dials();
  }
  EXPECT_GT(*journey.reconnector.due() - journey.now, 500ms);
  journey.reconnector.hurry(journey.now);
  EXPECT_TRUE(journey.reconnector.dial(journey.now));
  journey.reconnector.hurry(journey.now);
  EXPECT_FALSE(journey.reconnector.dial(journey.now)) << "one line at a time";
  journey.loses();
  EXPECT_LE(*journey.reconnector.due() - journey.now, 50ms);
}

}  // namespace
}  // namespace ridgecast::core
