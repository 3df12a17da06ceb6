// The law of the follower: after any sequence of iterations, damage, loss and resuming it holds what the server holds. The server's side is
// server/replica itself, with real meshes, points and payloads.
#include "client/core/mesh/follower.h"

#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <optional>

#include "common/codec/codec.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "server/encoding/encoder.h"
#include "server/pipeline/pipeline.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"
#include "tests/support/flight.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/sanitized.h"

namespace ridgecast::core {
namespace {

using lattice::LeafAddress;
using replica::Replica;
using replica::Verdict;
using support::between;
using support::Random;

wire::LeafWhole wholeOf(const mesh::LeafMesh& leaf) {
  return {.address = leaf.address,
          .vertices = static_cast<std::uint32_t>(leaf.vertices.size()),
          .triangles = static_cast<std::uint32_t>(leaf.triangles.size()),
          .payload = codec::encodeLeaf(leaf)};
}

struct Counts {
  int points = 0, damaged = 0, repaired = 0, resumed = 0, hopeless = 0;
};

// Server, line and client.
struct Stream {
  explicit Stream(unsigned seed) : random(seed), executor(1), mesh(terrain, pipeline::grant(settings(), {}), executor.makePool()) {
    move();
    connect();
  }

  static settings::Settings settings() {
    settings::Settings out;
    out.threshold = 4;
    out.triangleBudget = 30'000;
    return out;
  }

  // Mostly a few metres on, at times far enough that leaves split and merge, seldom somewhere else.
  void move() {
    if (between(random, 0, 49) == 0) x = static_cast<double>(between(random, -1'000'000, 1'000'000));
    x += static_cast<double>(between(random, 0, 3) == 0 ? between(random, -400, 400) : between(random, -5, 5));
    mesh.iterate(testing_support::cameraAt(*terrain, x, 0.3 * x, 100 + static_cast<double>(between(random, 0, 50)), 0.01 * x, -0.3));
  }

  void connect() {
    underWay.clear();
    follows = between(random, 0, 5) != 0;
    server = Replica(static_cast<std::uint32_t>(between(random, 1, 4)), follows);
    encoder.emplace(terrain, executor.makePool(), encoding::Form{follows, false, false});
    wire::World world;
    world.revision = random() % 2 == 0 ? 6 : 7;
    follower.follow({follows, false});
    const auto held = follower.enter(world);
    for (const wire::Resume& part : held) {
      EXPECT_EQ(part.meshHash != 0, follows && world.revision == 7);
      EXPECT_TRUE(part.meshHash != 0 ? server.resume(part.meshHash) : server.resume(part.leaves));
    }
    EXPECT_EQ(server.meshHash() + server.resumedHash(), follower.scene().hash());
  }

  void send() {
    wire::Iteration iteration;
    encoder->encode(server.send(mesh.leaves()), mesh, iteration);
    counts.points += iteration.points.size() > 1;
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
      case 2:  // points with a bit flipped
        if (it.points.size() > 1)
          it.points[static_cast<std::size_t>(between(random, 1, static_cast<std::int64_t>(it.points.size()) - 1))] ^=
              1 << between(random, 0, 7);
        return;
      default:  // the whole of it, where another follows; otherwise the line
        underWay.size() > 1 ? underWay.pop_front() : connect();
    }
  }

  void receive() {
    const wire::Iteration iteration = std::move(underWay.front());
    underWay.pop_front();
    const auto answer = follow(iteration);
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

  // Leaves are read at any time, or made at once.
  Follower::Answer follow(const wire::Iteration& iteration) {
    if (between(random, 0, 2) == 0) {
      follower.scene().leaves();
      return follower.take(iteration, follower.prepare(iteration));
    }
    auto answer = follower.apply(iteration);
    for (const auto& [address, leaf] : follower.scene().index())
      if (between(random, 0, 9) == 0) {
        const HeldLeaf before = leaf;
        const HeldLeaf& made = *follower.scene().leaf(address);
        EXPECT_EQ(mesh::hashLeaf(*made.mesh), before.hash);
        EXPECT_TRUE(before.low.x <= made.low.x && before.low.z <= made.low.z && before.low.y <= made.low.y);
        EXPECT_TRUE(before.high.x >= made.high.x && before.high.z >= made.high.z && before.high.y >= made.high.y);
      }
    return answer;
  }

  mesh::LeafMesh anything(LeafAddress address) {
    mesh::LeafMesh leaf = support::terrainLike(random, 3, address.level);
    leaf.address = address;
    return leaf;
  }

  void expectEqual() const {
    ASSERT_EQ(follower.scene().leaves().size(), mesh.leaves().size());
    for (const mesh::LeafState& leaf : mesh.leaves()) {
      mesh::LeafMesh held = *follower.scene().leaves().at(leaf.address).mesh;
      mesh::canonicalize(held);
      EXPECT_TRUE(held == mesh.extract(leaf.address));
    }
    EXPECT_EQ(follower.scene().hash(), server.meshHash());
    EXPECT_FALSE(follows && follower.scene().lost());
  }

  Random random;
  double x = 0;
  bool follows = false;  // points
  std::shared_ptr<const terrain::Terrain> terrain = *terrain::create("alpine", 1);
  scheduling::Executor executor;
  pipeline::Pipeline mesh;
  Replica server;
  std::optional<encoding::Encoder> encoder;
  std::deque<wire::Iteration> underWay;
  Follower follower;
  Counts counts;
};

TEST(Follower, HoldsWhatTheServerHoldsWhateverHappensOnTheWay) {
  Counts all;
  for (unsigned seed = 0; seed < (testing_support::kSanitized ? 3u : 6u); ++seed) {
    Stream stream(seed);
    for (int step = 0; step < 200; ++step) {
      if (between(stream.random, 0, 2)) stream.move();
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
    all.points += stream.counts.points;
    all.damaged += stream.counts.damaged;
    all.repaired += stream.counts.repaired;
    all.hopeless += stream.counts.hopeless;
  }
  EXPECT_GT(all.points, 200);
  EXPECT_GT(all.damaged, 10);
  EXPECT_GT(all.repaired, 3);
  EXPECT_GT(all.resumed, 5);
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

TEST(Follower, AsksOnceUntilTheHashesAgree) {
  Random random(5);
  const mesh::LeafMesh leaf = support::terrainLike(random, 4, 0);
  Follower follower;
  EXPECT_TRUE(follower.apply(iterationOf(1, {leaf}, 7)).resend);
  const auto twice = follower.apply(iterationOf(2, {}, 7));
  EXPECT_TRUE(twice.wrong && !twice.resend);
  EXPECT_FALSE(follower.apply(iterationOf(3, {leaf}, mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf)))).wrong);
  EXPECT_TRUE(follower.apply(iterationOf(4, {}, 7)).resend);
  follower.enter({});
  EXPECT_TRUE(follower.apply(iterationOf(1, {}, 7)).resend) << "over this connection nothing was requested yet";
}

TEST(Follower, SaysTheHashOfWhatItHoldsToAServerThatKnowsIt) {
  Random random(5);
  const mesh::LeafMesh leaf = support::terrainLike(random, 4, 0), other = support::terrainLike(random, 4, 1);
  const std::uint64_t hash = mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf)),
                      hashOfOther = mesh::hashTerm(other.address, mesh::hashLeaf(other));
  for (const bool keeps : {true, false}) {
    Follower follower;
    follower.follow({.points = true, .shades = false});
    wire::World world;
    world.resumeKey = "first";
    EXPECT_TRUE(follower.enter(world).empty());
    EXPECT_FALSE(follower.apply(iterationOf(1, {leaf}, hash)).wrong);
    world.resumeKey = "second";
    const auto said = follower.enter(world);
    ASSERT_EQ(said.size(), 1u);
    EXPECT_TRUE(said[0].leaves.empty());
    EXPECT_EQ(said[0].key, "first");
    EXPECT_EQ(said[0].meshHash, hash);
    EXPECT_EQ(follower.scene().leaves().size(), 1u) << "what is held stays until the first iteration";
    const auto answer = keeps ? follower.apply(iterationOf(1, {}, hash)) : follower.apply(iterationOf(1, {other}, hashOfOther));
    EXPECT_FALSE(answer.wrong);
    EXPECT_EQ(follower.scene().leaves().size(), 1u);
    EXPECT_EQ(follower.scene().gone().size(), keeps ? 0u : 1u);
    EXPECT_FALSE(follower.apply(iterationOf(2, {}, follower.scene().hash())).wrong);
    EXPECT_EQ(follower.scene().leaves().size(), 1u) << "only the first";
    EXPECT_EQ(follower.enter(world).at(0).key, "second");
  }
}

TEST(Follower, ResumesInMessagesThatAServerTakes) {
  Follower follower;
  wire::World early;
  early.revision = 6;
  wire::Iteration it;
  it.number = 1;
  for (int k = 0; k < 5000; ++k) it.whole.push_back({.address = {0, k, 0}, .vertices = 0, .triangles = 0, .payload = {}});
  follower.apply(it);
  const auto parts = follower.enter(early);
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_EQ(parts[0].leaves.size(), 2048u);
  EXPECT_EQ(parts[2].leaves.size(), 904u);
  EXPECT_TRUE(Follower().enter(early).empty());
}

}  // namespace
}  // namespace ridgecast::core
