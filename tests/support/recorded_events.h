#pragma once
// Records for tests, of every kind, in an order that can be: cameras join before they iterate.

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "server/recording/events.h"

namespace ridgecast::testing_support {

inline recording::World recordedWorld() {
  return {
      "race", "canyon", 7, {{"riverLevel", 300.5}, {"a", -1e-9}}, 0xfedcba9876543210, true, "ridgecast-server test", 1'700'000'000'000'000};
}

// Cameras fly in curves of whole and broken numbers, or jump.
inline std::vector<recording::Record> recordedEvents(std::uint64_t seed, std::size_t count) {
  using namespace recording;
  std::mt19937_64 random(seed);
  const auto below = [&](std::uint64_t n) { return random() % n; };
  const auto share = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  std::vector<Record> out{{0, recordedWorld()}};
  std::vector<Iterated> cameras;
  std::uint64_t joined = 0, edits = 0;
  for (std::int64_t time = 0; out.size() < count; time += static_cast<std::int64_t>(below(200'000))) {
    const std::uint64_t kind = below(20);
    if (cameras.empty() || kind == 0) {
      Joined j{++joined,
               "camera " + std::to_string(joined),
               below(2) ? wire::Role::kSensor : wire::Role::kViewer,
               below(2) ? wire::Pacing::kLockstep : wire::Pacing::kFree,
               {wire::Metric::kArea, share(), 10'000, 0, 3, 0.5},
               edits};
      out.push_back({time, j});
      Iterated begins{j.camera};
      begins.edit = edits;
      cameras.push_back(begins);
    } else if (kind == 1 && cameras.size() > 2) {
      out.push_back({time, Left{cameras.back().camera}});
      cameras.pop_back();
    } else if (kind == 2) {
      out.push_back({time, Edited{++edits, "ann", std::string(below(30), 'x')}});
    } else if (kind == 3) {
      out.push_back({time, Clocked{static_cast<wire::ClockMode>(below(3)), share(), below(1u << 30), joined, edits}});
    } else if (kind == 4) {
      out.push_back({time, Asked{1, static_cast<std::uint32_t>(below(9999)), std::string(below(100), '\0')}});
    } else {
      Iterated& i = cameras[below(cameras.size())];
      camera::Pose& pose = i.view.pose;
      const camera::Pose before = pose;
      const std::uint64_t sequence = i.pose;
      if (below(8) == 0) {
        pose.x = static_cast<lattice::Step>(random()) >> 14;
        pose.y = share() * 1e4;
      } else if (below(4) > 0) {
        pose.x += 1280;
        pose.z -= static_cast<lattice::Step>(below(3));
        pose.yaw += 0.01 + share() * 1e-3;
        pose.pitch = std::sin(pose.yaw);
      }
      if (below(30) == 0) i.view.projection.width = 1 + static_cast<std::uint32_t>(below(4000));
      i.pose += below(3);
      i.insertions = static_cast<std::uint32_t>(below(2) ? i.insertions : random());
      i.granted = below(10) ? std::nullopt : std::optional(settings::Settings{wire::Metric::kThesis, share(), 99'999, 1u << 20, 0, 0});
      i.changed.clear();
      if (i.edit != edits) i.changed.push_back({-5, static_cast<lattice::Step>(below(1u << 30)), 7, 1 << 30});
      i.edit = edits;
      i.settled = below(2);
      if (below(8) > 0) i.hash = random();
      if (pose == before && i.pose == sequence) i.hash &= 0xffffffffu;
      out.push_back({time, i});
    }
  }
  return out;
}

}  // namespace ridgecast::testing_support
