#pragma once
// What an operator asks a server by HTTP.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <regex>
#include <sstream>
#include <string>

#include "common/wire/messages.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

inline std::string get(std::uint16_t port, const std::string& target) {
  SocketClient client(port);
  client.send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  const std::string answer = client.answer();
  return answer.substr(std::min(answer.size(), answer.find("\r\n\r\n") + 4));
}

// Name with labels -> value; waits while the server refuses whoever comes. Fails at a line that is none of the exposition format.
inline std::map<std::string, double> scrape(std::uint16_t port) {
  static const std::regex sample(R"(^([a-zA-Z_:][a-zA-Z0-9_:]*(\{([a-zA-Z_][a-zA-Z0-9_]*="([^"\\\n]|\\.)*",?)*\})?) (\S+)$)");
  std::map<std::string, double> figures;
  std::string answer;
  EXPECT_TRUE(await([&] { return (answer = get(port, "/metrics")).starts_with("# HELP "); })) << answer;
  std::istringstream text(answer);
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("# HELP ") || line.starts_with("# TYPE ")) continue;
    std::smatch match;
    if (!std::regex_match(line, match, sample)) {
      ADD_FAILURE() << "no sample: " << line;
      continue;
    }
    EXPECT_TRUE(figures.emplace(match[1], std::stod(match[5])).second) << "twice: " << line;
  }
  return figures;
}

inline wire::Settings coarse() {
  wire::Settings s;
  s.threshold = 10;
  return s;
}

inline std::string snapshotOf(const std::string& box) {
  return "GET /v1/sessions/default/snapshot.glb?" + box + " HTTP/1.1\r\nHost: localhost\r\n\r\n";
}

}  // namespace ridgecast::testing_support
