#pragma once
// What tests of a connection say and expect.

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <string>

#include "client/link/connection.h"
#include "common/wire/wire.h"
#include "tests/support/waiting.h"

namespace ridgecast::link {

inline core::Url at(const std::string& port) { return {.host = "127.0.0.1", .port = port, .session = "default"}; }

inline std::string worldBytes(std::uint32_t window = 3, std::uint32_t version = wire::kProtocolVersion,
                              std::uint32_t revision = wire::kRevision) {
  return wire::encode(wire::ServerMessage(wire::World{.protocolVersion = version,
                                                      .serverName = "raw",
                                                      .session = "default",
                                                      .terrainName = "alpine",
                                                      .terrainSource = "",
                                                      .seed = 3,
                                                      .contentHash = 4,
                                                      .horizon = 32'000,
                                                      .settings = {},
                                                      .window = window,
                                                      .camera = 1,
                                                      .revision = revision}));
}

inline std::string errorOf(const core::Url& url, std::chrono::milliseconds patience = testing_support::kTimeout,
                           const Waiting& waiting = {}) {
  const auto connection = Connection::open(url, {}, {.timeout = patience, .waiting = waiting});
  EXPECT_FALSE(connection);
  return connection ? "" : connection.error().message;
}
inline void expectContains(const std::string& text, const std::string& part) { EXPECT_NE(text.find(part), std::string::npos) << text; }

}  // namespace ridgecast::link
