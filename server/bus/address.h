#pragma once
// Where an engine is, as a URL says it. Pure.

#include <cstdint>
#include <string>

#include "common/outcome/outcome.h"

namespace ridgecast::bus {

struct Address {
  bool tls = false;
  std::string user, password;  // empty: none
  std::string host;
  std::uint16_t port = 6379;
  unsigned database = 0;

  std::string text() const;  // the URL without user and password
};

// redis://[[USER][:PASSWORD]@]HOST[:PORT][/DATABASE], under TLS rediss://. Error: one sentence, without the password.
Outcome<Address> parseAddress(const std::string& url);

}  // namespace ridgecast::bus
