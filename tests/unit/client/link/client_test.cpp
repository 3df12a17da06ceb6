// A client against a server that lies, hangs up and comes back, at times with another world. (Real servers: tests/e2e/resume_test.cpp.)
#include "client/link/client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "common/codec/codec.h"
#include "common/wire/wire.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_world.h"

namespace ridgecast::link {
namespace {

using namespace std::chrono_literals;
using test::RawConnection;
using test::RawServer;
using testing_support::kTimeout;

core::Url at(const RawServer& server) { return {.host = "127.0.0.1", .port = server.port(), .session = "default"}; }

void greet(RawConnection& peer, std::uint64_t contentHash) {
  peer.upgrade();
  peer.readFrame();  // hello
  wire::World world = test::rawWorld();
  world.contentHash = contentHash;
  peer.sendFrame(wire::encode(wire::ServerMessage(world)));
}

// What the client says next.
wire::ClientMessage read(RawConnection& peer) {
  const std::string frame = peer.readFrame();
  return wire::decodeClient({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()}).value();
}

void sendIteration(RawConnection& peer, std::uint64_t number, std::uint64_t pose, const mesh::LeafMesh& leaf, bool truly = true) {
  wire::Iteration it;
  it.number = number;
  it.poseSequence = pose;
  it.meshHash = mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf)) + (truly ? 0 : 1);
  it.whole.push_back({leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
                      codec::encodeLeaf(leaf)});
  peer.sendFrame(wire::encode(wire::ServerMessage(it)));
}

mesh::LeafMesh anyLeaf() {
  support::Random random(1);
  return support::terrainLike(random, 4, 0);
}

TEST(Client, RequestsLeavesAgainBeforeItAcknowledgesAHashThatDiffers) {
  const mesh::LeafMesh leaf = anyLeaf();
  RawServer server([&](RawConnection& peer) {
    greet(peer, 1);
    const auto pose = std::get<wire::PoseMessage>(read(peer));
    sendIteration(peer, 1, pose.sequence, leaf, false);
    EXPECT_TRUE(std::get<wire::ResendLeaves>(read(peer)).leaves.empty());
    EXPECT_EQ(std::get<wire::Acknowledge>(read(peer)).iteration, 1u);
    sendIteration(peer, 2, pose.sequence, leaf);
    EXPECT_EQ(std::get<wire::Acknowledge>(read(peer)).meshHash, mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf)));
    peer.drain();
  });
  const auto client = Client::open(at(server), {}).value();
  const auto wrong = client->await(client->send({}), kTimeout).value();
  ASSERT_TRUE(wrong.wrong);
  EXPECT_NE(wrong.wrong->message.find("its hash differs"), std::string::npos) << wrong.wrong->message;
  const auto right = client->receive(kTimeout);
  ASSERT_TRUE(right);
  EXPECT_FALSE(right->wrong);
  EXPECT_GT(right->bytes, 0u);
}

TEST(Client, DecodesBesideTheOwnerAndSaysWhenItIsReady) {
  const mesh::LeafMesh leaf = anyLeaf();
  RawServer server([&](RawConnection& peer) {
    greet(peer, 1);
    sendIteration(peer, 1, 0, leaf);
    EXPECT_EQ(std::get<wire::Acknowledge>(read(peer)).iteration, 1u);
    peer.drain();
  });
  const auto client = Client::open(at(server), {}).value();
  std::atomic<int> ready = 0;
  std::optional<Update> update;
  EXPECT_TRUE(testing_support::await([&] { return (update = client->poll(0ms, [&] { ++ready; })).has_value(); }));
  EXPECT_EQ(ready, 1);
  EXPECT_EQ(client->scene().triangles(), leaf.triangles.size());
}

TEST(Client, NamesWhatItHoldsToTheNextConnectionAndSendsItsPoseAgain) {
  const mesh::LeafMesh leaf = anyLeaf();
  int connections = 0;
  RawServer server(
      [&](RawConnection& peer) {
        greet(peer, 1);
        if (++connections == 1) {
          sendIteration(peer, 1, std::get<wire::PoseMessage>(read(peer)).sequence, leaf);
          read(peer);
          return;
        }
        const auto held = std::get<wire::Resume>(read(peer)).leaves;
        ASSERT_EQ(held.size(), 1u);
        EXPECT_EQ(held[0].hash, mesh::hashLeaf(leaf));
        const auto pose = std::get<wire::PoseMessage>(read(peer));
        EXPECT_EQ(pose.sequence, 1u);
        EXPECT_EQ(pose.state, (std::vector<std::uint8_t>{1, 2}));
        sendIteration(peer, 1, 1, leaf);
        read(peer);
      },
      2);
  const auto client = Client::open(at(server), {}).value();
  ASSERT_TRUE(client->await(client->send({}, {1, 2}), kTimeout));
  const auto again = client->receive(kTimeout);
  ASSERT_TRUE(again);
  EXPECT_FALSE(again->wrong);
  EXPECT_EQ(client->connection().reconnections(), 1u);
  EXPECT_EQ(client->resumed(), 1u);
}

// Asked twenty times a second for ever, once.
TEST(Client, WaitsLongerEachTimeUntilAnIterationCanBeApplied) {
  const mesh::LeafMesh leaf = anyLeaf();
  constexpr int kConnections = 6;
  RawServer server(
      [&](RawConnection& peer) {
        greet(peer, 1);
        sendIteration(peer, 1, 0, leaf, false);
        read(peer);
      },
      kConnections);
  const auto began = std::chrono::steady_clock::now();
  const auto client = Client::open(at(server), {}).value();
  for (int k = 0; k < kConnections; ++k) ASSERT_TRUE(client->receive(kTimeout)->wrong);
  EXPECT_GE(std::chrono::steady_clock::now() - began, (50ms + 100ms + 200ms + 400ms + 800ms) / 2);
}

TEST(Client, StaysWithWhatItHoldsWhereTheServerHasAnotherWorld) {
  const mesh::LeafMesh leaf = anyLeaf();
  std::uint64_t world = 0;
  RawServer server(
      [&](RawConnection& peer) {
        greet(peer, ++world);
        if (world > 1) return peer.drain();
        sendIteration(peer, 1, 0, leaf);
        read(peer);
      },
      2);
  const auto client = Client::open(at(server), {}).value();
  ASSERT_TRUE(client->receive(kTimeout));
  EXPECT_FALSE(client->receive(kTimeout));
  EXPECT_TRUE(client->connection().otherWorld());
  EXPECT_TRUE(client->connection().error());
  EXPECT_EQ(client->world().contentHash, 1u);
  EXPECT_EQ(client->scene().triangles(), leaf.triangles.size());
}

TEST(Client, EndsWithItsConnectionWhereItIsToldTo) {
  RawServer server([&](RawConnection& peer) { greet(peer, 1); });
  const auto client = Client::open(at(server), {}, {.reconnects = false}).value();
  const auto awaited = client->await(client->send({}), kTimeout);
  ASSERT_FALSE(awaited);
  EXPECT_EQ(awaited.error().message, client->connection().error()->message);
  EXPECT_EQ(client->connection().reconnections(), 0u);
}

TEST(Client, SaysThatNoAnswerCame) {
  RawServer server([&](RawConnection& peer) {
    greet(peer, 1);
    peer.drain();
  });
  const auto client = Client::open(at(server), {}).value();
  const auto awaited = client->await(client->send({}), 50ms);
  ASSERT_FALSE(awaited);
  EXPECT_NE(awaited.error().message.find("has not answered a pose"), std::string::npos) << awaited.error().message;
}

}  // namespace
}  // namespace ridgecast::link
