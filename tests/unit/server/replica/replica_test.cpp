#include "server/replica/replica.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

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
  void set(LeafAddress a, std::uint64_t hash, std::uint32_t triangles = 5) { leaves[a] = {a, ++versions, hash, hash ? triangles : 0u}; }
  std::vector<mesh::LeafState> list() const {
    std::vector<mesh::LeafState> out;
    for (const auto& [a, s] : leaves) out.push_back(s);
    return out;
  }
};

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

// Of large leaves that all differ, points are fewer bytes; of one that differs, it alone.
TEST(Replica, AClientThatFollowsPointsBeginsAnewWhereThatIsShorter) {
  World world;
  for (int k = 1; k <= 4; ++k) world.set(at(k), static_cast<std::uint64_t>(10 + k), 1000);
  for (const bool follows : {true, false}) {
    Replica replica(4, follows);
    ASSERT_TRUE(replica.resume(std::vector<wire::HeldLeaf>{{at(1), 91}, {at(2), 92}, {at(3), 93}, {at(4), 94}, {at(9), 95}}));
    const auto changes = replica.send(world.list());
    EXPECT_EQ(changes.gone.size(), follows ? 5u : 1u);
    EXPECT_EQ(changes.come.size(), follows ? 4u : 0u);
    EXPECT_EQ(changes.whole.size(), follows ? 0u : 4u);
    EXPECT_TRUE(changes.anew);
    EXPECT_EQ(changes.meshHash, replica.meshHash());
    EXPECT_EQ(replica.acknowledge(1, changes.meshHash), Verdict::kAgrees);
  }
  Replica replica(4, true);
  ASSERT_TRUE(replica.resume(std::vector<wire::HeldLeaf>{{at(1), 11}, {at(2), 92}, {at(3), 13}, {at(4), 14}}));
  const auto changes = replica.send(world.list());
  EXPECT_THAT(changes.whole, ElementsAre(at(2)));
  EXPECT_TRUE(changes.gone.empty() && changes.come.empty());
}

TEST(Replica, AClientThatNamesNoLeafKeepsThemIfTheyAreTheMesh) {
  World world;
  for (int k = 1; k <= 4; ++k) world.set(at(k), static_cast<std::uint64_t>(10 + k), 1000);
  std::uint64_t hash = 0;
  for (const mesh::LeafState& leaf : world.list()) hash += mesh::hashTerm(leaf.address, leaf.hash);
  for (const bool isSame : {true, false}) {
    Replica replica(4, true);
    EXPECT_EQ(replica.resumedHash(), 0u);
    ASSERT_TRUE(replica.resume(isSame ? hash : hash + 1));
    EXPECT_NE(replica.resumedHash(), 0u);
    EXPECT_FALSE(replica.resume(hash)) << "once";
    EXPECT_FALSE(replica.resume(std::vector<wire::HeldLeaf>{{at(1), 11}})) << "one or the other";
    EXPECT_TRUE(replica.resumes(world.list())) << "nobody knows how much of it";
    const auto changes = replica.send(world.list());
    EXPECT_EQ(changes.come.size(), isSame ? 0u : 4u);
    EXPECT_TRUE(changes.gone.empty() && changes.whole.empty());
    EXPECT_EQ(changes.meshHash, hash);
    EXPECT_EQ(replica.leaves(), 4u);
    EXPECT_FALSE(replica.differs(world.list()));
  }
  Replica restored(4, true);
  ASSERT_TRUE(restored.resume(hash));
  restored.restore(world.list());
  EXPECT_EQ(restored.meshHash(), hash);
  world.set(at(2), 99, 1000);
  EXPECT_THAT(restored.send(world.list()).whole, ElementsAre(at(2)));
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

}  // namespace
}  // namespace ridgecast::replica
