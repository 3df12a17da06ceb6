#pragma once
// Writes recordings: one for each session that lives, as parts in one folder (reader.h).
//
//   note() --> queue (kMaxWaiting bytes) --> one thread of low priority: codes, compresses, writes a block a second
//
// A block reaches the operating system in one write, so that after kill -9 all but the last second is there. A recording that cannot be
// kept (the disk is full or too slow, its edits alone take half of the room) ends with a sentence in the log; nothing else is affected.
//
// Bound: the folder's recordings take at most `bytes` in all, each part a sixteenth of that. The oldest parts are deleted first, those of
// earlier runs included, a recording's edits after its parts, but never one being written: if nothing else is left, the recording that
// needs room ends.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/recording/events.h"

namespace ridgecast::recording {

class Recorder {
 public:
  static constexpr std::size_t kMaxWaiting = std::size_t{8} << 20;
  static constexpr std::uint64_t kMinBytes = std::uint64_t{1} << 20;

  // Makes the folder if there is none. It is locked while this lives: otherwise others' parts would be taken for old ones. Error: one
  // sentence: it cannot be made or written, or is in use.
  static Outcome<std::unique_ptr<Recorder>> open(const std::filesystem::path& folder, std::uint64_t bytes);
  ~Recorder();  // writes what waits; note() is not called any more
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // A session begins `now`, on the ground that these edits have made, the first one's number being 1. Its recording ends with the observer,
  // which must not be used after the recorder.
  std::shared_ptr<Observer> begin(World world, std::vector<Edited> past, Observer::Instant now);

  struct Usage {
    std::uint64_t bytes = 0;       // written so far
    double seconds = 0;            // of a processor, by the writing thread
    std::size_t waitingBytes = 0;  // in the queue
    std::uint64_t keptBytes = 0;   // of all parts in the folder
    std::uint64_t failed = 0;      // recordings that could not be kept
  };
  Usage usage() const;

 private:
  struct State;
  class Session;
  explicit Recorder(std::shared_ptr<State> state);
  const std::shared_ptr<State> state_;
};

}  // namespace ridgecast::recording
