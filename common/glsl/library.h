#pragma once
// A terrain file as machine code: compiled by g++ in a child process, kept in a cache by content, loaded into this process.

#include <cstddef>
#include <filesystem>
#include <memory>
#include <stop_token>
#include <string_view>

#include "common/glsl/translate.h"
#include "common/outcome/outcome.h"
#include "common/terrain/variants.h"

namespace ridgecast::glsl {

// The line of the user's file where a height first became no number, or infinite, and the function's name, or /. Clears what it returns.
struct Trace {
  const char* name;  // null: no such place
  int line;
};
using TraceFunction = Trace (*)(bool infinite);

class Library {
 public:
  // Error: not a library that this program made.
  static Outcome<std::shared_ptr<const Library>> open(const std::filesystem::path& file);
  ~Library();
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;
  terrain::HeightsFunction heights() const { return heights_; }
  terrain::ColoursFunction colours() const { return colours_; }        // null unless translated with colours
  terrain::MaterialsFunction materials() const { return materials_; }  // null unless the file has them
  TraceFunction trace() const { return trace_; }                       // null unless traced; of the heights since the last call

 private:
  explicit Library(void* handle) : handle_(handle) {}
  void* handle_;
  terrain::HeightsFunction heights_ = nullptr;
  terrain::ColoursFunction colours_ = nullptr;
  terrain::MaterialsFunction materials_ = nullptr;
  TraceFunction trace_ = nullptr;
};

// Compiled terrains by content. Trusts only a folder that belongs to this user and that nobody else can write.
class Cache {
 public:
  // In `folder`; if empty, in ridgecast/terrains below $XDG_CACHE_HOME or ~/.cache. Made if missing. Error: it cannot be made or is not
  // private.
  static Outcome<Cache> open(std::filesystem::path folder);
  // The file, existing or not, for this text compiled for this instruction set. Depends on all its inputs.
  std::filesystem::path fileFor(std::string_view text, std::string_view variant, bool colours = false) const;
  bool has(const std::filesystem::path& file) const;  // a file of this user's; marks it as used now
  // Removes the least recently used files beyond kMaxKept: otherwise clients that create sessions could fill the disk with parameters.
  // Loaded libraries stay loaded.
  void trim() const;
  static constexpr std::size_t kMaxKept = 256;

 private:
  explicit Cache(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
};

// Compiles for an instruction set ("baseline", "avx2", "avx512") into `target`, completely or not at all. `file` is for messages. Error: no
// compiler (says what to install), code that it rejects, with the file's line, or a stop, which ends the compiler.
Outcome<void> compile(std::string_view file, const Translation& translation, std::string_view variant, const std::filesystem::path& target,
                      const std::stop_token& stop = {});

}  // namespace ridgecast::glsl
