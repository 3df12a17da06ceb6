#pragma once
// The records of a recording, part by part, from its files.
//
// A recording's parts lie side by side as NAME.0001.recording, NAME.0002.recording, ...; NAME is the session and when it began. The edits
// made before the last part began lie beside them, once, as NAME.0000.recording: the world, then all of them. With it each part can be
// read by itself: it begins with the world, the number of the last edit before it and the members that were there. Parts of older versions
// have the edits themselves.

#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/recording/format.h"
#include "server/recording/records.h"

namespace ridgecast::recording {

inline constexpr std::string_view kExtension = ".recording";

inline constexpr unsigned kEditsPart = 0;

// NAME.NNNN.recording of a session's name and a time, or of any name.
std::string partName(const std::string& name, unsigned part);
// NAME and NNNN of a file. Nothing: it is not named like a part.
std::optional<std::pair<std::string, unsigned>> nameOf(const std::filesystem::path& file);

// The recordings at a path: of a part, it and those after it; of a folder, each recording in it with all its parts, by name. Error: one
// sentence: no such file, or no recording there.
Outcome<std::vector<Parts>> recordingsAt(const std::filesystem::path& path);

// The content of a part, frame by frame. Memory: kMaxBlockBytes and what zstd needs for that.
class Blocks {
 public:
  explicit Blocks(std::istream& in);
  ~Blocks();
  // The next whole block. Nothing: the end, or nothing whole follows.
  std::optional<std::span<const std::uint8_t>> next();
  // Why no more can be read, in one sentence; empty: the file ends with a whole block.
  const std::string& problem() const { return problem_; }
  bool wasCutOff() const { return wasCutOff_; }  // the problem is only that the last block was not written in whole

 private:
  struct State;
  std::istream& in_;
  std::unique_ptr<State> state_;
  std::string problem_;
  bool wasCutOff_ = false;
};

// Of one recording.
class Reader final : public Records {
 public:
  // Error: one sentence: the first part cannot be read, or is no recording.
  static Outcome<std::unique_ptr<Reader>> open(Parts parts);
  ~Reader() override;

  const World& world() const override { return world_; }
  // Without what a later part repeats of the earlier ones.
  std::optional<Record> next() override;
  const std::string& damage() const override { return damage_; }
  bool wasCutOff() const override { return wasCutOff_; }
  double seconds() const override { return static_cast<double>(time_) / 1e6; }

 private:
  struct Part;
  explicit Reader(Parts parts);
  bool openNext();
  Outcome<Record> nextKept();  // of the file of edits

  Parts parts_;
  std::size_t opened_ = 0;
  std::unique_ptr<Part> part_;
  std::unique_ptr<Part> kept_;  // while its edits up to `keptUntil_` are read
  EditsBefore keptUntil_;
  World world_;
  std::uint64_t lastEdit_ = 0;
  std::optional<Record> clock_;  // the last Clocked
  std::int64_t time_ = 0;
  std::string damage_;
  bool wasCutOff_ = false;
};

}  // namespace ridgecast::recording
