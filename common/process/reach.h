#pragma once
// The files and network that a child program may access: the kernel denies all else (Landlock, Linux 5.13).

#include <filesystem>
#include <optional>
#include <vector>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

namespace ridgecast::process {

struct Reach {
  std::vector<std::filesystem::path> reads;   // files, and folders with all that is in them; missing ones are ignored
  std::vector<std::filesystem::path> writes;  // folders, which it may read as well
};

// A set of rules, as a file descriptor. The program opens no TCP connection either where the kernel knows that (Linux 6.7).
class ReachRules {
 public:
  static bool areKept();  // by this kernel
  // Error: the kernel has no room for them.
  static Outcome<ReachRules> of(const Reach& reach);
  ReachRules(ReachRules&& other) noexcept;
  ReachRules& operator=(ReachRules&&) = delete;
  ~ReachRules();
  int descriptor() const {
    expects(file_ >= 0, "rules that were moved away are not used");
    return file_;
  }
  // Confines the calling thread and what it starts, for good; a system call or two. False: not confined.
  static bool enter(int descriptor);

 private:
  explicit ReachRules(int file) : file_(file) {}
  int file_;
};

}  // namespace ridgecast::process
