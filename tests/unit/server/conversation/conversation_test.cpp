// The conversation under a simulated clock and line: no thread, no sleep, the same run every time.
#include "server/conversation/conversation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>

#include "common/mesh/leaf_mesh.h"
#include "common/wire/wire.h"

namespace ridgecast::conversation {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using Time = Conversation::Time;
using Leaves = std::vector<mesh::LeafState>;

wire::PoseMessage pose(std::uint64_t sequence) {
  wire::PoseMessage p;
  p.sequence = sequence;
  return p;
}

wire::Hello hello(wire::Pacing pacing = wire::Pacing::kFree, std::uint64_t bytesPerSecond = 0) {
  wire::Hello h;
  h.points = true;
  h.pacing = pacing;
  h.settings.bytesPerSecond = bytesPerSecond;
  return h;
}

Terms terms() {
  Terms t;
  t.grant = [](const wire::Settings& requested) { return requested; };
  return t;
}

// A conversation past its hello and its world.
Conversation running(const wire::Hello& h = hello(), Terms t = terms()) {
  Conversation c(std::move(t));
  EXPECT_FALSE(c.receive(h, Time{}));
  EXPECT_TRUE(std::holds_alternative<Greet>(c.next(0)));
  c.greeted();
  return c;
}

mesh::LeafState leaf(int i, std::uint64_t content) { return {{3, i, 0}, content, content * 0x9e3779b97f4a7c15ull, 10}; }

TEST(Conversation, EveryMessageHasItsPlace) {
  const std::vector<wire::ClientMessage> all{pose(1),          wire::Acknowledge{}, wire::ResendLeaves{}, wire::Resume{},
                                             wire::AskClock{}, wire::SetClock{},    wire::ClockStep{},    wire::StepDone{},
                                             wire::Query{},    wire::AskGround{},   wire::WantTiles{},    wire::ChangeSettings{},
                                             wire::PassOver{}, wire::FindEdits{},   wire::WantSquares{}};
  for (const wire::ClientMessage& message : all) {
    Conversation fresh(terms());
    const auto refusal = fresh.receive(message, Time{});
    ASSERT_TRUE(refusal) << message.index();
    EXPECT_EQ(refusal->code, wire::ErrorCode::kMalformed);
    EXPECT_THAT(refusal->message, HasSubstr("The first message must be a hello"));
  }
  for (const wire::ClientMessage& message : {all[4], all[5], all[6], all[7], all[8], all[9], all[11], all[12]}) {
    Conversation greeting(terms());
    ASSERT_FALSE(greeting.receive(hello(), Time{}));
    const auto refusal = greeting.receive(message, Time{});
    ASSERT_TRUE(refusal) << message.index();
    EXPECT_THAT(refusal->message, HasSubstr("wait for the world"));
    Conversation later = running();
    EXPECT_FALSE(later.receive(message, Time{})) << message.index();
  }
}

// Edits and iterations take turns, so that neither waits for all of the other.
TEST(Conversation, EditsComeInTurnWithIterationsAndAreBounded) {
  Conversation c = running();
  const Leaves leaves{leaf(0, 1)};
  ASSERT_FALSE(c.receive(wire::FindEdits{{}, 100, 0}, Time{}));
  ASSERT_FALSE(c.receive(wire::WantSquares{std::vector<terrain::TileAddress>(9)}, Time{}));
  EXPECT_TRUE(c.due(0));
  ASSERT_FALSE(c.receive(pose(1), Time{}));
  EXPECT_TRUE(std::holds_alternative<wire::FindEdits>(c.next(0)));
  std::vector<std::size_t> sizes;
  int iterations = 0;
  for (bool wasIteration = false; c.due(0); wasIteration = !wasIteration) {
    const auto work = c.next(0);
    if (const auto* squares = std::get_if<SendSquares>(&work)) {
      sizes.push_back(squares->squares.size());
      continue;
    }
    ASSERT_TRUE(std::holds_alternative<Iterate>(work));
    ++iterations;
    c.iterated(leaves, sizes.size() >= 3);
    if (sizes.size() < 3) {
      ASSERT_FALSE(c.receive(pose(static_cast<std::uint64_t>(iterations) + 1), Time{}));
    }
  }
  EXPECT_EQ(sizes, (std::vector<std::size_t>{4, 4, 1}));
  EXPECT_GE(iterations, 3);
  for (int k = 0; k < 4; ++k) ASSERT_FALSE(c.receive(wire::WantSquares{std::vector<terrain::TileAddress>(64)}, Time{}));
  EXPECT_THAT(c.receive(wire::WantSquares{std::vector<terrain::TileAddress>(1)}, Time{})->message, HasSubstr("More than 256 squares wait"));
  for (std::size_t k = 0; k < wire::kMaxFinds; ++k) ASSERT_FALSE(c.receive(wire::FindEdits{}, Time{}));
  EXPECT_THAT(c.receive(wire::FindEdits{}, Time{})->message, HasSubstr("More than 4 questions for edits wait"));
  Terms secret = terms();
  secret.sendsEdits = false;
  Conversation closed = running(hello(), secret);
  EXPECT_THAT(closed.receive(wire::FindEdits{}, Time{})->message, HasSubstr("private"));
  EXPECT_THAT(closed.receive(wire::WantSquares{}, Time{})->message, HasSubstr("private"));
}

// A new pose may take long: everybody sees an edit first.
TEST(Conversation, NewGroundComesBeforeANewPoseButOnlyOnce) {
  Conversation c = running();
  const auto nextPose = [&] { return std::get<Iterate>(c.next(0)).pose.sequence; };
  const Leaves leaves{leaf(0, 1)};
  ASSERT_FALSE(c.receive(pose(1), Time{}));
  c.groundChanged();  // before the first iteration: it has that ground
  EXPECT_EQ(nextPose(), 1u);
  EXPECT_TRUE(c.iterated(leaves, false));
  ASSERT_FALSE(c.receive(pose(2), Time{}));
  c.groundChanged();
  EXPECT_EQ(nextPose(), 1u);
  EXPECT_TRUE(c.iterated(leaves, false)) << "it is sent, whatever it changes";
  c.groundChanged();  // edits without end do not keep a pose waiting
  EXPECT_EQ(nextPose(), 2u);
  EXPECT_TRUE(c.iterated(leaves, false));
}

TEST(Conversation, ClosedThereIsNoWork) {
  Conversation c = running();
  ASSERT_FALSE(c.receive(pose(1), Time{}));
  ASSERT_TRUE(c.due(0));
  c.close();
  EXPECT_FALSE(c.due(0));
  EXPECT_TRUE(std::holds_alternative<std::monostate>(c.next(0)));
  EXPECT_FALSE(c.iterated({}, false));
}

TEST(ByteRate, PaysBackWhatWasSentAndSavesLittleUp) {
  ByteRate rate;
  EXPECT_FALSE(rate.limits());
  EXPECT_EQ(rate.insertions(), 0xffffffffu);
  rate.setRate(64'000);
  const auto now = ByteRate::Clock::now();
  rate.sent(now, 64'000, 0);  // a second's worth, of which a quarter was saved up
  EXPECT_NEAR(std::chrono::duration<double>(rate.free() - now).count(), 0.75, 1e-6);
  rate.sent(now, 6'400, 0);
  EXPECT_NEAR(std::chrono::duration<double>(rate.free() - now).count(), 0.85, 1e-6);
  rate.sent(now + 10s, 0, 0);
  EXPECT_LE(rate.free(), now + 10s);
  // What an insertion costs is learnt.
  const auto before = rate.insertions();
  EXPECT_GT(before, 500u);
  for (int k = 0; k < 20; ++k) rate.sent(now, 40'000, 1000);
  EXPECT_NEAR(rate.insertions(), 16'000.0 / 40, 10);
}

// Cameras that share a core, each with ten poses a second; who has waited longer has flown farther and wants more.
struct Shared {
  struct Flier {
    InsertionRate rate;
    double wants = 0;  // vertices
    InsertionRate::Time last{}, nextPose{};
  };
  std::vector<Flier> fliers;
  InsertionRate::Time now{1h};
  static constexpr double kFixed = 0.0015, kAVertex = 5e-5, kWantedASecond = 3000;  // seconds; without a limit 6 cameras fill the core

  // One camera after the other for so long. Iterations of each a second, and the share of what was wanted that came.
  std::pair<double, double> run(std::size_t count, double seconds, bool limited) {
    for (std::size_t k = fliers.size(); k < count; ++k) fliers.push_back({{}, 0, now, now + std::chrono::milliseconds(37 * k % 100)});
    double iterations = 0, wanted = 0, came = 0;
    for (const auto end = now + std::chrono::duration_cast<InsertionRate::Time::duration>(std::chrono::duration<double>(seconds));
         now < end;) {
      const auto before = now;
      for (Flier& f : fliers) {
        if (now < f.nextPose) continue;
        const double more = std::min(1.0, std::chrono::duration<double>(now - f.last).count()) * kWantedASecond;
        wanted += more;
        f.wants += more;
        for (; f.nextPose <= now; f.nextPose += 100ms) f.rate.pose(f.nextPose);
        f.rate.begin();
        const double inserted = limited ? std::min<double>(f.wants, f.rate.insertions()) : f.wants;
        f.wants = std::max(0.0, f.wants * 0.8 - inserted);  // what is left behind is no longer wanted
        f.last = now;
        now += std::chrono::duration_cast<InsertionRate::Time::duration>(std::chrono::duration<double>(kFixed + kAVertex * inserted));
        f.rate.sent(now, static_cast<std::uint32_t>(inserted));
        came += inserted;
        ++iterations;
      }
      if (now == before) now += 1ms;
    }
    return {iterations / seconds / static_cast<double>(count), came / wanted};
  }
};

TEST(InsertionRate, KeepsThePaceOnAMachineThatIsTooSmallForAllDetail) {
  EXPECT_LT(Shared().run(40, 20, false).first, 1.5) << "what happens without it";
  Shared machine;
  machine.run(40, 10, true);
  const auto [pace, share] = machine.run(40, 20, true);
  EXPECT_GT(pace, 9);
  EXPECT_GT(share, 0.05) << "detail comes as far as there is time";
  machine.fliers.resize(5);
  machine.run(5, 5, true);
  const auto [alone, all] = machine.run(5, 5, true);
  EXPECT_GT(alone, 9);
  EXPECT_GT(all, 0.95) << "it comes back by itself";
}

TEST(InsertionRate, HurriesNobodyWhoRests) {
  InsertionRate rate;
  InsertionRate::Time now{1h};
  for (int k = 0; k < 20; ++k, now += 100ms) {  // late, again and again
    rate.pose(now);
    rate.begin();
    rate.sent(now + 90ms, rate.insertions());
    EXPECT_EQ(rate.insertions() == InsertionRate::kMax, k == 0) << "whoever sets off has time";
  }
  ASSERT_LE(rate.insertions(), 2 * InsertionRate::kMin);
  for (int k = 0; k < 20; ++k, now += 200ms) {
    rate.begin();
    rate.sent(now + 190ms, rate.insertions());
  }
  EXPECT_EQ(rate.insertions(), InsertionRate::kMax);
}

TEST(InsertionRate, IsNotSlowedByWhatDetailDoesNotCost) {
  InsertionRate rate;
  for (InsertionRate::Time now{1h}; now < InsertionRate::Time{1h + 10s}; now += 100ms) {
    rate.pose(now);
    rate.begin();
    rate.sent(now + 500ms, InsertionRate::kMin);  // late, but not for so few vertices
  }
  EXPECT_EQ(rate.insertions(), InsertionRate::kMax);
}

TEST(Conversation, InLockstepDetailDoesNotDependOnTheClock) {
  for (const wire::Pacing pacing : {wire::Pacing::kFree, wire::Pacing::kLockstep}) {
    Conversation c = running(hello(pacing));
    Time now{1h};
    for (std::uint64_t k = 1; k <= 8; ++k, now += 100ms) {
      ASSERT_FALSE(c.receive(pose(k), now));
      const Work work = c.next(0);
      const auto& iterate = std::get<Iterate>(work);
      if (pacing == wire::Pacing::kLockstep) {
        EXPECT_FALSE(iterate.insertions);
      } else if (k > 2) {
        EXPECT_LE(iterate.insertions.value(), 750u);
      }
      const auto changes = c.iterated(Leaves{leaf(0, k)}, false);
      ASSERT_TRUE(changes);
      wire::Iteration iteration;
      iteration.figures.inserted = 1000;
      iteration.number = changes->number;
      c.sent(iteration, now + 90ms);
      ASSERT_FALSE(c.receive(wire::Acknowledge{changes->number, changes->meshHash}, now));
    }
  }
}

// Ten bytes ask for a whole mesh again: not for as many of them as messages fit into a second.
TEST(Conversation, AHundredResendsSendAtMostThreeMeshes) {
  constexpr std::size_t kMesh = 1'400'000;
  Conversation c = running();
  Time now{1h};
  std::size_t meshes = 0;
  for (std::uint64_t k = 1; k <= 100; ++k, now += 20ms) {
    ASSERT_FALSE(c.receive(pose(k), now));  // a camera that moves has iterations anyway
    for (int turn = 0; turn < 2; ++turn) {
      const auto due = c.due(0);
      if (!due || *due > now) continue;
      ASSERT_TRUE(std::holds_alternative<Iterate>(c.next(0)));
      const auto changes = c.iterated(Leaves{leaf(0, 1)}, true);
      if (!changes) continue;
      wire::Iteration iteration;
      if (!changes->whole.empty()) {
        ++meshes;
        iteration.whole.push_back({{3, 0, 0}, 3, 1, std::vector<std::uint8_t>(kMesh), 0, {}});
      }
      iteration.number = c.replica().lastSent();
      c.sent(iteration, now);
      ASSERT_FALSE(c.receive(wire::Acknowledge{changes->number, changes->meshHash}, now));
      ASSERT_FALSE(c.receive(wire::ResendLeaves{}, now));
    }
  }
  EXPECT_GE(meshes, 2u) << "the first, and a repair at once";
  EXPECT_LE(meshes, 4u) << "the first, and three repairs";
  const auto due = c.due(0);
  ASSERT_TRUE(due) << "what is owed comes";
  EXPECT_LT(*due, now + 2s);
}

TEST(Conversation, ABudgetOfBytesIsKeptToTheByteInSimulatedTime) {
  constexpr std::uint64_t kRate = 10'000;
  Conversation c = running(hello(wire::Pacing::kFree, kRate));
  Time now{1h};
  ASSERT_FALSE(c.receive(pose(1), now));
  const Time start = now;
  std::size_t bytes = 0;
  for (std::uint64_t n = 1; n <= 500; ++n) {
    const auto due = c.due(0);
    ASSERT_TRUE(due);
    now = std::max(now, *due);
    ASSERT_TRUE(std::holds_alternative<Iterate>(c.next(0)));
    const auto changes = c.iterated(Leaves{leaf(0, n)}, false);
    ASSERT_TRUE(changes);
    wire::Iteration iteration;
    iteration.whole.push_back({{3, 0, 0}, 3, 1, std::vector<std::uint8_t>(500 + 7 * n), 0, {}});
    bytes += 200 + 24 + 500 + 7 * n;
    iteration.number = c.replica().lastSent();
    c.sent(iteration, now);
    ASSERT_FALSE(c.receive(wire::Acknowledge{changes->number, changes->meshHash}, now));
  }
  const double seconds = std::chrono::duration<double>(*c.due(0) - start).count();
  EXPECT_NEAR(static_cast<double>(bytes) / seconds, kRate, 0.01 * kRate);
}

// A client on a line that delays and damages, for a minute of simulated time each: what must hold however it goes.
struct Simulation {
  explicit Simulation(unsigned seed) : random(seed) {}

  std::mt19937 random;
  Time now{1h};
  std::multimap<Time, wire::ClientMessage> toServer;
  std::map<lattice::LeafAddress, std::uint64_t> held;  // the client's, address -> hash
  std::uint64_t iterations = 0, posesAnswered = 0, damaged = 0, most = 0;

  bool chance(unsigned n) { return random() % n == 0; }
  void later(wire::ClientMessage message) {  // the line keeps the order
    Time at = now + std::chrono::milliseconds(random() % 80);
    if (!toServer.empty()) at = std::max(at, toServer.rbegin()->first);
    toServer.emplace(at, std::move(message));
  }
  std::uint64_t heldHash() const {
    std::uint64_t sum = 0;
    for (const auto& [address, hash] : held) sum += mesh::hashTerm(address, hash);
    return sum;
  }
  void apply(const replica::Changes& changes, const Leaves& leaves) {
    for (const auto& a : changes.gone) held.erase(a);
    const auto take = [&](const lattice::LeafAddress& a) {
      const auto it = std::find_if(leaves.begin(), leaves.end(), [&](const mesh::LeafState& l) { return l.address == a; });
      ASSERT_NE(it, leaves.end());
      held[a] = it->hash;
    };
    for (const auto& a : changes.whole) take(a);
    for (const auto& a : changes.come) take(a);
    for (const auto& a : changes.other) take(a);
  }
};

std::vector<std::uint64_t> simulate(unsigned seed, bool lockstep) {
  Simulation s(seed);
  const std::uint32_t window = 1 + seed % 4;
  Terms t = terms();
  t.window = window;
  Conversation c = running(hello(lockstep ? wire::Pacing::kLockstep : wire::Pacing::kFree), t);
  std::vector<std::uint64_t> trace;
  std::uint64_t posed = 0, unacknowledged = 0, answered = 0;
  std::uint64_t content = 1;
  Leaves leaves{leaf(0, 1), leaf(1, 1), leaf(2, 1)};
  for (int step = 0; step < 4500; ++step) {
    s.now += 15ms;
    if (step < 3900 && s.chance(3) && (!lockstep || posed < answered + kMaxQueuedPoses)) s.later(pose(++posed));
    while (!s.toServer.empty() && s.toServer.begin()->first <= s.now) {
      if (std::holds_alternative<wire::Acknowledge>(s.toServer.begin()->second)) --unacknowledged;
      const auto refusal = c.receive(s.toServer.begin()->second, s.now);
      EXPECT_FALSE(refusal) << refusal->message;
      s.toServer.erase(s.toServer.begin());
    }
    const auto due = c.due(0);
    if (!due || *due > s.now) continue;
    const Work work = c.next(0);
    const auto* order = std::get_if<Iterate>(&work);
    EXPECT_TRUE(order);
    if (!order) break;
    const bool settled = s.chance(4);
    if (!settled) leaves[s.random() % leaves.size()] = leaf(static_cast<int>(s.random() % 3), ++content);
    std::sort(leaves.begin(), leaves.end(), [](const auto& a, const auto& b) { return a.address < b.address; });
    leaves.erase(std::unique(leaves.begin(), leaves.end(), [](const auto& a, const auto& b) { return a.address == b.address; }),
                 leaves.end());
    const auto changes = c.iterated(leaves, settled);
    trace.push_back(order->pose.sequence * 2 + (changes ? 1 : 0));
    if (!changes) {
      EXPECT_FALSE(lockstep) << "in lock-step every pose is answered";
      continue;
    }
    answered = order->pose.sequence;
    s.apply(*changes, leaves);
    ++unacknowledged;
    s.most = std::max<std::uint64_t>(s.most, unacknowledged);
    if (s.chance(40) && !s.held.empty()) {  // a leaf is damaged: the client sees it by the hash and asks again
      ++s.damaged;
      s.later(wire::ResendLeaves{{s.held.begin()->first}});
    }
    s.later(wire::Acknowledge{changes->number, s.heldHash()});
  }
  EXPECT_EQ(answered, posed) << "the newest pose is answered once there is nothing newer";
  EXPECT_LE(s.most, window);
  EXPECT_GT(s.damaged, 5u);
  EXPECT_EQ(s.heldHash(), c.replica().meshHash());
  if (lockstep) {
    EXPECT_EQ(trace.size(), posed);
  }
  return trace;
}

TEST(Conversation, OverALineThatDelaysEveryPoseIsAnsweredAndBothSidesAgree) {
  for (unsigned seed = 1; seed <= 40; ++seed)
    for (const bool lockstep : {false, true}) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << (lockstep ? ", lock-step" : ""));
      const auto trace = simulate(seed, lockstep);
      EXPECT_EQ(trace, simulate(seed, lockstep)) << "the same calls, the same answers";
    }
}

}  // namespace
}  // namespace ridgecast::conversation
