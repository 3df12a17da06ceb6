// A client against a server that lies or is silent. (How it comes back: tests/unit/client/core/conversation/reconnector_test.cpp.)
#include "client/link/client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <string>

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
