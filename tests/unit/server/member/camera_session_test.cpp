#include "server/member/camera_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <thread>

#include "tests/unit/server/member/session_fixture.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using wire::ErrorCode;

TEST_F(SessionTest, APrivateTerrainKeepsItsTextAndSaysWhichItIs) {
  Limits limits;
  limits.sendsTerrain = false;
  start(limits);
  camera->receive(hello());
  const auto world = client->world();
  ASSERT_TRUE(world);
  EXPECT_EQ(world->terrainSource, "");
  EXPECT_EQ(world->terrainName, "flat");
  EXPECT_EQ(world->contentHash, terrain::contentHash(*flatTerrain()));
}

TEST_F(SessionTest, HelloIsAnsweredWithTheWorldAndWhatWasGranted) {
  Limits limits;
  limits.window = 3;
  limits.maxBytesPerSecond = 4096;
  start(limits);
  wire::Hello h = hello();
  h.settings.triangleBudget = 4'000'000'000u;
  h.settings.bytesPerSecond = 1'000'000;
  camera->receive(h);
  const auto world = client->world();
  ASSERT_TRUE(world);
  EXPECT_EQ(world->terrainName, "flat");
  EXPECT_EQ(world->terrainSource, "// flat");
  EXPECT_EQ(world->seed, 5u);
  EXPECT_EQ(world->session, "default");
  EXPECT_EQ(world->window, 3u);
  EXPECT_EQ(world->settings.bytesPerSecond, 4096u);
  EXPECT_EQ(world->camera, camera->id());
  EXPECT_EQ(world->contentHash, terrain::contentHash(*flatTerrain()));
  EXPECT_NE(world->contentHash, terrain::contentHash(*flatTerrain(6)));
  EXPECT_EQ(world->settings.triangleBudget, pipeline::Limits{}.maxBudget);
  EXPECT_TRUE(client->quiet()) << "no pose, no iteration";
}

TEST_F(SessionTest, MessagesOutOfPlaceAreRefusedByName) {
  auto error = refusal({pose(1)});
  EXPECT_EQ(error.code, ErrorCode::kMalformed);
  EXPECT_THAT(error.message, HasSubstr("hello"));
  EXPECT_EQ(refusal({wire::Acknowledge{1, 2}}).code, ErrorCode::kMalformed);
  EXPECT_EQ(refusal({wire::ResendLeaves{}}).code, ErrorCode::kMalformed);
  EXPECT_EQ(refusal({hello(), hello()}).code, ErrorCode::kMalformed);

  wire::Hello other = hello();
  other.protocolVersion = 7;
  error = refusal({other});
  EXPECT_EQ(error.code, ErrorCode::kVersion);
  EXPECT_THAT(error.message, testing::AllOf(HasSubstr("version 1"), HasSubstr("version 7")));

  EXPECT_EQ(refusal({hello(), pose(0)}).code, ErrorCode::kInvalid);
  EXPECT_EQ(refusal({hello(), pose(3), pose(3)}).code, ErrorCode::kInvalid);
  EXPECT_EQ(refusal({hello(), wire::Acknowledge{1, 0}}).code, ErrorCode::kInvalid);
}

TEST_F(SessionTest, AfterAnErrorEverythingIsIgnored) {
  start();
  camera->receive(hello());
  camera->receive(pose(0));
  ASSERT_TRUE(client->error());
  camera->receive(pose(1));
  camera->receive(hello());
  std::this_thread::sleep_for(30ms);  // a second error would be a complaint
  EXPECT_EQ(client->sent(), 0u);
}

TEST_F(SessionTest, LockstepBoundsItsQueue) {
  start();
  camera->receive(hello(wire::Pacing::kLockstep));
  for (std::uint64_t k = 1; k <= 2 * conversation::kMaxQueuedPoses; ++k) camera->receive(pose(k));  // never acknowledged
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kLimit);
}

TEST_F(SessionTest, AClientThatNeverAgreesIsSentAway) {
  start();
  camera->receive(hello());
  camera->receive(pose(1));
  for (int k = 0; k <= replica::kMaxRepairs; ++k) {
    const auto i = client->iteration();
    ASSERT_TRUE(i);
    camera->receive(wire::Acknowledge{i->number, 12345});
  }
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kInvalid);
}

// Everything at once, from several threads: nothing but the laws that the client checks by itself.
TEST_F(SessionTest, StressOfMessagesFromSeveralThreads) {
  script->next = [](int n, const camera::Camera& c) {
    Script::State state;
    std::mt19937 random(static_cast<unsigned>(n));
    for (int k = 0; k < 12; ++k)
      state.leaves[{0, static_cast<std::int64_t>(random() % 20), static_cast<std::int64_t>(c.pose.y) % 3}] =
          static_cast<std::int32_t>(random() % 3);
    state.settled = n % 7 == 0;
    return state;
  };
  for (const unsigned threads : {1u, 3u}) {
    client = std::make_shared<Client>();
    start({}, threads);
    camera->receive(hello());
    std::atomic<bool> stop{false};
    std::thread poses([&] {
      for (std::uint64_t k = 1; !stop; ++k) {
        camera->receive(pose(k, double(k)));
        std::this_thread::sleep_for(100us);
      }
    });
    std::thread resends([&] {
      while (!stop) {
        camera->receive(wire::ResendLeaves{{{0, 3, 1}}});
        std::this_thread::sleep_for(1ms);
      }
    });
    for (int k = 0; k < 150; ++k) {
      const auto i = client->iteration();
      ASSERT_TRUE(i);
      acknowledge(*i);
    }
    stop = true;
    poses.join();
    resends.join();
    EXPECT_EQ(client->complaint(), "");
    camera->close();
  }
}

TEST_F(SessionTest, OtherSettingsAreGrantedAndMakeTheNextIteration) {
  ASSERT_TRUE(firstRest());
  // At rest, without another pose: an iteration is made, and what was asked for is limited as in hello.
  script->next = [](int, const camera::Camera&) { return Script::State{{{kA, 2}}, true}; };
  camera->receive(wire::ChangeSettings{{wire::Metric::kDefault, 0.001, 5'000'000, 100}});
  const auto second = client->iteration();
  ASSERT_TRUE(second);
  ASSERT_EQ(client->granted().size(), 1u);
  const wire::Settings granted = client->granted().front();
  EXPECT_EQ(granted.metric, wire::Metric::kPixels);
  EXPECT_EQ(granted.threshold, 0.05);
  EXPECT_EQ(granted.triangleBudget, 2'000'000u);
  EXPECT_EQ(granted.bytesPerSecond, kMinBytesPerSecond);
  EXPECT_THAT(script->changes, testing::ElementsAre(std::pair(1, granted)));
}

TEST_F(SessionTest, CandidatesComeWhileTheyAreWantedAndWithIterationsAlone) {
  const auto first = firstRest();
  ASSERT_TRUE(first);
  EXPECT_FALSE(first->candidates) << "nobody asked";
  // At rest: they are told at once, though the mesh stays what it is, once.
  script->next = [](int, const camera::Camera&) { return Script::State{{{kA, 1}}, true}; };
  camera->receive(wire::ChangeSettings{{.candidates = 1'000'000}});
  const auto second = client->iteration();
  ASSERT_TRUE(second);
  EXPECT_EQ(client->granted().back().candidates, wire::kMaxCandidates);
  ASSERT_TRUE(second->candidates);
  EXPECT_EQ(second->candidates->size(), wire::kMaxCandidates);
  EXPECT_EQ(second->candidates->front().at.y, script->iterations) << "of another iteration";
  acknowledge(*second);
  EXPECT_TRUE(client->quiet());
  camera->receive(wire::ChangeSettings{{.candidates = 7}});
  camera->receive(pose(2));
  std::optional<wire::Iteration> third = client->iteration();
  ASSERT_TRUE(third);
  if (third->poseSequence == 1) acknowledge(*third), third = client->iteration();
  ASSERT_TRUE(third && third->candidates);
  EXPECT_EQ(third->candidates->size(), 7u);
  acknowledge(*third);
  // Not wanted any more: they end, and nothing is sent for that.
  camera->receive(wire::ChangeSettings{});
  EXPECT_TRUE(client->quiet());
  camera->receive(pose(3));
  const auto last = client->iteration();
  ASSERT_TRUE(last);
  EXPECT_FALSE(last->candidates);
  EXPECT_EQ(client->granted().back().candidates, 0u);
}

TEST_F(SessionTest, InLockStepOtherSettingsAreForThePosesThatComeAfter) {
  start();
  camera->receive(hello(wire::Pacing::kLockstep));
  ASSERT_TRUE(client->world());
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}}, false}; };
  for (int k = 1; k <= 3; ++k) camera->receive(pose(static_cast<std::uint64_t>(k)));
  camera->receive(wire::ChangeSettings{{wire::Metric::kArea, 3, 0, 0}});
  camera->receive(pose(4));
  for (int k = 1; k <= 4; ++k) {
    const auto iteration = client->iteration();
    ASSERT_TRUE(iteration);
    acknowledge(*iteration);
  }
  ASSERT_EQ(script->changes.size(), 1u);
  EXPECT_EQ(script->changes.front().first, 3);
  EXPECT_EQ(script->changes.front().second.metric, wire::Metric::kArea);
  for (std::size_t k = 0; k <= conversation::kMaxQueuedPoses; ++k) camera->receive(wire::ChangeSettings{});
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kLimit);
}

TEST_F(SessionTest, OtherSettingsWaitForTheWorld) {
  start();
  camera->receive(wire::ChangeSettings{});
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kMalformed);
  EXPECT_THAT(error->message, HasSubstr("hello"));
}

}  // namespace
}  // namespace ridgecast::session
