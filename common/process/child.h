#pragma once
// Runs another program to its end under limits: the GLSL front end, the C++ compiler, the trial of a terrain (probe.h).

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/process/reach.h"

namespace ridgecast::process {

inline constexpr std::size_t kMaxOutput = 1 << 20;  // bytes of output that are kept

inline constexpr int kMaxWaiting = 6;  // how many times its processor time a program may take while others want the processors

inline constexpr std::chrono::milliseconds kLook{20};  // between two looks at a stop token

struct ChildLimits {
  std::chrono::seconds time{60};  // of a processor, each process; after kMaxWaiting times that, by the clock, all are killed
  std::uint64_t memory = std::uint64_t{3} << 30;     // bytes of address space, each process
  std::uint64_t fileSize = std::uint64_t{64} << 20;  // bytes, each file it writes
  std::optional<Reach> reach = {};                   // none: all; the kernel must keep it (ReachRules::areKept)
};

struct ChildEnd {
  bool timedOut = false;  // not if only a process that it started took too much of a processor
  int status = -1;        // exit status; -1 if a signal ended it
  int signal = 0;         // that ended it
  std::string output;     // stdout and stderr together, the first kMaxOutput
};

// The path of the program with this name, by PATH.
std::optional<std::filesystem::path> findProgram(const std::string& name);

// Runs it without input, with the C locale. A requested stop kills it and its children within kLook. Does not copy the calling process,
// however large it is; any thread. Error: it could not be started, or was stopped.
Outcome<ChildEnd> runChild(const std::filesystem::path& program, const std::vector<std::string>& arguments, const ChildLimits& limits = {},
                           std::stop_token stop = {});

}  // namespace ridgecast::process
