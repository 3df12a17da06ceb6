#include "server/session/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <thread>

#include "common/codec/codec.h"
#include "scripted.h"
#include "tests/support/waiting.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using wire::ErrorCode;

constexpr lattice::LeafAddress kA{1, 0, 0}, kB{1, 1, 0}, kC{2, -3, 4};

wire::PoseMessage pose(std::uint64_t sequence, double y = 100) {
  wire::PoseMessage p;
  p.sequence = sequence;
  p.camera.pose.y = y;
  return p;
}
wire::Hello hello(wire::Pacing pacing = wire::Pacing::kFree) {
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
  client->queued = 0;
  camera->receive(pose(2));
  EXPECT_EQ(client->iteration().value().poseSequence, 2u);
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

TEST_F(SessionTest, ClosingFreesTheMeshAndThePlace) {
  script->next = [](int n, const camera::Camera&) {
    std::this_thread::sleep_for(5ms);
    return Script::State{{{kA, n}}, false};
  };
  start();
  camera->receive(hello());
  camera->receive(pose(1));
  ASSERT_TRUE(client->iteration());
  EXPECT_EQ(directory->cameras(), 1u);
  camera->close();
  camera->close();
  camera.reset();
  EXPECT_TRUE(testing_support::await([&] { return script->alive == 0 && directory->cameras() == 0; }));
  EXPECT_EQ(script->alive, 0);
  EXPECT_EQ(directory->cameras(), 0u);
  const std::size_t sent = client->sent();
  std::this_thread::sleep_for(20ms);
  EXPECT_EQ(client->sent(), sent);
}

TEST_F(SessionTest, AFailureInsideIsTold) {
  script->next = [](int n, const camera::Camera&) -> Script::State {
    if (n > 1) throw std::runtime_error("out of luck");
    return {{{kA, 1}}, false};
  };
  start();
  camera->receive(hello());
  camera->receive(pose(1));
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kInternal);
  EXPECT_THAT(error->message, HasSubstr("out of luck"));
}

TEST_F(SessionTest, MemoryThatRunsOutEndsOneCameraAlone) {
  script->next = [](int n, const camera::Camera& c) -> Script::State {
    if (n > 1 && c.pose.y > 0) throw std::bad_alloc();
    return {{{kA, n}}, c.pose.y <= 0};
  };
  start();
  const auto other = std::make_shared<Client>();
  auto low = pose(1);
  low.camera.pose.y = -1;
  const auto lowCamera =
      std::make_shared<CameraSession>(directory->find(kDefaultName), std::move(*directory->find(kDefaultName)->enter()), 99, other);
  lowCamera->receive(hello());
  ASSERT_TRUE(other->world());
  lowCamera->receive(low);
  ASSERT_TRUE(other->iteration());
  auto high = pose(1);
  high.camera.pose.y = 100;
  camera->receive(hello());
  camera->receive(high);
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kLimit);
  EXPECT_EQ(error->message, "The server ran out of memory at this camera's work; connect again with a smaller triangle budget.");
  EXPECT_TRUE(testing_support::await([&] { return script->alive == 1; })) << "its mesh is freed";
  low.sequence = 2;
  lowCamera->receive(low);
  EXPECT_TRUE(other->iteration());
  lowCamera->close();
}

TEST_F(SessionTest, CamerasAreGrantedWhatIsLeftOfAllTriangles) {
  Limits limits;
  limits.maxCameras = 4;
  limits.maxTotalTriangles = 1'000'000;
  start(limits);
  std::vector<std::shared_ptr<CameraSession>> others;
  const auto granted = [&](const std::shared_ptr<CameraSession>& one, const std::shared_ptr<Client>& itsClient, std::uint32_t budget) {
    wire::Hello h = hello();
    h.settings.triangleBudget = budget;
    one->receive(h);
    const auto world = itsClient->world();
    return world ? world->settings.triangleBudget : 0u;
  };
  const auto another = [&](std::uint32_t budget) {
    auto session = directory->find(kDefaultName);
    const auto itsClient = std::make_shared<Client>();
    others.push_back(std::make_shared<CameraSession>(session, session->enter().value(), directory->nextCameraId(), itsClient));
    return granted(others.back(), itsClient, budget);
  };
  EXPECT_EQ(granted(camera, client, 600'000), 600'000u);
  EXPECT_EQ(another(600'000), 380'000u) << "10,000 are kept for each camera that may come";
  EXPECT_EQ(another(600'000), 10'000u);
  EXPECT_EQ(another(0), 10'000u);
  EXPECT_FALSE(directory->find(kDefaultName)->enter());
  for (int k = 0; k < 3; ++k) camera->receive(wire::ChangeSettings{{.triangleBudget = k % 2 ? 10'000u : 900'000u}});  // in flight
  others[1]->close();
  others.erase(others.begin() + 1);
  EXPECT_TRUE(testing_support::await([&] { return directory->cameras() == 3; }));
  EXPECT_EQ(another(600'000), 10'000u) << "what a camera was granted stays its own";
  for (const auto& one : others) one->close();
}

TEST_F(SessionTest, WhereNoTrianglesAreLeftTheNextCameraIsRefused) {
  Limits limits;
  limits.maxTotalTriangles = 35'000;
  start(limits);
  const auto session = directory->find(kDefaultName);
  {
    const auto second = session->enter();
    EXPECT_EQ(second->onServer->grant(500'000), 10'000u) << "half of all is kept for others";
    const auto third = session->enter();
    ASSERT_TRUE(third);
    const auto fourth = session->enter();
    ASSERT_FALSE(fourth);
    EXPECT_EQ(fourth.error().message, "This server is full: its cameras have all 35000 triangles that it has memory for; try again later.");
  }
  EXPECT_TRUE(session->enter());
}

TEST_F(SessionTest, PlacesAreBoundedAndGivenBack) {
  Limits limits;
  limits.maxCameras = 3;
  limits.maxMembers = 2;
  start(limits);  // takes one
  auto other = directory->add("other", flatTerrain()).value();
  auto session = directory->find("default");
  {
    auto second = session->enter();
    ASSERT_TRUE(second);
    auto third = session->enter();
    ASSERT_FALSE(third);
    EXPECT_THAT(third.error().message, HasSubstr("'default' is full"));
    EXPECT_EQ(session->members(), 2u);
    auto elsewhere = other->enter();
    ASSERT_TRUE(elsewhere);
    auto fourth = other->enter();
    ASSERT_FALSE(fourth);
    EXPECT_THAT(fourth.error().message, HasSubstr("server is full"));
  }
  EXPECT_TRUE(session->enter());
  EXPECT_EQ(directory->cameras(), 1u);
}

// ---- a budget of bytes ----

TEST_F(SessionTest, ABudgetOfBytesSpacesIterations) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}, {kB, n}, {kC, n}}, false}; };  // never at rest
  Limits limits;
  limits.maxBytesPerSecond = 4096;
  start(limits);
  wire::Hello h = hello();
  h.settings.bytesPerSecond = 1'000'000;
  camera->receive(h);
  EXPECT_EQ(client->world().value().settings.bytesPerSecond, 4096u);
  camera->receive(pose(1));
  const auto began = std::chrono::steady_clock::now();
  int count = 0;
  while (std::chrono::steady_clock::now() - began < 700ms || count < 4) {
    const auto i = client->iteration();
    ASSERT_TRUE(i);
    acknowledge(*i);
    ++count;
  }
  // About 300 bytes each are paid for; without a budget there would be thousands.
  EXPECT_LE(count, 5 + 30 * std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count());
  EXPECT_GE(script->insertionLimit, 32u);
  EXPECT_LT(script->insertionLimit, 300u);
}

TEST_F(SessionTest, ABudgetDoesNotLoseTheNewestPose) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}}, true}; };
  Limits limits;
  limits.maxBytesPerSecond = 4096;
  start(limits);
  camera->receive(hello());
  ASSERT_TRUE(client->world());
  for (std::uint64_t k = 1; k <= 400; ++k) {
    camera->receive(pose(k, double(k)));
    std::this_thread::sleep_for(500us);
  }
  std::optional<wire::Iteration> i;
  do {
    i = client->iteration();
    ASSERT_TRUE(i);
    acknowledge(*i);
  } while (i->poseSequence != 400);
}

// ---- resuming and deltas ----

TEST_F(SessionTest, OnlyWhatDiffersIsSentToAClientThatResumes) {
  script->next = [](int, const camera::Camera&) { return Script::State{{{kA, 1}, {kB, 2}, {kC, 0}}, true}; };
  start();
  for (const auto& leaf : {contentOf(kA, 1), contentOf(kB, 9), contentOf({0, 5, 5}, 7)}) client->hold(leaf);
  camera->receive(hello());
  camera->receive(client->held());
  camera->receive(pose(1));
  std::optional<wire::Iteration> i = client->iteration();
  ASSERT_TRUE(i);
  ASSERT_EQ(i->whole.size(), 2u);
  EXPECT_EQ(i->whole[0].address, kB);
  EXPECT_EQ(i->whole[1].address, kC);
  EXPECT_TRUE(i->changed.empty()) << "a delta over what the server never saw";
  EXPECT_EQ(i->gone, (std::vector<lattice::LeafAddress>{{0, 5, 5}}));
}

// The mesh begins anew on the server, coarse: what is held is not taken away to be sent again, detail by detail.
TEST_F(SessionTest, AClientThatResumesKeepsItsDetailUntilTheMeshIsAsGood) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, std::min(n, 5)}, {kB, 2}, {kC, 1}}, n >= 6}; };
  for (const int content : {5, 9}) {  // as it will be, and as it came to be on another way
    client = std::make_shared<Client>();
    script->iterations = 0;
    start();
    client->hold(contentOf(kA, content));
    client->hold(contentOf(kB, 2));
    camera->receive(hello());
    camera->receive(client->held());
    camera->receive(pose(1));
    const auto first = client->iteration();
    ASSERT_TRUE(first);
    EXPECT_EQ(first->number, 1u);
    EXPECT_EQ(first->poseSequence, 1u);
    EXPECT_TRUE(first->settled);
    EXPECT_EQ(first->whole.size(), content == 5 ? 1u : 2u);
    EXPECT_TRUE(first->gone.empty());
    EXPECT_EQ(script->iterations, 6);
    EXPECT_TRUE(client->quiet());
    EXPECT_EQ(client->complaint(), "");
  }
}

TEST_F(SessionTest, AClientThatResumesDoesNotWaitForLong) {
  struct Case {
    const char* what;
    lattice::LeafAddress held;  // beside kA
    wire::Pacing pacing;
    std::uint64_t budget;
    int sentAt;
  };
  // The mesh never rests.
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}, {kB, 2}, {kC, 1}}, false}; };
  for (const Case& c :
       {Case{"most of it is held", kB, wire::Pacing::kFree, 0, conversation::kMostUnsent + 1},
        Case{"little of it is held", {0, 5, 5}, wire::Pacing::kFree, 0, 1}, Case{"lock-step", kB, wire::Pacing::kLockstep, 0, 1},
        Case{"a budget, for which an iteration cannot be large", kB, wire::Pacing::kFree, 1'000'000, 1}}) {
    client = std::make_shared<Client>();
    script->iterations = 0;
    start();
    client->hold(contentOf(kA, 1000));
    client->hold(contentOf(c.held, 2));
    wire::Hello h = hello(c.pacing);
    h.settings.bytesPerSecond = c.budget;
    camera->receive(h);
    camera->receive(client->held());
    camera->receive(pose(1));
    const auto first = client->iteration();
    ASSERT_TRUE(first) << c.what;
    const auto a = std::find_if(first->whole.begin(), first->whole.end(), [](const auto& leaf) { return leaf.address == kA; });
    ASSERT_NE(a, first->whole.end()) << c.what;
    EXPECT_EQ(codec::decodeLeaf(a->payload, kA, a->vertices, a->triangles).value(), contentOf(kA, c.sentAt)) << c.what;
    EXPECT_EQ(client->complaint(), "") << c.what;
    stop();
  }
}

TEST_F(SessionTest, ResumingOutOfPlaceOrTwiceIsRefused) {
  const wire::Resume held{{{kA, 1}}};
  EXPECT_EQ(refusal({held}).code, ErrorCode::kMalformed);
  EXPECT_EQ(refusal({hello(), pose(1), held}).code, ErrorCode::kMalformed);
  EXPECT_EQ(refusal({hello(), held, held}).code, ErrorCode::kInvalid);
}

TEST_F(SessionTest, ClientsWithoutDeltasGetWholeLeaves) {
  script->next = [](int n, const camera::Camera&) { return Script::State{{{kA, n}, {kB, 1}}, false}; };
  for (const bool deltas : {false, true}) {
    client = std::make_shared<Client>();
    start();
    wire::Hello h = hello();
    h.deltas = deltas;
    camera->receive(h);
    camera->receive(pose(1));
    for (int k = 0; k < 5; ++k) {
      const auto i = client->iteration();
      ASSERT_TRUE(i);
      EXPECT_TRUE(deltas || i->changed.empty());
      acknowledge(*i);
    }
  }
}

TEST_F(SessionTest, DirectoryKnowsSessionsByName) {
  start();
  EXPECT_TRUE(directory->find("default"));
  EXPECT_FALSE(directory->find("nowhere"));
  EXPECT_FALSE(directory->find(""));
  EXPECT_TRUE(directory->add("alps-2", flatTerrain()));
  EXPECT_FALSE(directory->add("alps-2", flatTerrain()));
  EXPECT_FALSE(directory->add("no spaces", flatTerrain()));
  EXPECT_FALSE(directory->add("default", flatTerrain()));
}

TEST_F(SessionTest, ASuccessorTakesNameSpecAndMakersShare) {
  Limits limits;
  limits.maxSessionsPerClient = 1;
  start(limits);
  const auto old = directory->add("alps", flatTerrain(5), {{"tallest", 3}}, "client").value();
  const auto member = old->enter();
  EXPECT_TRUE(directory->replace(old, flatTerrain(6)));
  const auto now = directory->find("alps");
  EXPECT_NE(now, old);
  EXPECT_EQ(now->spec(), old->spec());
  EXPECT_NE(now->contentHash(), old->contentHash());
  EXPECT_TRUE(old->isRetired());
  EXPECT_FALSE(now->isRetired());
  EXPECT_TRUE(directory->full("client"));
  EXPECT_EQ(directory->cameras(), 2u);                    // with the fixture's
  EXPECT_FALSE(directory->replace(old, flatTerrain(7)));  // is not there any more
  EXPECT_EQ(directory->find("alps"), now);
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
  EXPECT_EQ(granted.bytesPerSecond, kLeastBytesPerSecond);
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
