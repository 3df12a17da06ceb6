#pragma once
// A member that keeps a table by the protocol's rules alone, and what judges that table: a sort of all members.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include "common/wire/wire.h"
#include "server/conversation/sender.h"
#include "server/scheduling/timer.h"
#include "tests/support/bytes.h"

namespace ridgecast::presence {

inline wire::PoseMessage poseAt(lattice::Step x, lattice::Step z, double y = 1, std::uint64_t sequence = 1, std::size_t state = 0) {
  wire::PoseMessage pose{sequence, {}, std::vector<std::uint8_t>(state, 7)};
  pose.camera.pose = {.x = x, .z = z, .y = y};
  return pose;
}

// All but itself: with a place by distance, then without; equal ones by number.
inline std::vector<std::uint64_t> sorted(const std::map<std::uint64_t, wire::Member>& all, std::uint64_t self) {
  std::vector<std::tuple<bool, long double, std::uint64_t>> order;
  const auto& from = all.at(self).moved;
  for (const auto& [camera, member] : all) {
    if (camera == self) continue;
    long double square = 0;
    if (from && member.moved) {
      const auto &a = from->pose.camera.pose, &b = member.moved->pose.camera.pose;
      const long double x = a.x - b.x, z = a.z - b.z, y = (static_cast<long double>(a.y) - b.y) * 256;
      square = x * x + y * y + z * z;
    }
    order.emplace_back(from && !member.moved, square, camera);
  }
  std::ranges::sort(order);
  std::vector<std::uint64_t> out;
  for (const auto& [isUnplaced, square, camera] : order) out.push_back(camera);
  return out;
}

// Places where searches differ: all at one, around a cell's corner, a plain, islands far apart, the ends of the lattice.
inline lattice::Step coordinate(int world, std::mt19937_64& random) {
  const auto upTo = [&](std::int64_t n) { return static_cast<lattice::Step>(random() % static_cast<std::uint64_t>(n)); };
  switch (world) {
    case 0:
      return 12'345;
    case 1:
      return upTo(9) - 4;
    case 2:
      return upTo(20 * 65'536) - 10 * 65'536;
    case 3:
      return (upTo(3) - 1) * (lattice::kMaxPosition / 8 * 7) + upTo(1000);
    default:
      return upTo(2) == 0 ? lattice::kMaxPosition : -lattice::kMaxPosition;
  }
}

class Listener final : public conversation::Sender {
 public:
  explicit Listener(const scheduling::Timer& timer) : timer_(timer) {}
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    EXPECT_FALSE(std::holds_alternative<wire::Members>(message)) << "these are encoded once for many";
  }
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    if (isSlow) tickets_.push_back(std::move(ticket));
    auto decoded = wire::decodeServer(testing_support::bytesOf(*encoded));
    ASSERT_TRUE(decoded) << decoded.error().message;
    const auto& m = std::get<wire::Members>(*decoded);
    bytes += encoded->size();
    ++messages;
    for (const auto& j : m.joined) {
      ASSERT_TRUE(table.emplace(j.camera, j).second) << j.camera << " joined twice";
      told[j.camera].push_back(timer_.now());
    }
    for (const auto& v : m.moved) {
      ASSERT_TRUE(table.contains(v.camera)) << v.camera << " moved without having joined";
      ASSERT_NE(table[v.camera].moved, v) << "nothing is told twice";
      table[v.camera].moved = v;
      told[v.camera].push_back(timer_.now());
    }
    for (const auto& gone : {m.left, m.faded})
      for (const auto camera : gone) {
        ASSERT_EQ(table.erase(camera), 1u) << camera << " left without having joined";
        told.erase(camera);
      }
    left.insert(m.left.begin(), m.left.end());
    if (m.crowd) crowd = *m.crowd;
    others = m.others;
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override { ADD_FAILURE(); }
  void readOn() {
    isSlow = false;
    tickets_.clear();
  }

  bool isSlow = false;
  std::map<std::uint64_t, wire::Member> table;
  std::map<std::uint64_t, std::vector<scheduling::Timer::Time>> told;
  std::set<std::uint64_t> left;
  wire::Crowd crowd;
  std::uint32_t others = 0;
  std::size_t bytes = 0, messages = 0;

 private:
  const scheduling::Timer& timer_;
  std::vector<std::shared_ptr<const void>> tickets_;
};

}  // namespace ridgecast::presence
