#include "client/viewer/people.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "client/viewer/project.h"

namespace ridgecast::viewer {
namespace {

constexpr double kBeside = 60, kAbove = 15;  // metres
constexpr std::size_t kMaxName = 32;         // bytes
// After Masataka Okabe and Kei Ito, 2008, light enough for a dark label.
constexpr std::array<std::uint32_t, 8> kMembers = {0xe69f00, 0x56b4e9, 0x2fc29a, 0xf0e442, 0x7fb2ff, 0xff8a4c, 0xe59ac4, 0xffffff};

}  // namespace

std::string ownName(const std::string& name) {
  std::string out;
  for (const char c : name)
    if (static_cast<unsigned char>(c) >= 0x20 && c != 0x7f) out += c;
  if (out.size() > kMaxName) {
    std::size_t end = kMaxName;
    while (end > 0 && (static_cast<unsigned char>(out[end]) & 0xc0) == 0x80) --end;  // whole characters
    out.resize(end);
  }
  return out.empty() ? "ridgecast-client view" : out;
}

std::string distanceText(double metres) {
  char text[40];
  std::snprintf(text, sizeof text, metres < 1000 ? "%.0f m" : "%.1f km", metres < 1000 ? metres : metres / 1000);
  return text;
}

Colour memberColour(std::uint64_t camera) {
  const std::uint32_t rgb = kMembers[camera % kMembers.size()];
  const auto share = [rgb](int shift) { return static_cast<float>((rgb >> shift) & 0xff) / 255; };
  return {share(16), share(8), share(0)};
}

camera::Pose beside(const camera::Pose& from, const camera::Pose& other) {
  const camera::Vec3 away = between(other, from);
  const double level = std::hypot(away.x, away.z);
  const double x = level > 1e-3 ? away.x / level : 0, z = level > 1e-3 ? away.z / level : 1;
  camera::Pose pose = from;
  const auto steps = [](double metres) { return static_cast<lattice::Step>(std::llround(metres * lattice::kStepsPerMetre)); };
  pose.x = std::clamp(other.x + steps(x * kBeside), -lattice::kMaxPosition, lattice::kMaxPosition);
  pose.z = std::clamp(other.z + steps(z * kBeside), -lattice::kMaxPosition, lattice::kMaxPosition);
  pose.remainderX = pose.remainderZ = 0;
  pose.y = other.y + kAbove;
  pose.yaw = std::atan2(x, z);
  pose.pitch = -std::atan2(kAbove, kBeside);
  return pose;
}

}  // namespace ridgecast::viewer
