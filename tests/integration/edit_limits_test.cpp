// More edits than there may be, over loopback.
#include <gtest/gtest.h>

#include <future>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/integration/edits_fixture.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast {
namespace {

// Craters of this radius, all asked for before the first answer is looked at. How many were made, and refused for now.
std::pair<int, int> askAtOnce(Member& member, int count, double radius) {
  std::vector<std::future<Outcome<wire::EditAnswer>>> answers;
  for (int k = 0; k < count; ++k) answers.push_back(member.connection().edit({0, "", craterAt(k, 0, radius)}));
  int made = 0, refused = 0;
  for (auto& answer : answers) {
    const auto result = answer.get();
    result ? ++made : ++refused;
    if (!result) {
      EXPECT_NE(result.error().message.find("again in"), std::string::npos) << result.error().message;
    }
  }
  return {made, refused};
}

TEST_F(EditsTest, HostileOnesAreRefusedAndDisturbNobody) {
  Member bad(port(), "bad"), good(port(), "good");
  const double y = base->height({0, 0}) + 60;
  good.stand(0, 0, y);
  good.settle(0);
  for (const char* text : {"", "{}", R"({"op":"crater","x":1e300,"z":0,"radius":5,"depth":1})",
                           R"({"op":"crater","x":0,"z":0,"radius":1e6,"depth":1})", R"({"op":"crater","x":NaN,"z":0,"radius":5,"depth":1})",
                           R"({"op":"undo","edit":77})", R"({"op":"level","polygon":[[0,0],[2000,0],[2000,2000],[0,2000]],"height":0})"}) {
    const auto answer = bad.edit(text);
    ASSERT_FALSE(answer) << text;
    EXPECT_GT(answer.error().message.size(), 20u);
  }
  // As many as a socket carries: none is lost, and the other member flies on.
  const auto [made, refused] = askAtOnce(bad, 250, 12);
  EXPECT_GT(made, 0);
  good.stand(5, 5, y);
  good.settle(static_cast<std::uint64_t>(made));
  EXPECT_FALSE(bad.connection().error());
}

// The server's time stands still.
class EditsInAnInstantTest : public EditsTest {
  void SetUp() override { serve(std::make_unique<testing_support::SimulatedTimer>()); }
};

TEST_F(EditsInAnInstantTest, ManyAtOnceAreMadeOrRefused) {
  Member bad(port(), "bad");
  const auto [made, refused] = askAtOnce(bad, 250, 60);
  EXPECT_GT(made, 0);
  EXPECT_GT(refused, 0);
  EXPECT_EQ(directory->find(directory::kDefaultName)->ground().edit, static_cast<std::uint64_t>(made));
}

TEST_F(EditsInAnInstantTest, OneAfterTheOtherByHttpAreAsManyAsAtOnce) {
  const std::string edit = craterAt(3, 4, 60);
  const auto posts = static_cast<std::uint64_t>(edits::areaOf(edits::fromJson(edit).value()).count());
  // A quarter of a second that was saved up, and one that is owed.
  const std::uint64_t most = session::kEditedPostsPerSecond / 2 / posts + 1;
  ASSERT_GT(posts, session::kMinEditedPosts);
  for (std::uint64_t k = 0; k < most; ++k) has(ask("POST", "edits", edit), " 201 ");
  for (int k = 0; k < 3; ++k) has(ask("POST", "edits", edit), " 429 ");
  EXPECT_EQ(directory->find(directory::kDefaultName)->ground().edit, most);
}

}  // namespace
}  // namespace ridgecast
