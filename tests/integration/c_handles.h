#pragma once
// What tests of the C interface share: owners of its handles, and calls that must succeed.

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "client/c/ridgecast.h"

namespace ridgecast {

struct CloseTerrain {
  void operator()(rc_terrain* t) const { rc_terrain_close(t); }
};
struct CloseWorld {
  void operator()(rc_world* w) const { rc_world_close(w); }
};
struct CloseMesh {
  void operator()(const rc_mesh* m) const { rc_mesh_close(m); }
};
using Terrain = std::unique_ptr<rc_terrain, CloseTerrain>;
using World = std::unique_ptr<rc_world, CloseWorld>;
using Mesh = std::unique_ptr<const rc_mesh, CloseMesh>;

inline constexpr double kWait = 60;  // seconds

inline Terrain open(const std::string& name, const rc_terrain_options* options = nullptr) {
  rc_terrain* out = nullptr;
  EXPECT_EQ(rc_terrain_open(name.c_str(), options, &out), RC_OK) << rc_message();
  return Terrain(out);
}

inline World join(const std::string& url, rc_join_options options = {}) {
  options.size = sizeof options;
  options.timeout = kWait;
  rc_world* out = nullptr;
  EXPECT_EQ(rc_join(url.c_str(), &options, &out), RC_OK) << rc_message();
  return World(out);
}

inline std::vector<float> heightsOf(rc_terrain* terrain, const std::vector<double>& places) {
  std::vector<float> out(places.size() / 2);
  EXPECT_EQ(rc_terrain_heights(terrain, places.data(), out.size(), out.data()), RC_OK) << rc_message();
  return out;
}

// Near the origin and out to the lattice's end.
inline std::vector<double> randomPlaces(std::size_t count) {
  std::mt19937_64 random(17);
  std::vector<double> places(2 * count);
  for (double& at : places) {
    const double reach = std::pow(10.0, std::uniform_real_distribution(1.0, 12.6)(random));
    at = std::uniform_real_distribution(-reach, reach)(random);
  }
  return places;
}

}  // namespace ridgecast
