#pragma once
// Records as bytes. A part of a recording is a file of zstd frames (RFC 8878), each with its content's size and checksum, so that
// `zstd -dc` reads it too; the first frame may be read by itself. A frame holds whole records:
//
//   record     varint bytes of what follows, then: kind (a byte, the index in Event), zigzag varint microseconds since the record before
//              in this part (the first: since the recording began), fields
//   varint     LEB128 of 64 bits; strings and lists with a varint of their length before them; doubles as their 8 bytes, little-endian
//   World      begins with the string "ridgecast recording 1"
//   Iterated   differences from what the camera's last record in this part predicts: x and z go on as before, and so do y, yaw and pitch
//              in doubles, of which the bytes that differ are kept
//
// About 40 bytes an iteration at a new pose of a flight, 9 at the same pose.

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/recording/events.h"

namespace ridgecast::recording {

inline constexpr std::size_t kMaxBlockBytes = std::size_t{4} << 20;   // of a frame's content
inline constexpr std::size_t kMaxRecordBytes = std::size_t{2} << 20;  // so that a block has room for one
inline constexpr std::size_t kMaxCameras = 65'536;                    // that live at a time

using Bytes = std::vector<std::uint8_t>;

// What both sides know of a camera: the last two views and what else is told by its difference.
struct Known {
  camera::Camera last{}, before{};
  std::uint64_t pose = 0, edit = 0, hash = 0;
  std::uint32_t insertions = 0;
};

// Of one part, in order. Not thread-safe.
class Encoder {
 public:
  // Appends the record. False, and nothing is appended: an iteration or end of a camera that has not joined, or more than
  // kMaxRecordBytes.
  bool put(const Record& record, Bytes& out);

 private:
  std::int64_t time_ = 0;
  std::map<std::uint64_t, Known> cameras_;
};

// Not thread-safe. For any input, memory is in proportion to its bytes.
class Decoder {
 public:
  // Takes the next record off the front of a block. Error: one sentence; decoding cannot continue.
  Outcome<Record> next(std::span<const std::uint8_t>& block);

 private:
  std::int64_t time_ = 0;
  std::map<std::uint64_t, Known> cameras_;
};

// A frame of these records.
Bytes compress(std::span<const std::uint8_t> block);

}  // namespace ridgecast::recording
