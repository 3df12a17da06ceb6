// What a client that resumes is sent.
#include <gtest/gtest.h>

#include "common/codec/codec.h"
#include "tests/unit/server/member/session_fixture.h"

namespace ridgecast::session {
namespace {

using wire::ErrorCode;

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
  const wire::Resume held{{{kA, 1}}, {}, 0};
  EXPECT_EQ(refusal({held}).code, ErrorCode::kMalformed);
  EXPECT_EQ(refusal({hello(), pose(1), held}).code, ErrorCode::kMalformed);
  EXPECT_EQ(refusal({hello(), held, held}).code, ErrorCode::kInvalid);
  const wire::Resume unnamed{{}, "key", 9}, both{{{kA, 1}}, {}, 9};
  wire::Hello follows = hello();
  follows.points = true;
  EXPECT_EQ(refusal({hello(), unnamed}).code, ErrorCode::kInvalid) << "without points";
  EXPECT_EQ(refusal({follows, unnamed, unnamed}).code, ErrorCode::kInvalid);
  EXPECT_EQ(refusal({follows, held, unnamed}).code, ErrorCode::kInvalid);
  EXPECT_EQ(refusal({follows, unnamed, held}).code, ErrorCode::kInvalid);
  EXPECT_EQ(refusal({follows, both}).code, ErrorCode::kInvalid);
}

}  // namespace
}  // namespace ridgecast::session
