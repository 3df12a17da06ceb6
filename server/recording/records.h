#pragma once
// A session's records in order, from one recording or from several.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/recording/events.h"

namespace ridgecast::recording {

using Parts = std::vector<std::filesystem::path>;  // of one recording, in order

// Not thread-safe.
class Records {
 public:
  virtual ~Records() = default;
  Records(const Records&) = delete;
  Records& operator=(const Records&) = delete;

  virtual const World& world() const = 0;
  // The next record. Nothing: the end.
  virtual std::optional<Record> next() = 0;
  // Why the records end before their files do, in one sentence with the time; empty: they do not. An incomplete last block is not damage,
  // nor is a last part that was only begun: wasCutOff().
  virtual const std::string& damage() const = 0;
  virtual bool wasCutOff() const = 0;
  virtual double seconds() const = 0;  // of the last record

 protected:
  Records() = default;
};

// The recordings of one session: one, or those of several servers that had it at the same time (merged.h). Error: one sentence: a first
// part cannot be read or is no recording, or they are of different worlds.
Outcome<std::unique_ptr<Records>> openRecords(const std::vector<Parts>& recordings);

}  // namespace ridgecast::recording
