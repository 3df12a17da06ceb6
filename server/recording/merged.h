#pragma once
// The recordings that several servers made of one session, as one: the members of all, each edit once, one clock.
//
// Records are in the order of their times since the first recording began, by the servers' clocks. Edits have the same numbers everywhere:
// each is given when the first of the recordings has it, so that a mesh's ground is always there, and must be the same in the others. The
// clock is that of the first recording that goes on. The members of a recording that ends before others have left.

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/recording/reader.h"
#include "server/recording/records.h"

namespace ridgecast::recording {

// Bound: a record of each recording, and 8 bytes an edit.
class Merged final : public Records {
 public:
  // Error: as openRecords.
  static Outcome<std::unique_ptr<Records>> open(const std::vector<Parts>& recordings);

  const World& world() const override { return world_; }
  std::optional<Record> next() override;
  const std::string& damage() const override { return damage_; }
  bool wasCutOff() const override;
  double seconds() const override { return static_cast<double>(time_) / 1e6; }

 private:
  struct Source {
    std::string name;
    std::unique_ptr<Reader> reader;
    std::int64_t offset = 0;  // of its times
    std::optional<Record> head{};
  };

  Merged() = default;
  Source* earliest();
  void advance(Source& source);
  bool isClock(const Source& source) const;
  // Whether the record is new. Not, and damage_: it contradicts another recording.
  bool admit(const Source& source, const Record& record);
  bool refuse(const std::string& why);

  World world_;
  std::vector<Source> sources_;
  std::map<std::uint64_t, const Source*> cameras_;  // that are there
  std::vector<std::uint64_t> edits_;                // their hashes
  std::deque<Record> left_;                         // of recordings that ended
  std::int64_t time_ = 0;
  std::string damage_;
};

}  // namespace ridgecast::recording
