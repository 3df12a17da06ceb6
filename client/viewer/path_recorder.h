#pragma once
// Records a flight as a camera path that `ridgecast-client fly` follows (common/camera/path.h): a keyframe every half second.

#include <filesystem>
#include <string>
#include <vector>

#include "common/camera/path.h"
#include "common/outcome/outcome.h"

namespace ridgecast::viewer {

class PathRecorder {
 public:
  PathRecorder(std::string terrain, std::uint32_t seed) : terrain_(std::move(terrain)), seed_(seed) {}
  // `now` in seconds ascends. Keeps at most 10,000 keyframes, the limit of a path file; drops later ones.
  void add(double now, const camera::Pose& pose);
  std::size_t keyframes() const { return keyframes_.size(); }
  // Error: the file cannot be written.
  Outcome<void> write(const std::filesystem::path& file) const;

 private:
  std::string terrain_;
  std::uint32_t seed_;
  double began_ = 0, last_ = 0;
  std::vector<camera::Keyframe> keyframes_;
};

}  // namespace ridgecast::viewer
