#pragma once
// The real server as a process on a free loopback port.

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace ridgecast::testing_support {

// A port of loopback that nobody listens on now.
std::uint16_t freePort();

class ServerProcess {
 public:
  // Starts `program` and waits until it listens; throws std::runtime_error with its output when it does not.
  // Port 0: any free one.
  explicit ServerProcess(const std::string& program, const std::vector<std::string>& arguments = {}, std::uint16_t port = 0,
                         const Environment& environment = {});

  std::uint16_t port() const { return port_; }
  std::string url() const { return "ws://127.0.0.1:" + std::to_string(port_); }
  // Whether the process runs and answers /healthz with ok.
  bool healthy();
  Process& process() { return process_; }
  // Asks it to end (SIGTERM); its exit code, nothing when it does not end.
  std::optional<int> stop();

 private:
  ScratchFolder folder_;
  Process process_;
  std::uint16_t port_ = 0;
};

}  // namespace ridgecast::testing_support
