// A million random steps of server, line and client, against a model that knows nothing of the replica's code: worlds that refine, split
// and merge, iterations under way, leaves that the client loses, lines that break and are taken up again.
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <iterator>
#include <map>
#include <random>
#include <set>
#include <utility>

#include "common/mesh/leaf_mesh.h"
#include "server/replica/replica.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/sanitized.h"

namespace ridgecast::replica {
namespace {

using lattice::LeafAddress;
using mesh::LeafState;

// A quadtree of a few roots whose leaves have contents.
class RandomWorld {
 public:
  explicit RandomWorld(std::mt19937& random) : random_(random) {
    for (int k = 0; k < 3; ++k) leaves_[{3, k, 0}] = next();
  }
  void change() {
    auto it = std::next(leaves_.begin(), static_cast<std::ptrdiff_t>(random_() % leaves_.size()));
    const LeafAddress a = it->first;
    switch (random_() % 8) {
      case 0:  // split, at times twice at once
        if (a.level == 0) return;
        leaves_.erase(it);
        for (int q = 0; q < 4; ++q) leaves_[a.child(q)] = next();
        if (a.level > 1 && random_() % 3 == 0) {
          leaves_.erase(a.child(2));
          for (int q = 0; q < 4; ++q) leaves_[a.child(2).child(q)] = next();
        }
        return;
      case 1: {  // merge
        if (a.level == 3) return;
        const LeafAddress parent = a.parent();
        std::erase_if(leaves_, [&](const auto& leaf) { return parent.isAncestorOf(leaf.first); });
        leaves_[parent] = next();
        return;
      }
      case 2:  // a root comes or goes
        if (random_() % 2) {
          const LeafAddress root{3, static_cast<std::int64_t>(random_() % 5), 0};
          std::erase_if(leaves_, [&](const auto& leaf) { return root.isAncestorOf(leaf.first); });
          if (random_() % 2 || leaves_.empty()) leaves_[root] = next();
        }
        return;
      default:
        it->second = random_() % 3 ? next() : std::pair{++version_, it->second.second};  // often what it was
    }
  }
  std::vector<mesh::LeafState> list() const {
    std::vector<mesh::LeafState> out;
    for (const auto& [a, content] : leaves_) out.push_back({a, content.first, content.second, 5, content.first});
    return out;
  }
  const std::map<LeafAddress, std::pair<std::uint64_t, std::uint64_t>>& leaves() const { return leaves_; }

 private:
  std::pair<std::uint64_t, std::uint64_t> next() { return {++version_, lattice::mix(random_() % 50'000)}; }
  std::mt19937& random_;
  std::uint64_t version_ = 0;
  std::map<LeafAddress, std::pair<std::uint64_t, std::uint64_t>> leaves_;
};

struct RandomFrame {
  Changes changes;
  std::map<LeafAddress, std::uint64_t> before, content;  // what the client should hold, and what it will
};

// Applies frames. Points make the server's leaves only from exactly what the server thinks is held.
struct RandomClient {
  std::map<LeafAddress, std::uint64_t> held;
  bool isLost = false;   // points came that did not fit, and leaves have not come whole since
  bool unnamed = false;  // the server knows only the hash of what is held

  void apply(const RandomFrame& frame) {
    const Changes& c = frame.changes;
    if (std::exchange(unnamed, false) && (c.meshHash != meshHash() || !c.come.empty() || !c.whole.empty())) held.clear();
    if (c.anew) isLost = false;
    isLost = isLost || (c.whole.empty() && !c.anew && held != frame.before);
    for (const LeafAddress& a : c.gone)
      if (held.erase(a) == 0) ADD_FAILURE() << "gone but not held";
    for (const LeafAddress& a : c.whole) {
      EXPECT_FALSE(std::ranges::binary_search(c.gone, a));
      held[a] = frame.content.at(a);
    }
    for (const LeafAddress& a : c.come) {
      EXPECT_TRUE(!held.contains(a) && c.whole.empty());
      held[a] = isLost ? 0xbad : frame.content.at(a);
    }
    for (const LeafAddress& a : c.touched) {
      EXPECT_TRUE(held.contains(a) && c.whole.empty());
      if (!isLost) held[a] = frame.content.at(a);
    }
    std::vector<LeafAddress> other;
    std::ranges::set_union(c.come, c.touched, std::back_inserter(other));
    EXPECT_TRUE(std::ranges::includes(other, c.other));
  }
  std::uint64_t meshHash() const {
    std::uint64_t sum = 0;
    for (const auto& [a, h] : held) sum += mesh::hashTerm(a, h);
    return sum;
  }
};

TEST(ReplicaAtRandom, ClientAndServerAgreeAfterAMillionSteps) {
  std::uint64_t points = 0, wholes = 0, resumed = 0, repaired = 0;
  for (unsigned seed = 0; seed < static_cast<unsigned>(testing_support::rounds(100)); ++seed) {
    std::mt19937 random(seed);
    RandomWorld world(random);
    RandomClient client;
    Replica replica(1 + seed % 5, seed % 7 != 0);
    std::map<LeafAddress, std::uint64_t> sent;  // what the client holds once it has everything
    std::deque<RandomFrame> underWay;
    std::deque<std::uint64_t> hashes;  // not acknowledged yet
    std::uint64_t applied = 0, acknowledged = 0;
    const auto send = [&] {
      const auto list = world.list();
      const bool differed = replica.differs(list), isUnnamed = replica.resumedHash() != 0;
      RandomFrame frame{replica.send(list), sent, {}};
      const Changes& c = frame.changes;
      EXPECT_EQ(differed, isUnnamed || !c.gone.empty() || !c.whole.empty() || !c.come.empty() || !c.other.empty());
      EXPECT_TRUE(std::is_sorted(c.whole.begin(), c.whole.end()) && std::is_sorted(c.gone.begin(), c.gone.end()));
      for (const auto& [a, content] : world.leaves()) frame.content[a] = content.second;
      sent = frame.content;
      points += c.touched.size() + c.come.size();
      wholes += c.whole.size();
      EXPECT_EQ(replica.leaves(), world.leaves().size());
      underWay.push_back(std::move(frame));
    };
    const auto applyOne = [&] {
      ASSERT_EQ(underWay.front().changes.number, ++applied);
      const bool wasLost = client.isLost;
      client.apply(underWay.front());
      underWay.pop_front();
      if (client.isLost && !wasLost) {
        replica.resend({});
        ++repaired;
      }
      hashes.push_back(client.meshHash());
    };
    // The line breaks: what was under way is lost, and the client says what it has.
    const auto resume = [&] {
      underWay.clear();
      hashes.clear();
      applied = acknowledged = 0;
      client.isLost = false;
      const bool follows = random() % 7 != 0;
      replica = Replica(1 + random() % 5, follows);
      sent = client.held;
      ++resumed;
      client.unnamed = follows && client.meshHash() != 0 && random() % 2;
      if (client.unnamed) {
        EXPECT_TRUE(replica.resume(client.meshHash()));
        EXPECT_FALSE(replica.resume(client.meshHash()));
        EXPECT_TRUE(replica.resumes(world.list()));
        sent.clear();
        return;
      }
      std::vector<wire::HeldLeaf> held;
      for (const auto& [a, h] : client.held) held.push_back({a, h});
      const std::size_t half = random() % (held.size() + 1);
      EXPECT_TRUE(replica.resume({held.data(), half}));
      EXPECT_TRUE(replica.resume({held.data() + half, held.size() - half}));
      EXPECT_EQ(replica.meshHash(), client.meshHash());
    };
    const auto acknowledge = [&](std::size_t count) {
      if (count == 0) return;
      acknowledged += count;
      hashes.erase(hashes.begin(), hashes.begin() + static_cast<std::ptrdiff_t>(count - 1));
      const auto verdict = replica.acknowledge(acknowledged, hashes.front());
      hashes.pop_front();
      if (verdict == Verdict::kHopeless) return resume();  // the server hangs up, the client comes back
      ASSERT_TRUE(verdict == Verdict::kAgrees || verdict == Verdict::kRepairs);
      repaired += verdict == Verdict::kRepairs;
    };
    for (int step = 0; step < 10'000; ++step) {
      for (auto n = random() % 3; n > 0; --n) world.change();
      if (replica.hasRoom() && random() % 4) send();
      if (!underWay.empty() && random() % 2) applyOne();
      if (random() % 200 == 0 && !client.held.empty()) {  // something in the client's memory goes wrong; at times it knows
        const auto it = std::next(client.held.begin(), static_cast<std::ptrdiff_t>(random() % client.held.size()));
        it->second = 0xdead;
        if (random() % 2) replica.resend(std::vector{it->first});
      }
      if (random() % 500 == 0) resume();
      acknowledge(random() % (hashes.size() + 1));
      ASSERT_LE(replica.unacknowledged(), replica.window());
      if (testing::Test::HasFailure()) FAIL() << "seed " << seed << ", step " << step;
    }
    // At rest: at most two repairs away from agreement.
    for (int round = 0; round < 4; ++round) {
      while (!underWay.empty()) applyOne();
      acknowledge(hashes.size());
      if (replica.hasRoom()) send();
      while (!underWay.empty()) applyOne();
    }
    EXPECT_EQ(client.meshHash(), replica.meshHash()) << "seed " << seed;
    for (const auto& [a, content] : world.leaves()) EXPECT_EQ(client.held[a], content.second) << "seed " << seed;
    EXPECT_EQ(client.held.size(), world.leaves().size());
  }
  EXPECT_GT(points, testing_support::kSanitized ? 50'000u : 500'000u);
  EXPECT_GT(wholes, testing_support::kSanitized ? 1'000u : 10'000u);
  EXPECT_GT(resumed, testing_support::kSanitized ? 50u : 500u);
  EXPECT_GT(repaired, testing_support::kSanitized ? 50u : 500u);
}

TEST(Replica, RefusesToResumeTheSameLeafTwice) {
  Replica replica;
  const std::vector<wire::HeldLeaf> leaves{{{2, 1, 0}, 5}, {{2, 2, 0}, 6}};
  EXPECT_TRUE(replica.resume(leaves));
  EXPECT_FALSE(replica.resume({leaves.data(), 1}));
  EXPECT_EQ(replica.leaves(), 2u);
  EXPECT_EQ(replica.meshHash(), mesh::hashTerm({2, 1, 0}, 5) + mesh::hashTerm({2, 2, 0}, 6));
}

}  // namespace
}  // namespace ridgecast::replica
