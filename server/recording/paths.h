#pragma once
// The flights in a recording as camera paths (common/camera/path.h), which `ridgecast-client fly --path` follows.
//
// A keyframe for each pose that an iteration took, at the time of the recording since the first of its file; poses within a millisecond
// are one, the last. Heights are absolute. A flight of more than kMaxKeyframes or 24 h continues in another file.

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/recording/records.h"
#include "server/recording/replay.h"

namespace ridgecast::recording {

inline constexpr std::size_t kMaxKeyframes = 8000;  // of a path's 10,000, so that its text stays below 1 MiB

struct Exported {
  std::size_t files = 0;
  std::string damage{};  // Records::damage(): they end there
  bool wasCutOff = false;
};

// Writes NAME.camera-3.json, NAME.camera-3.2.json, ... into a folder; NAME is the first recording's. Error: one sentence. Bound:
// kMaxKeyframes of each camera at a time.
Outcome<Exported> exportPaths(const std::vector<Parts>& recordings, const std::filesystem::path& folder, const Span& span);

}  // namespace ridgecast::recording
