#pragma once
// GDAL's programs, from Debian's package gdal-bin. They run with limits, may open no address on a network and, where the kernel keeps that
// (reach.h), read nothing but themselves and what was allowed. One thread.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/process/scratch.h"

namespace ridgecast::raster {

class Gdal {
 public:
  // `what` needs them: the beginning of a sentence; `stop` ends what runs. Error: there are none, or no folder for temporary files.
  static Outcome<Gdal> find(const std::string& what, std::stop_token stop);

  // A file or a folder that they may read.
  void allow(std::filesystem::path what) { reads_.push_back(std::move(what)); }

  // Of a folder that lives as long as this, or as what was taken.
  std::filesystem::path file(const char* name) const { return scratch_->path() / name; }
  std::optional<process::Scratch> takeScratch() { return std::exchange(scratch_, std::nullopt); }

  // What the program prints. `mostBytes`: of a file that it writes. Error: the first thing that it complained of, or it was stopped.
  Outcome<std::string> run(const char* program, std::vector<std::string> arguments, std::uint64_t mostBytes = 1 << 20) const;

 private:
  std::filesystem::path folder_;
  std::vector<std::filesystem::path> reads_;
  std::stop_token stop_;
  std::optional<process::Scratch> scratch_;
};

}  // namespace ridgecast::raster
