#pragma once
// A Redis of one test: on a free port of loopback, with its data in a folder that is gone with it.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace ridgecast::testing_support {

class RedisServer {
 public:
  static bool exists() { return programExists("redis-server") && programExists("redis-cli"); }

  // As an engine of servers must be, if `arguments`, which are redis-server's, do not say otherwise; PORT in them is its port. A settings
  // file comes first. Throws std::runtime_error with its output when it does not start.
  explicit RedisServer(std::vector<std::string> arguments = {});

  std::uint16_t port() const { return port_; }
  std::string url() const { return "redis://127.0.0.1:" + std::to_string(port_); }
  void kill();    // -9
  void start();   // again, with its data, on its port
  void pause();   // SIGSTOP
  void resume();  // SIGCONT
  pid_t id() const { return process_->id(); }
  bool isRunning();  // false: killed, or ended by itself
  // What redis-cli prints; it may run for as long as it needs.
  std::string command(const std::vector<std::string>& words) const;
  void listenAt(std::uint16_t port);  // instead of its port, which somebody else had
  std::filesystem::path folder() const { return folder_ / ""; }
  std::string output() const { return process_ ? process_->output() : ""; }

 private:
  const ScratchFolder folder_;
  const std::vector<std::string> arguments_;
  std::uint16_t port_;
  std::optional<Process> process_;
};

}  // namespace ridgecast::testing_support
