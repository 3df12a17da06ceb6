#pragma once
// A camera in the default session of a directory, with a scripted mesh and a recording client.

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/directory/directory.h"
#include "server/session/session.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::session {

inline constexpr lattice::LeafAddress kA{1, 0, 0}, kB{1, 1, 0}, kC{2, -3, 4};

inline wire::PoseMessage pose(std::uint64_t sequence, double y = 100) {
  wire::PoseMessage p;
  p.sequence = sequence;
  p.camera.pose.y = y;
  return p;
}
inline wire::Hello hello(wire::Pacing pacing = wire::Pacing::kFree) {
  wire::Hello h;
  h.pacing = pacing;
  return h;
}

class SessionTest : public testing::Test {
 protected:
  void SetUp() override {
    // At rest at once, unless a test says otherwise.
    script->next = [](int, const camera::Camera&) { return Script::State{{{kA, 1}}, true}; };
  }
  void TearDown() override {
    stop();
    EXPECT_EQ(client->complaint(), "");
  }
  void stop() {
    if (camera) camera->close();
    camera.reset();
    executor.reset();
  }

  void start(const Limits& limits = {}, unsigned threads = 2) {
    stop();
    executor = std::make_unique<scheduling::Executor>(threads);
    auto made = std::make_shared<Resources>();
    made->executor = executor.get();
    made->makeMesh = scriptedMeshes(script);
    made->serverName = "test";
    made->limits = limits;
    directory = std::make_unique<Directory>(made, flatTerrain());
    join();
  }
  void join() {
    auto session = directory->find(kDefaultName);
    camera = std::make_shared<CameraSession>(session, std::move(*session->enter()), directory->nextCameraId(), client);
  }
  // What a fresh client is told for these messages.
  wire::ErrorMessage refusal(const std::vector<wire::ClientMessage>& messages) {
    client = std::make_shared<Client>();
    start();
    for (auto& m : messages) camera->receive(m);
    const auto error = client->error();
    EXPECT_TRUE(error);
    camera->close();
    return error.value_or(wire::ErrorMessage{});
  }
  // A camera at rest after its first pose, and what it was told.
  std::optional<wire::Iteration> firstRest() {
    start();
    camera->receive(hello());
    EXPECT_TRUE(client->world());
    camera->receive(pose(1));
    auto first = client->iteration();
    EXPECT_TRUE(first);
    if (!first) return {};
    acknowledge(*first);
    EXPECT_TRUE(client->quiet());
    return first;
  }
  void acknowledge(const wire::Iteration& iteration) { camera->receive(wire::Acknowledge{iteration.number, iteration.meshHash}); }

  std::shared_ptr<Script> script = std::make_shared<Script>();
  std::unique_ptr<scheduling::Executor> executor;
  std::unique_ptr<Directory> directory;
  std::shared_ptr<Client> client = std::make_shared<Client>();
  std::shared_ptr<CameraSession> camera;
};

}  // namespace ridgecast::session
