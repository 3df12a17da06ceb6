#include "server/member/camera_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <thread>

#include "tests/support/waiting.h"
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
  start();
  wire::Hello h = hello();
  h.settings.triangleBudget = 4'000'000'000u;
  camera->receive(h);
  const auto world = client->world();
  ASSERT_TRUE(world);
  EXPECT_EQ(world->terrainName, "flat");
  EXPECT_EQ(world->terrainSource, "// flat");
  EXPECT_EQ(world->seed, 5u);
  EXPECT_EQ(world->session, "default");
  EXPECT_EQ(world->window, replica::kDefaultWindow);
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

TEST_F(SessionTest, AnswersEachNewPoseAndTellsRestOnce) {
  // Three iterations to come to rest after each pose; the second changes nothing and is not worth a message.
  auto since = std::make_shared<int>(0);
  auto last = std::make_shared<double>(0);
  script->next = [=](int, const camera::Camera& c) {
    if (c.pose.y != *last) *since = 0;
    *last = c.pose.y;
    ++*since;
    return Script::State{{{kA, static_cast<std::int32_t>(c.pose.y)}, {kB, 0}, {kC, *since >= 3 ? 3 : 1}}, *since >= 4};
  };
  start();
  camera->receive(hello());
  for (std::uint64_t sequence = 1; sequence <= 3; ++sequence) {
    camera->receive(pose(sequence, 100.0 + double(sequence)));
    std::vector<wire::Iteration> got;
    do {
      const auto i = client->iteration();
      ASSERT_TRUE(i);
      EXPECT_EQ(i->poseSequence, sequence);
      got.push_back(*i);
      acknowledge(*i);
    } while (!got.back().settled);
    EXPECT_EQ(got.size(), 3u);  // the answer, the change, the news that it is at rest
    EXPECT_TRUE(got.back().whole.empty());
    EXPECT_TRUE(client->quiet());
    const int before = script->iterations;
    std::this_thread::sleep_for(20ms);
    EXPECT_EQ(script->iterations, before) << "at rest nothing runs";
  }
  // A pose that changes nothing is answered all the same.
  camera->receive(pose(9, 103));
  const auto answer = client->iteration();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->poseSequence, 9u);
  EXPECT_TRUE(answer->settled);
  EXPECT_TRUE(client->quiet());
}

TEST_F(SessionTest, NewestPoseWins) {
  std::mutex gate;
  std::vector<double> seen;
  script->next = [&](int n, const camera::Camera& c) {
    const std::lock_guard lock(gate);
    seen.push_back(c.pose.y);
    return Script::State{{{kA, n}}, true};
  };
  start();
  camera->receive(hello());
  ASSERT_TRUE(client->world());
  {
    const std::lock_guard lock(gate);
    for (int k = 1; k <= 500; ++k) camera->receive(pose(static_cast<std::uint64_t>(k), k));
  }
  std::optional<wire::Iteration> i;
  do {
    i = client->iteration();
    ASSERT_TRUE(i);
    acknowledge(*i);
  } while (i->poseSequence != 500);
  const std::lock_guard lock(gate);
  EXPECT_LE(seen.size(), 2u);
  EXPECT_EQ(seen.back(), 500);
}

TEST_F(SessionTest, UnacknowledgedIterationsAreBounded) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}, {kB, n % 3}}, false}; };  // never at rest
  Limits limits;
  limits.window = 3;
  start(limits);
  camera->receive(hello());
  camera->receive(pose(1));
  std::vector<wire::Iteration> got;
  for (int k = 0; k < 3; ++k) got.push_back(client->iteration().value());
  EXPECT_TRUE(client->quiet());
  EXPECT_EQ(script->iterations, 3);
  acknowledge(got[1]);  // stands for two
  for (int k = 0; k < 2; ++k) got.push_back(client->iteration().value());
  EXPECT_TRUE(client->quiet());
  EXPECT_EQ(got.back().number, 5u);
}

TEST_F(SessionTest, AFullWayOutStopsIterations) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}}, false}; };
  start();
  camera->receive(hello());
  ASSERT_TRUE(client->world());
  client->queued = Limits{}.maxQueuedBytes + 1;
  camera->receive(pose(1));
  EXPECT_TRUE(client->quiet());
  EXPECT_EQ(script->iterations, 0);
  client->queued = 0;  // a large answer has left, of which nobody tells
  const auto iteration = client->iteration();
  ASSERT_TRUE(iteration);
  EXPECT_EQ(iteration->poseSequence, 1u);
}

TEST_F(SessionTest, LockstepIsOneIterationForEachPoseInOrder) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n / 2}}, false}; };  // not at rest, often unchanged
  start();
  camera->receive(hello(wire::Pacing::kLockstep));
  std::uint64_t posed = 0;
  for (; posed < conversation::kMaxQueuedPoses; ++posed) camera->receive(pose(posed + 1));
  for (std::uint64_t k = 1; k <= 100; ++k) {
    const auto i = client->iteration();
    ASSERT_TRUE(i) << k;
    EXPECT_EQ(i->number, k);
    EXPECT_EQ(i->poseSequence, k);
    acknowledge(*i);
    if (posed < 100) camera->receive(pose(++posed));
  }
  EXPECT_TRUE(client->quiet());
  EXPECT_EQ(script->iterations, 100);
}

TEST_F(SessionTest, LockstepBoundsItsQueue) {
  start();
  camera->receive(hello(wire::Pacing::kLockstep));
  for (std::uint64_t k = 1; k <= 2 * conversation::kMaxQueuedPoses; ++k) camera->receive(pose(k));  // never acknowledged
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kLimit);
}

TEST_F(SessionTest, LostLeavesAreSentAgainEvenAtRest) {
  script->next = [](int, const camera::Camera&) { return Script::State{{{kA, 1}, {kB, 2}, {kC, 0}}, true}; };
  start();
  camera->receive(hello());
  camera->receive(pose(1));
  auto i = client->iteration().value();
  EXPECT_EQ(i.whole.size(), 3u);
  acknowledge(i);
  EXPECT_TRUE(client->quiet());
  camera->receive(wire::ResendLeaves{{kB, {5, 5, 5}}});
  i = client->iteration().value();
  ASSERT_EQ(i.whole.size(), 1u);
  EXPECT_EQ(i.whole[0].address, kB);
  camera->receive(wire::Acknowledge{i.number, i.meshHash + 1});  // another hash: everything
  EXPECT_EQ(client->iteration().value().whole.size(), 3u);
  EXPECT_TRUE(client->quiet());
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

// ---- a budget of bytes ----

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
