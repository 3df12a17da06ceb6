#pragma once
// A server of this program's own, for as long as the object lives.

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

class OwnServer {
 public:
  // Starts `program` on a free port of the loopback; its log goes to `folder`/server.log. Error: it does not start within 30 s; its last
  // words are in the message.
  static Outcome<std::unique_ptr<OwnServer>> start(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                                                   const std::filesystem::path& folder);
  ~OwnServer();  // ends it
  OwnServer(const OwnServer&) = delete;
  OwnServer& operator=(const OwnServer&) = delete;
  std::uint16_t port() const { return port_; }

 private:
  OwnServer(pid_t pid, int end) : pid_(pid), end_(end) {}
  const pid_t pid_;
  const int end_;  // readable once it has ended
  std::uint16_t port_ = 0;
};

}  // namespace ridgecast::evaluation
