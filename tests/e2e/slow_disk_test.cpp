// A real server on a disk that takes its time (tests/support/slow_disk.cpp): edits wait for it, together, and nobody else does.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/flier.h"
#include "tests/support/process.h"
#include "tests/support/sanitized.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::HasSubstr;

constexpr int kSync = 300;  // milliseconds

class SlowDisk : public testing::Test {
 protected:
  std::string edit(int x) {
    const std::string body = R"({"op":"crater","z":0,"radius":5,"depth":1,"x":)" + std::to_string(x) + "}";
    SocketClient client(server.port());
    client.send(
        "POST /v1/sessions/default/edits HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/json\r\n"
        "Content-Length: " +
        std::to_string(body.size()) + "\r\n\r\n" + body);
    return client.answer();
  }
  ScratchFolder folder;
  ServerProcess server{RIDGECAST_SERVER,
                       {"--threads", "1", "--state", (folder / "state").string()},
                       0,
                       {{"LD_PRELOAD", RIDGECAST_SLOW_DISK}, {"SLOW_DISK_MS", std::to_string(kSync)}}};
};

// On the server's only thread.
TEST_F(SlowDisk, EditsStopNoCamera) {
  EXPECT_THAT(edit(0), HasSubstr(" 201 "));
  wire::Settings settings;
  settings.threshold = 10;
  Flier flier(server.url(), settings);
  camera::Camera camera;
  camera.pose.y = 900;
  flier.step(camera);
  std::atomic<int> acknowledged{0};
  std::vector<std::jthread> editors;  // one of whom always waits
  for (int k = 0; k < 4; ++k)
    editors.emplace_back([&, k](const std::stop_token& stop) {
      for (int n = 0; !stop.stop_requested(); ++n) acknowledged += edit(4000 + 100 * k + n).find(" 201 ") != std::string::npos;
    });
  int steps = 0;
  for (; acknowledged < 40; ++steps) {  // in ten writes or more
    camera.pose.x += 10;
    flier.step(camera);
  }
  editors.clear();
  std::printf("%d iterations while at least 10 writes of %d ms were made\n", steps, kSync);
  EXPECT_GE(steps, 50) << "the camera waits for the disk";
}

TEST_F(SlowDisk, WhatWaitsIsKeptInOneWrite) {
  EXPECT_THAT(edit(0), HasSubstr(" 201 "));
  const auto begun = std::chrono::steady_clock::now();
  {
    std::vector<std::jthread> editors;
    for (int k = 1; k <= 24; ++k) editors.emplace_back([this, k] { EXPECT_THAT(edit(100 * k), HasSubstr(" 201 ")); });
  }
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - begun;
  EXPECT_LT(took.count(), 24 * kSync) << "each has a write of its own";
}

// An edit that is being stored keeps nobody from ending the server, for good.
TEST(HungDisk, AServerThatIsToldToEndEndsWithinItsTime) {
  ScratchFolder folder;
  ServerProcess server{RIDGECAST_SERVER,
                       {"--drain", "1", "--state", (folder / "state").string()},
                       0,
                       {{"LD_PRELOAD", RIDGECAST_SLOW_DISK}, {"SLOW_DISK_MS", "3600000"}}};
  const std::string body = R"({"op":"crater","x":0,"z":0,"radius":5,"depth":1})";
  SocketClient client(server.port());
  client.send("POST /v1/sessions/default/edits HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: " +
              std::to_string(body.size()) + "\r\n\r\n" + body);
  EXPECT_TRUE(await([&] { return std::filesystem::exists(folder / "state/default.edits"); }));
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(kTimeout), 1);
  EXPECT_THAT(server.process().output(), HasSubstr("error ends at once: 15 s after the drain, a disk or an answer still keeps it"));
}

}  // namespace
}  // namespace ridgecast
