// What a budget of bytes puts off, and what a client that resumes is sent.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/codec/codec.h"
#include "tests/support/waiting.h"
#include "tests/unit/server/member/session_fixture.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using wire::ErrorCode;

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

// ---- resuming ----

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
       {Case{"most of it is held", kB, wire::Pacing::kFree, 0, conversation::kMaxUnsent + 1},
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

}  // namespace
}  // namespace ridgecast::session
