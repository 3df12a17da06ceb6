// The law of the follower: after any sequence of iterations, damage, loss and resuming it holds what the server holds. The server's side is
// server/replica itself, with real meshes, payloads and deltas.
#include "client/replica/follower.h"

#include <gtest/gtest.h>

#include <deque>
#include <iterator>
#include <map>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/mesh/leaf_mesh.h"
#include "server/replica/replica.h"
#include "tests/support/leaf_meshes.h"

namespace ridgecast::replica {
namespace {

using lattice::LeafAddress;
using support::between;
using support::Random;
using Leaves = std::map<LeafAddress, mesh::LeafMesh>;

wire::LeafWhole wholeOf(const mesh::LeafMesh& leaf) {
  return {.address = leaf.address,
          .vertices = static_cast<std::uint32_t>(leaf.vertices.size()),
          .triangles = static_cast<std::uint32_t>(leaf.triangles.size()),
          .payload = codec::encodeLeaf(leaf)};
}

// A few roots whose leaves split, merge, change, come and go.
class World {
 public:
  explicit World(Random& random) : random_(random) {
    for (int k = 0; k < 3; ++k) put({2, k, 0}, fresh({2, k, 0}));
  }
  void change() {
    const auto it = std::next(leaves_.begin(), between(random_, 0, static_cast<std::int64_t>(leaves_.size()) - 1));
    const LeafAddress a = it->first;
    const mesh::LeafMesh before = it->second;
    const mesh::LeafMesh* const source = &before;
    switch (between(random_, 0, 5)) {
      case 0:
        if (a.level == 0) return;
        remove(a);
        for (int q = 0; q < 4; ++q) put(a.child(q), mesh::gather(a.child(q), {&source, 1}));
        return;
      case 1:
        if (a.level == 2) return;
        remove(a.parent());
        return put(a.parent(), fresh(a.parent()));
      case 2: {
        const LeafAddress root{2, between(random_, 0, 4), 0};
        remove(root);
        if (leaves_.empty() || between(random_, 0, 1)) put(root, fresh(root));
        return;
      }
      default:
        put(a, between(random_, 0, 2) ? support::torn(random_, before, 0.1) : fresh(a));
    }
  }
  std::vector<mesh::LeafState> list() const {
    std::vector<mesh::LeafState> out;
    for (const auto& [a, leaf] : leaves_) out.push_back({a, versions_.at(a), mesh::hashLeaf(leaf), 5});
    return out;
  }
  const Leaves& leaves() const { return leaves_; }

 private:
  mesh::LeafMesh fresh(LeafAddress address) {
    mesh::LeafMesh leaf = support::terrainLike(random_, static_cast<int>(between(random_, 1, 5)), address.level);
    leaf.address = address;
    const mesh::LeafMesh* const source = &leaf;
    return mesh::gather(address, {&source, 1});
  }
  void put(LeafAddress address, mesh::LeafMesh leaf) {
    leaves_[address] = std::move(leaf);
    versions_[address] = ++version_;
  }
  void remove(LeafAddress root) {
    std::erase_if(leaves_, [&](const auto& leaf) { return leaf.first == root || root.isAncestorOf(leaf.first); });
  }

  Random& random_;
  Leaves leaves_;
  std::map<LeafAddress, std::uint64_t> versions_;
  std::uint64_t version_ = 0;
};

struct Counts {
  int deltas = 0, damaged = 0, repaired = 0, resumed = 0, hopeless = 0;
};

// Server, line and client.
struct Stream {
  explicit Stream(unsigned seed) : random(seed), world(random) { connect(); }

  void connect() {
    underWay.clear();
    server = Replica(static_cast<std::uint32_t>(between(random, 1, 4)), between(random, 0, 5) != 0);
    sent.clear();
    for (const wire::Resume& part : follower.resume()) {
      EXPECT_TRUE(server.resume(part.leaves));
      for (const wire::HeldLeaf& leaf : part.leaves) sent[leaf.address] = *follower.scene().leaves().at(leaf.address).mesh;
    }
    EXPECT_EQ(server.meshHash(), follower.scene().hash());
  }

  void send() {
    const Changes changes = server.send(world.list());
    wire::Iteration iteration;
    iteration.number = changes.number;
    iteration.meshHash = changes.meshHash;
    iteration.gone = changes.gone;
    for (const LeafAddress& a : changes.whole) iteration.whole.push_back(wholeOf(world.leaves().at(a)));
    for (const Derived& d : changes.changed) {
      std::vector<const mesh::LeafMesh*> sources;
      for (std::uint32_t k = 0; k < d.count; ++k) sources.push_back(&sent.at(changes.sources[d.first + k]));
      const mesh::LeafMesh base = sources.front()->address == d.address ? *sources.front() : mesh::gather(d.address, sources);
      const mesh::LeafMesh& leaf = world.leaves().at(d.address);
      if (leaf == base) {
        iteration.changed.push_back({d.address, {}});
      } else if (auto delta = codec::encodeDelta(base, leaf, d.hash)) {
        iteration.changed.push_back({d.address, std::move(*delta)});
      } else {
        iteration.whole.push_back(wholeOf(leaf));
      }
    }
    counts.deltas += static_cast<int>(iteration.changed.size());
    sent = world.leaves();
    underWay.push_back(std::move(iteration));
  }

  // Something goes wrong with what is under way.
  void damage() {
    wire::Iteration& it = underWay[static_cast<std::size_t>(between(random, 0, static_cast<std::int64_t>(underWay.size()) - 1))];
    ++counts.damaged;
    switch (between(random, 0, 3)) {
      case 0:  // another leaf than was meant
        if (!it.whole.empty()) it.whole.front() = wholeOf(anything(it.whole.front().address));
        return;
      case 1:  // no leaf at all
        if (!it.whole.empty()) it.whole.back().payload.assign(3, 0xff);
        return;
      case 2:  // a delta with a bit flipped
        if (!it.changed.empty() && !it.changed.front().payload.empty()) it.changed.front().payload.back() ^= 1;
        return;
      default:  // the whole of it, where another follows; otherwise the line
        underWay.size() > 1 ? underWay.pop_front() : connect();
    }
  }

  void receive() {
    const wire::Iteration iteration = std::move(underWay.front());
    underWay.pop_front();
    const auto answer = follower.apply(iteration);
    EXPECT_EQ(answer.acknowledge.meshHash, follower.scene().hash());
    EXPECT_EQ(answer.wrong.has_value(), follower.scene().hash() != iteration.meshHash || follower.scene().iteration() == 0);
    if (answer.resend) {
      ++counts.repaired;
      server.resend(answer.resend->leaves);
    }
    const Verdict verdict = server.acknowledge(answer.acknowledge.iteration, answer.acknowledge.meshHash);
    if (verdict != Verdict::kHopeless) {
      EXPECT_TRUE(verdict == Verdict::kAgrees || verdict == Verdict::kRepairs);
      return;
    }
    ++counts.hopeless;  // the server hangs up, the client comes back
    connect();
  }

  mesh::LeafMesh anything(LeafAddress address) {
    mesh::LeafMesh leaf = support::terrainLike(random, 3, address.level);
    leaf.address = address;
    return leaf;
  }

  void expectEqual() const {
    ASSERT_EQ(follower.scene().leaves().size(), world.leaves().size());
    for (const auto& [address, leaf] : world.leaves()) EXPECT_TRUE(*follower.scene().leaves().at(address).mesh == leaf);
    EXPECT_EQ(follower.scene().hash(), server.meshHash());
    EXPECT_FALSE(follower.scene().damaged());
  }

  Random random;
  World world;
  Replica server;
  Leaves sent;  // what the client holds once it has everything, as the server thinks
  std::deque<wire::Iteration> underWay;
  Follower follower;
  Counts counts;
};

TEST(Follower, HoldsWhatTheServerHoldsWhateverHappensOnTheWay) {
  Counts all;
  for (unsigned seed = 0; seed < 40; ++seed) {
    Stream stream(seed);
    for (int step = 0; step < 400; ++step) {
      for (auto n = between(stream.random, 0, 2); n > 0; --n) stream.world.change();
      if (stream.server.hasRoom() && between(stream.random, 0, 3)) stream.send();
      if (!stream.underWay.empty() && between(stream.random, 0, 19) == 0) stream.damage();
      if (!stream.underWay.empty() && between(stream.random, 0, 1)) stream.receive();
      if (between(stream.random, 0, 49) == 0) {
        stream.connect();
        ++all.resumed;
      }
      ASSERT_FALSE(testing::Test::HasFailure()) << "seed " << seed << ", step " << step;
    }
    // At rest: one round for what was under way, one to notice, one to repair.
    for (int round = 0; round < 4; ++round) {
      if (stream.server.hasRoom()) stream.send();
      while (!stream.underWay.empty()) stream.receive();
    }
    stream.expectEqual();
    all.deltas += stream.counts.deltas;
    all.damaged += stream.counts.damaged;
    all.repaired += stream.counts.repaired;
    all.hopeless += stream.counts.hopeless;
  }
  EXPECT_GT(all.deltas, 5000);
  EXPECT_GT(all.damaged, 200);
  EXPECT_GT(all.repaired, 100);
  EXPECT_GT(all.resumed, 200);
}

wire::Iteration iterationOf(std::uint64_t number, const std::vector<mesh::LeafMesh>& leaves, std::uint64_t meshHash) {
  wire::Iteration it;
  it.number = number;
  it.meshHash = meshHash;
  for (const mesh::LeafMesh& leaf : leaves) it.whole.push_back(wholeOf(leaf));
  return it;
}

TEST(Follower, SaysNothingButTheHashWhereAllAgrees) {
  Random random(3);
  const mesh::LeafMesh leaf = support::terrainLike(random, 4, 0);
  const std::uint64_t hash = mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf));
  Follower follower;
  const auto answer = follower.apply(iterationOf(1, {leaf}, hash));
  EXPECT_FALSE(answer.wrong || answer.resend);
  EXPECT_EQ(answer.acknowledge.iteration, 1u);
  EXPECT_EQ(answer.acknowledge.meshHash, hash);
}

TEST(Follower, DropsAllThatItHoldsAndAsksForItWhereAnIterationCannotBeApplied) {
  Random random(4);
  const mesh::LeafMesh leaf = support::terrainLike(random, 4, 0);
  Follower follower;
  follower.apply(iterationOf(1, {leaf}, 0));
  const auto answer = follower.apply(iterationOf(3, {}, 0));
  ASSERT_TRUE(answer.wrong && answer.resend);
  EXPECT_NE(answer.wrong->message.find("out of order"), std::string::npos) << answer.wrong->message;
  EXPECT_TRUE(answer.resend->leaves.empty());
  EXPECT_TRUE(follower.scene().leaves().empty());
}

TEST(Follower, NamesLeavesThatItKnowsToBeDamagedOnce) {
  Random random(5);
  const mesh::LeafMesh held = support::terrainLike(random, 4, 0);
  mesh::LeafMesh thought = support::terrainLike(random, 5, 0);
  thought.address = held.address;
  const mesh::LeafMesh next = support::torn(random, thought, 0.2);
  Follower follower;
  EXPECT_TRUE(follower.apply(iterationOf(1, {held}, 7)).resend->leaves.empty());
  wire::Iteration it;
  it.number = 2;
  it.changed = {{next.address, codec::encodeDelta(thought, next, mesh::hashLeaf(next)).value()}};
  EXPECT_EQ(follower.apply(it).resend->leaves, std::vector<LeafAddress>{held.address});
  it.number = 3;
  EXPECT_FALSE(follower.apply(it).resend) << "twice";
}

TEST(Follower, ResumesInMessagesThatAServerTakes) {
  Follower follower;
  wire::Iteration it;
  it.number = 1;
  for (int k = 0; k < 5000; ++k) it.whole.push_back({.address = {0, k, 0}, .vertices = 0, .triangles = 0, .payload = {}});
  follower.apply(it);
  const auto parts = follower.resume();
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_EQ(parts[0].leaves.size(), 2048u);
  EXPECT_EQ(parts[2].leaves.size(), 904u);
  EXPECT_TRUE(Follower().resume().empty());
}

}  // namespace
}  // namespace ridgecast::replica
