#include "tests/support/flight.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ridgecast::testing_support {

using std::numbers::pi;

camera::Camera cameraAt(const terrain::Terrain& terrain, double x, double z, double altitude, double yaw, double pitch) {
  camera::Camera c;
  c.pose.x = std::llround(x * 256);
  c.pose.z = std::llround(z * 256);
  c.pose.y = terrain.height({c.pose.x, c.pose.z}) + altitude;
  c.pose.yaw = yaw;
  c.pose.pitch = pitch;
  return c;
}

camera::Camera straight(const terrain::Terrain& terrain, double t) { return cameraAt(terrain, 0, -50 * t, 120, 0, -0.15); }

// Six legs of 100 s; each round of 600 s starts somewhere else.
camera::Camera hour(const terrain::Terrain& terrain, double t) {
  const int round = static_cast<int>(t / 600);
  const double s = t - 600.0 * round, x0 = round * 3000.0, z0 = round * -2000.0;
  if (s < 100) return cameraAt(terrain, x0, z0 - 50 * s, 120, 0, -0.15);  // straight
  if (s < 200) {                                                          // circles of 400 m
    const double a = (s - 100) * 50 / 400;
    return cameraAt(terrain, x0 - 400 + 400 * std::cos(a), z0 - 5000 - 400 * std::sin(a), 80, a, -0.2);
  }
  const double a0 = 100 * 50.0 / 400;
  const double cx = x0 - 400 + 400 * std::cos(a0), cz = z0 - 5000 - 400 * std::sin(a0);
  if (s < 300) return cameraAt(terrain, cx, cz, 80, a0, -0.2);                                                         // hover
  if (s < 400) return cameraAt(terrain, cx, cz + 50 * (s - 300), 100, a0 + pi * std::min(1.0, (s - 300) / 2), -0.15);  // turn back
  if (s < 500) return cameraAt(terrain, cx + 150000, cz + 50 * (s - 400), 150, 0.3, -0.2);                             // teleport
  const double d = (s - 500) / 100;                                                                                    // dive
  return cameraAt(terrain, cx - 90000, cz - 20 * (s - 500), 10000 * (1 - d) * (1 - d) + 2, 0.5 * d, -1.2 + 1.1 * d);
}

}  // namespace ridgecast::testing_support
