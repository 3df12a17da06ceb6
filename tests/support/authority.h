#pragma once
// A certificate authority of our own, by the openssl program.

#include <filesystem>
#include <string>

#include "tests/support/process.h"

namespace ridgecast::testing_support {

class Authority {
 public:
  Authority();  // throws std::runtime_error when there is no openssl
  std::string certificate() const { return (folder_ / "ca.pem").string(); }

  struct Issued {
    std::string certificate, key;  // files
  };
  // For names such as "DNS:localhost,IP:127.0.0.1". `days` 0 or less: it has expired already.
  Issued issue(const std::string& names, int days = 1);

 private:
  void run(std::vector<std::string> arguments) const;
  ScratchFolder folder_;
  int issued_ = 0;
};

}  // namespace ridgecast::testing_support
