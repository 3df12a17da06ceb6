#pragma once
// A private temporary folder that lives as long as the object.

#include <stdlib.h>

#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

namespace ridgecast::process {

class Scratch {
 public:
  // Error: the folder for temporary files is not writable.
  static Outcome<Scratch> create() {
    std::error_code failed;
    std::string name = (std::filesystem::temp_directory_path(failed) / "ridgecast-XXXXXX").string();
    if (failed || !mkdtemp(name.data())) return Error{"no folder for temporary files can be made: set TMPDIR to one that can be written"};
    return Scratch(name);
  }
  ~Scratch() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  Scratch(Scratch&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  Scratch& operator=(Scratch&&) = delete;
  const std::filesystem::path& path() const {
    expects(!path_.empty(), "a temporary folder that was moved away is not used");
    return path_;
  }

 private:
  explicit Scratch(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_;
};

}  // namespace ridgecast::process
