#include "server/replica/replica.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>
#include <map>
#include <random>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::replica {
namespace {

using lattice::LeafAddress;
using mesh::LeafState;
using testing::ElementsAre;
using testing::IsEmpty;

LeafAddress at(int i, int j = 0, int level = 2) { return {level, i, j}; }

// The mesh of the server, told by content: address -> hash of the leaf. Versions count up for ever.
struct World {
  std::map<LeafAddress, mesh::LeafState> leaves;
  std::uint64_t versions = 0;
  void set(LeafAddress a, std::uint64_t hash) { leaves[a] = {a, ++versions, hash, hash ? 5u : 0u}; }
  std::vector<mesh::LeafState> list() const {
    std::vector<mesh::LeafState> out;
    for (const auto& [a, s] : leaves) out.push_back(s);
    return out;
  }
  std::uint64_t hash(LeafAddress a) const { return leaves.at(a).hash; }
};

// A client that knows nothing of the replica: a map that applies what it is sent.
struct Client {
  std::map<LeafAddress, std::uint64_t> held;
  std::uint64_t meshHash() const {
    std::uint64_t sum = 0;
    for (const auto& [a, h] : held) sum += mesh::hashTerm(a, h);
    return sum;
  }
};

struct Frame {
  Changes changes;
  std::map<LeafAddress, std::uint64_t> content;
};
Frame frameOf(const Changes& changes, const World& world) {
  Frame frame{changes, {}};
  for (const auto& a : changes.whole) frame.content[a] = world.hash(a);
  return frame;
}

TEST(Replica, SendsWhatIsNewChangedAndGone) {
  World world;
  Replica replica;
  EXPECT_TRUE(replica.hasRoom());
  EXPECT_FALSE(replica.differs(world.list()));
  world.set(at(1), 11);
  world.set(at(2), 0);  // held, and empty
  world.set(at(3), 33);
  EXPECT_TRUE(replica.differs(world.list()));
  auto changes = replica.send(world.list());
  EXPECT_EQ(changes.number, 1u);
  EXPECT_THAT(changes.gone, IsEmpty());
  EXPECT_THAT(changes.whole, ElementsAre(at(1), at(2), at(3)));
  EXPECT_EQ(changes.meshHash, mesh::hashTerm(at(1), 11) + mesh::hashTerm(at(2), 0) + mesh::hashTerm(at(3), 33));
  EXPECT_FALSE(replica.differs(world.list()));

  world.leaves.erase(at(1));
  world.set(at(3), 34);
  world.set(at(4), 44);
  world.set(at(2), 0);  // a new version of the same content is not sent
  changes = replica.send(world.list());
  EXPECT_THAT(changes.gone, ElementsAre(at(1)));
  EXPECT_THAT(changes.whole, ElementsAre(at(3), at(4)));
  changes = replica.send(world.list());
  EXPECT_THAT(changes.gone, IsEmpty());
  EXPECT_THAT(changes.whole, IsEmpty());
}

TEST(Replica, WindowClosesAndOpens) {
  Replica replica(2);
  const auto first = replica.send({});
  EXPECT_TRUE(replica.hasRoom());
  replica.send({});
  EXPECT_FALSE(replica.hasRoom());
  EXPECT_EQ(replica.acknowledge(1, first.meshHash), Verdict::kAgrees);
  EXPECT_TRUE(replica.hasRoom());
  EXPECT_EQ(replica.unacknowledged(), 1u);
}

TEST(Replica, ChecksAcknowledgements) {
  World world;
  world.set(at(1), 1);
  Replica replica(8);
  EXPECT_EQ(replica.acknowledge(0, 0), Verdict::kNeverSent);
  EXPECT_EQ(replica.acknowledge(1, 0), Verdict::kNeverSent);
  const auto hash = replica.send(world.list()).meshHash;
  replica.send(world.list());
  replica.send(world.list());
  EXPECT_EQ(replica.acknowledge(4, hash), Verdict::kNeverSent);
  EXPECT_EQ(replica.acknowledge(~0ull, hash), Verdict::kNeverSent);
  EXPECT_EQ(replica.acknowledge(2, hash), Verdict::kAgrees);  // stands for the first as well
  EXPECT_EQ(replica.acknowledge(2, hash), Verdict::kOutOfOrder);
  EXPECT_EQ(replica.acknowledge(1, hash), Verdict::kOutOfOrder);
  EXPECT_EQ(replica.unacknowledged(), 1u);
  EXPECT_FALSE(replica.owes());
}

TEST(Replica, AnotherHashMeansEverythingAgainOnce) {
  World world;
  world.set(at(1), 1);
  world.set(at(2), 2);
  Replica replica(4);
  replica.send(world.list());
  replica.send(world.list());
  EXPECT_EQ(replica.acknowledge(1, 666), Verdict::kRepairs);
  EXPECT_TRUE(replica.owes());
  // What was under way differs as well and is no new reason.
  const auto repair = replica.send(world.list());
  EXPECT_THAT(repair.whole, ElementsAre(at(1), at(2)));
  EXPECT_EQ(replica.acknowledge(2, 666), Verdict::kAgrees);
  EXPECT_FALSE(replica.owes());
  EXPECT_EQ(replica.acknowledge(3, repair.meshHash), Verdict::kAgrees);

  for (int k = 0; k < kMaxRepairs; ++k) {
    const auto number = replica.send(world.list()).number;
    EXPECT_EQ(replica.acknowledge(number, 666), Verdict::kRepairs);
  }
  EXPECT_EQ(replica.acknowledge(replica.send(world.list()).number, 666), Verdict::kHopeless);
}

TEST(Replica, ResendsNamedLeavesAndIgnoresStrangers) {
  World world;
  for (int k = 0; k < 5; ++k) world.set(at(k), 100 + k);
  Replica replica;
  replica.send(world.list());
  const std::vector<LeafAddress> stranger{at(9), at(-1), {0, 1, 1}};
  replica.resend(stranger);
  EXPECT_FALSE(replica.owes());
  const std::vector<LeafAddress> lost{at(3), at(1), at(9), at(3)};
  replica.resend(lost);
  world.leaves.erase(at(1));
  EXPECT_TRUE(replica.differs(world.list()));
  const auto changes = replica.send(world.list());
  EXPECT_THAT(changes.gone, ElementsAre(at(1)));
  EXPECT_THAT(changes.whole, ElementsAre(at(3)));
  EXPECT_FALSE(replica.owes());
  replica.resend({});
  EXPECT_THAT(replica.send(world.list()).whole, testing::SizeIs(4));
}

TEST(Replica, KnowsAClientThatResumesMostOfTheMesh) {
  World world;
  for (int k = 1; k <= 4; ++k) world.set(at(k), 11);
  Replica replica;
  EXPECT_FALSE(replica.resumes(world.list()));
  ASSERT_TRUE(replica.resume(std::vector<wire::HeldLeaf>{{at(0), 1}, {at(3), 1}, {at(9), 1}}));
  EXPECT_FALSE(replica.resumes(world.list())) << "a quarter";
  ASSERT_TRUE(replica.resume(std::vector<wire::HeldLeaf>{{at(1), 11}}));
  EXPECT_TRUE(replica.resumes(world.list())) << "half, with any content";
  replica.send(world.list());
  EXPECT_FALSE(replica.resumes(world.list())) << "once";
}

// Random worlds, delays, losses and acknowledgements against a client that merely applies what it gets.
TEST(Replica, ClientAlwaysEndsWithTheMesh) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    std::mt19937 random(seed);
    World world;
    Client client;
    Replica replica(1 + seed % 5);
    std::deque<Frame> underWay;
    std::uint64_t applied = 0, acknowledged = 0;
    std::deque<std::uint64_t> hashes;  // of what the client held after each iteration not yet acknowledged
    const auto applyOne = [&] {
      const Frame frame = underWay.front();
      underWay.pop_front();
      ASSERT_EQ(frame.changes.number, ++applied);
      for (const auto& a : frame.changes.gone) {
        if (frame.content.contains(a)) ADD_FAILURE() << "in both lists";
        client.held.erase(a);
      }
      for (const auto& [a, h] : frame.content) client.held[a] = h;
      hashes.push_back(client.meshHash());
    };
    const auto acknowledge = [&](std::size_t count) {
      if (count == 0) return;
      acknowledged += count;
      hashes.erase(hashes.begin(), hashes.begin() + static_cast<std::ptrdiff_t>(count - 1));
      const auto verdict = replica.acknowledge(acknowledged, hashes.front());
      hashes.pop_front();
      ASSERT_TRUE(verdict == Verdict::kAgrees || verdict == Verdict::kRepairs);
    };
    for (int step = 0; step < 400; ++step) {
      for (int n = static_cast<int>(random() % 4); n > 0; --n) {
        const LeafAddress a{static_cast<std::int32_t>(random() % 3), static_cast<std::int64_t>(random() % 5) - 2,
                            static_cast<std::int64_t>(random() % 3)};
        if (random() % 3 == 0)
          world.leaves.erase(a);
        else
          world.set(a, random() % 4);  // often the content it had
      }
      if (replica.hasRoom()) {
        const bool differed = replica.differs(world.list());
        const auto changes = replica.send(world.list());
        EXPECT_EQ(differed, !changes.gone.empty() || !changes.whole.empty());
        EXPECT_TRUE(std::is_sorted(changes.whole.begin(), changes.whole.end()));
        EXPECT_TRUE(std::is_sorted(changes.gone.begin(), changes.gone.end()));
        underWay.push_back(frameOf(changes, world));
        EXPECT_EQ(replica.leaves(), world.leaves.size());
      }
      if (!underWay.empty() && random() % 2) applyOne();
      if (random() % 37 == 0 && !client.held.empty()) {  // the client loses a leaf and says so, or does not
        const auto lost = std::next(client.held.begin(), static_cast<std::ptrdiff_t>(random() % client.held.size()))->first;
        client.held.erase(lost);
        if (random() % 2) replica.resend({&lost, 1});
      }
      acknowledge(random() % (hashes.size() + 1));
      EXPECT_LE(replica.unacknowledged(), replica.window());
    }
    // At rest: at most one repair away from agreement.
    for (int round = 0; round < 3; ++round) {
      while (!underWay.empty()) applyOne();
      acknowledge(hashes.size());
      underWay.push_back(frameOf(replica.send(world.list()), world));
      applyOne();
    }
    EXPECT_EQ(client.meshHash(), replica.meshHash()) << "seed " << seed;
    EXPECT_EQ(client.held.size(), world.leaves.size());
    for (const auto& [a, s] : world.leaves) EXPECT_EQ(client.held[a], s.hash);
  }
}

}  // namespace
}  // namespace ridgecast::replica
