// The others: names, colours and distances, and where one stands who flies to them.
#include "client/viewer/people.h"

#include <gtest/gtest.h>

#include <cmath>

#include "client/viewer/project.h"

namespace ridgecast::viewer {
namespace {

std::string named(std::uint64_t camera, const std::string& name) {
  wire::Member member;
  member.camera = camera;
  member.name = name;
  return core::nameOf(member);
}

TEST(People, HaveTheNamesThatTheyGaveOrANumber) {
  EXPECT_EQ(named(7, "Ada"), "Ada");
  EXPECT_EQ(named(7, ""), "Guest 7");
  EXPECT_EQ(named(12, "ridgecast-web"), "Guest 12");
  EXPECT_EQ(named(3, ownName("")), "Guest 3");
  EXPECT_EQ(ownName("A\nd\x7f"
                    "a"),
            "Ada");
  const std::string most(31, 'x');
  EXPECT_EQ(ownName(most + "\xc3\xa9"), most);  // no half of a character
}

TEST(People, AreAsFarAsThePageSays) {
  EXPECT_EQ(distanceText(0.4), "0 m");
  EXPECT_EQ(distanceText(999), "999 m");
  EXPECT_EQ(distanceText(1250), "1.2 km");
}

TEST(People, OneWhoFliesToThemSeesThemInTheMiddle) {
  for (const double far : {0.0, 4e12}) {
    camera::Pose other, from;
    other.x = std::llround(far * 256);
    other.z = -other.x;
    other.y = 1000;
    from = other;
    from.x += 256 * 300;
    from.z -= 256 * 400;
    camera::Camera there;
    there.pose = beside(from, other);
    const camera::Vec3 at = between(there.pose, other);
    EXPECT_NEAR(std::hypot(at.x, at.z), 60, 0.01);
    EXPECT_NEAR(at.y, -15, 1e-9);
    const auto spot = spotOf(there, at);
    ASSERT_TRUE(spot);
    EXPECT_NEAR(spot->x, 0.5, 1e-3);
    EXPECT_NEAR(spot->y, 0.5, 1e-3);
    EXPECT_LT(at.x, 0);  // it came from the right, and stays there
  }
}

}  // namespace
}  // namespace ridgecast::viewer
