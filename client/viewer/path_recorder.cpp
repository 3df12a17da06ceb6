#include "client/viewer/path_recorder.h"

#include <cstdio>
#include <fstream>
#include <numbers>

#include "common/lattice/lattice.h"

namespace ridgecast::viewer {

void PathRecorder::add(double now, const camera::Pose& pose) {
  if (keyframes_.empty()) began_ = now;
  if (keyframes_.size() >= 10'000 || (!keyframes_.empty() && now - last_ < 0.5)) return;
  last_ = now;
  keyframes_.push_back({now - began_, pose.x, pose.z, pose.y, false, pose.yaw, pose.pitch});
}

Outcome<void> PathRecorder::write(const std::filesystem::path& file) const {
  std::string name;
  for (const char c : terrain_)
    if (c != '"' && c != '\\' && static_cast<unsigned char>(c) >= 0x20) name += c;
  std::ofstream out(file, std::ios::trunc);
  out << "{\n  \"terrain\": \"" << name << "\",\n  \"seed\": " << seed_ << ",\n  \"keyframes\": [";
  const char* separator = "\n";
  for (const camera::Keyframe& k : keyframes_) {
    char line[256];
    constexpr double kDegrees = 180 / std::numbers::pi;
    std::snprintf(line, sizeof line, "    {\"t\": %.3f, \"x\": %.8f, \"z\": %.8f, \"y\": %.3f, \"yaw\": %.3f, \"pitch\": %.3f}", k.t,
                  static_cast<double>(k.x) * lattice::kMetresPerStep, static_cast<double>(k.z) * lattice::kMetresPerStep, k.height,
                  k.yaw * kDegrees, k.pitch * kDegrees);
    out << separator << line;
    separator = ",\n";
  }
  out << "\n  ]\n}\n";
  out.close();
  if (!out) return Error{"cannot write " + file.string()};
  return {};
}

}  // namespace ridgecast::viewer
