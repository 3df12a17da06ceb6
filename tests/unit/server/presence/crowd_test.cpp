// Who is near is judged by a sort of all members.
#include "server/presence/crowd.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "common/wire/wire.h"
#include "tests/unit/server/presence/listener.h"

namespace ridgecast::presence {
namespace {

TEST(Crowd, TheNearestAreThoseOfASortOfAll) {
  std::mt19937_64 random(7);
  for (int world = 0; world < 5; ++world) {
    Crowd crowd;
    std::map<std::uint64_t, wire::Member> all;
    for (int round = 0; round < 3000; ++round) {
      const std::uint64_t camera = 1 + random() % 200;
      const auto known = all.find(camera);
      if (known == all.end()) {
        wire::Member member;
        member.camera = camera;
        if (random() % 4 != 0) member.moved = wire::Moved{camera, poseAt(coordinate(world, random), coordinate(world, random)), 0};
        all[camera] = member;
        crowd.add(member);
      } else if (random() % 5 == 0) {
        all.erase(known);
        crowd.remove(camera);
      } else {
        known->second.moved = wire::Moved{camera, poseAt(coordinate(world, random), coordinate(world, random), random() % 3), 0};
        crowd.move(*crowd.find(camera), *known->second.moved);
      }
      if (round % 10 != 0 || all.empty()) continue;
      const auto self = std::next(all.begin(), static_cast<std::ptrdiff_t>(random() % all.size()))->first;
      auto expected = sorted(all, self);
      const std::size_t count = random() % 40;
      expected.resize(std::min(expected.size(), count));
      std::vector<std::uint64_t> found;
      for (const Crowd::Participant* who : crowd.nearest(*crowd.find(self), count)) found.push_back(who->member().camera);
      ASSERT_EQ(found, expected) << "world " << world << ", round " << round << ", from " << self;
      const auto counts = crowd.counts(1 + random() % 40);
      std::map<std::pair<std::int64_t, std::int64_t>, std::uint32_t> cells;
      for (const auto& [c, member] : all)
        if (member.moved) {
          const auto& pose = member.moved->pose.camera.pose;
          const double side = std::ldexp(256 * 256, static_cast<int>(counts.level));
          ++cells[{static_cast<std::int64_t>(std::floor(static_cast<double>(pose.x) / side)),
                   static_cast<std::int64_t>(std::floor(static_cast<double>(pose.z) / side))}];
        }
      ASSERT_EQ(counts.i.size(), cells.size());
      for (std::size_t k = 0; k < counts.i.size(); ++k) {
        const std::pair<std::int64_t, std::int64_t> cell{counts.i[k], counts.j[k]};
        ASSERT_EQ(counts.count[k], cells[cell]);
      }
    }
  }
}

TEST(Crowd, CountsHaveTheLeastCellsThatAreFewEnough) {
  Crowd crowd;
  for (std::uint64_t k = 0; k < 64; ++k) {
    const auto at = static_cast<lattice::Step>(k << wire::kCellBits);
    crowd.add({k + 1, wire::Role::kViewer, "", wire::Moved{k + 1, poseAt(at, 0), 0}});
  }
  EXPECT_EQ(crowd.counts(64).level, 0u);
  EXPECT_EQ(crowd.counts(63).level, 1u);
  EXPECT_EQ(crowd.counts(16).count, std::vector<std::uint32_t>(16, 4));
  for (std::uint64_t k = 0; k < 4; ++k) {
    const lattice::Step x = k % 2 ? lattice::kMaxPosition : -lattice::kMaxPosition,
                        z = k / 2 ? lattice::kMaxPosition : -lattice::kMaxPosition;
    crowd.add({100 + k, wire::Role::kViewer, "", wire::Moved{100 + k, poseAt(x, z), 0}});
  }
  const auto four = crowd.counts(1);
  EXPECT_EQ(four.count.size(), 4u) << "a quadrant each";
  EXPECT_LE(four.level, wire::kMaxCrowdLevel);
}

}  // namespace
}  // namespace ridgecast::presence
