#pragma once
// Map tiles as one file, which map viewers read by ranges from any file server: PMTiles, version 3
// (https://github.com/protomaps/PMTiles/blob/main/spec/v3/spec.md).
//
//   0         header, then the root directory, within 16 KiB
//   16,384    tiles, in the order of their ids; equal ones in a row once
//             leaf directories, unless the root has room for all entries; metadata
//
// One thread. Holds 24 bytes for each run of equal tiles.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "server/map/mercator.h"

namespace ridgecast::map {

// The place of a tile in the order of all: level by level, each along Hilbert's curve.
std::uint64_t tileId(const TileAddress& tile);

class Archive {
 public:
  enum class Type : std::uint8_t { kPng = 2, kJpeg = 3 };
  struct About {
    Type type = Type::kPng;
    int coarsest = 0, finest = 0;  // levels
    Bounds bounds;
    std::string metadata;  // JSON, an object
  };

  explicit Archive(const std::filesystem::path& file);
  // Ids grow from call to call; those between are of tiles that are not there. False: it cannot be written.
  bool add(std::uint64_t id, std::string_view tile);
  bool finish(const About& about);

 private:
  struct Entry {
    std::uint64_t id = 0, offset = 0;
    std::uint32_t length = 0, run = 0;  // run 0: of a leaf directory
  };
  static std::string directory(const Entry* entries, std::size_t count);

  std::ofstream out_;
  std::vector<Entry> entries_;
  std::string last_;  // tile that was written
  std::uint64_t written_ = 0, addressed_ = 0;
};

}  // namespace ridgecast::map
