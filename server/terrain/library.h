#pragma once
// A terrain file as machine code: compiled by g++ in a child process, kept in a cache by content, loaded into this process.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "common/terrain/variants.h"
#include "server/terrain/translate.h"

namespace ridgecast::user_terrain {

class Library {
 public:
  // Error: not a library that this program has made.
  static Outcome<std::shared_ptr<const Library>> open(const std::filesystem::path& file);
  ~Library();
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;
  terrain::HeightsFunction heights() const { return heights_; }
  terrain::ColoursFunction colours() const { return colours_; }  // null unless translated with them

 private:
  explicit Library(void* handle) : handle_(handle) {}
  void* handle_;
  terrain::HeightsFunction heights_ = nullptr;
  terrain::ColoursFunction colours_ = nullptr;
};

// Compiled terrains by content. Only a folder that belongs to this user and that nobody else can write is trusted.
class Cache {
 public:
  // In `folder`, or, when that is empty, in ridgecast/terrains below $XDG_CACHE_HOME or ~/.cache; made when missing. Error: it cannot
  // be made or is not private.
  static Outcome<Cache> open(std::filesystem::path folder);
  // Where the compilation of this text for this instruction set is, or belongs. Depends on everything that goes into it.
  std::filesystem::path fileFor(std::string_view text, std::string_view variant, bool colours = false) const;
  bool has(const std::filesystem::path& file) const;  // a file of this user's; it counts as used now
  // Removes those that were not used for longest, beyond kMostKept: who may make sessions could fill the disk with parameters otherwise.
  // What is loaded stays loaded.
  void trim() const;
  static constexpr std::size_t kMostKept = 256;

 private:
  explicit Cache(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
};

// Compiles for an instruction set ("baseline", "avx2", "avx512"), into `target`: whole or not at all. `file` is for messages.
// Error: no compiler (says what to install), or what it does not accept, with the file's line.
Outcome<void> compile(std::string_view file, const Translation& translation, std::string_view variant, const std::filesystem::path& target);

}  // namespace ridgecast::user_terrain
