#pragma once
// Programs under test as processes: started with arguments and environment, their output kept, ended by their own id.

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace ridgecast::testing_support {

// A folder that is gone with its owner.
class ScratchFolder {
 public:
  ScratchFolder();
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

using Environment = std::vector<std::pair<std::string, std::optional<std::string>>>;  // nothing: the variable is taken away

class Process {
 public:
  // Standard output and error go to one file. The process ends with this one, whatever happens.
  explicit Process(const std::vector<std::string>& command, const Environment& environment = {});
  ~Process();  // kills it when it still runs
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  bool running();
  // The exit code, 128 + signal when it was killed; nothing when it still runs then.
  std::optional<int> wait(std::chrono::milliseconds timeout);
  void signal(int number);
  pid_t id() const { return pid_; }
  std::string output() const;

 private:
  ScratchFolder folder_;
  pid_t pid_ = -1;
  std::optional<int> status_;
};

struct Finished {
  std::optional<int> code;  // nothing: it did not end in time and was killed
  std::string output;
};
Finished runProgram(const std::vector<std::string>& command, const Environment& environment = {},
                    std::chrono::milliseconds timeout = std::chrono::seconds(600));

// Whether a program of this name is found along PATH.
bool programExists(const std::string& name);

std::string readText(const std::filesystem::path& file);  // empty when it cannot be read

}  // namespace ridgecast::testing_support
