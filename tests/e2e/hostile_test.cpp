// Clients that misbehave, against the real server: it lives, answers, and a client that flies meanwhile does not notice.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "common/wire/wire.h"
#include "tests/support/flier.h"
#include "tests/support/sanitized.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;

std::string noise(std::mt19937_64& random, std::size_t bytes) {
  std::string text(bytes, '\0');
  for (char& c : text) c = static_cast<char>(random());
  return text;
}

// What a client is told before it is hung up on; fails when it is told nothing.
wire::ErrorMessage lastWords(SocketClient& client) {
  wire::ErrorMessage error;
  while (const auto frame = client.receive()) {
    if (frame->opcode != 2) break;
    auto message = wire::decodeServer({reinterpret_cast<const std::uint8_t*>(frame->payload.data()), frame->payload.size()});
    EXPECT_TRUE(message);
    if (message && std::holds_alternative<wire::ErrorMessage>(*message)) error = std::get<wire::ErrorMessage>(*message);
  }
  EXPECT_FALSE(error.message.empty());
  return error;
}

class Hostile : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    server_ = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{"--timeout", "2", "--max-connections", "100"});
    wire::Settings settings;
    settings.threshold = 20;
    flier_ = std::make_unique<Flier>(server_->url(), settings);
    path_ = std::make_unique<PathCamera>(RIDGECAST_PATHS "/alpine.json", flier_->world());
  }
  static void TearDownTestSuite() {
    flier_.reset();
    EXPECT_EQ(server_->stop(), 0) << server_->process().output();
    server_.reset();
  }
  // Meanwhile somebody flies on, and every hash agrees.
  void SetUp() override {
    pilot_ = std::thread([this] {
      try {
        do {
          flier_->step(path_->looped(++steps_ * 0.1));
        } while (!landed_);
      } catch (const std::exception& e) {
        failure_ = e.what();
      }
    });
  }
  void TearDown() override {
    landed_ = true;
    pilot_.join();
    EXPECT_EQ(failure_, "");
    EXPECT_TRUE(server_->healthy()) << server_->process().output();
  }
  static std::uint16_t port() { return server_->port(); }

  static std::unique_ptr<ServerProcess> server_;
  static std::unique_ptr<Flier> flier_;
  static std::unique_ptr<PathCamera> path_;
  static int steps_;
  std::thread pilot_;
  std::atomic<bool> landed_ = false;
  std::string failure_;
};
std::unique_ptr<ServerProcess> Hostile::server_;
std::unique_ptr<Flier> Hostile::flier_;
std::unique_ptr<PathCamera> Hostile::path_;
int Hostile::steps_ = 0;

TEST_F(Hostile, RandomBytesInsteadOfHttp) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 40; ++k) {
    SocketClient client(port());
    client.send(noise(random, 1 + random() % 20'000));
    client.send("\r\n\r\n");
    EXPECT_TRUE(client.closed());
  }
}

TEST_F(Hostile, HttpThatIsNone) {
  for (const std::string& request : std::vector<std::string>{
           "GET / HTTP/9.9\r\n\r\n", "\r\n\r\n\r\n", "GET\r\n\r\n", "GET  HTTP/1.1\r\n\r\n",
           "POST /healthz HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n", "GET /%zz?session=%00 HTTP/1.1\r\nHost: localhost\r\n\r\n",
           "GET /v1/stream?session=../../etc HTTP/1.1\r\nHost: localhost\r\n\r\n",
           "GET / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n",
           "GET /" + std::string(100'000, 'a') + " HTTP/1.1\r\n\r\n", "GET / HTTP/1.1\r\nX: " + std::string(100'000, 'b') + "\r\n\r\n"}) {
    SocketClient client(port());
    client.send(request);
    const std::string answer = client.answer();
    // A body is never read: what asks for a page and brings one gets the page, and the connection ends.
    const bool refused = answer.empty() || answer.starts_with("HTTP/1.1 4");
    EXPECT_TRUE(refused || answer.find("Connection: close\r\n") != std::string::npos)
        << request.substr(0, 40) << " -> " << answer.substr(0, 200);
  }
}

TEST_F(Hostile, RandomMessages) {
  std::mt19937_64 random(2);
  for (int k = 0; k < 40; ++k) {
    SocketClient client(port());
    ASSERT_TRUE(client.upgrade());
    if (k % 2) client.message(wire::encode(wire::ClientMessage{wire::Hello{}}));
    client.message(noise(random, 1 + random() % 100'000));
    EXPECT_EQ(lastWords(client).code, wire::ErrorCode::kMalformed);
    if (k > 0) continue;
    EXPECT_TRUE(client.closed());  // also when the close is not answered
  }
}

TEST_F(Hostile, RandomFrames) {
  std::mt19937_64 random(3);
  for (int k = 0; k < 40; ++k) {
    SocketClient client(port());
    ASSERT_TRUE(client.upgrade());
    client.send(noise(random, 1 + random() % 5000));
    if (k % 4 > 0) continue;
    EXPECT_TRUE(client.closed());  // at the latest when no hello came
  }
}

TEST_F(Hostile, AnOversizeMessageInManySmallPieces) {
  SocketClient client(port());
  ASSERT_TRUE(client.upgrade());
  bool open = client.frame(2, std::string(1000, 'x'), false);
  for (int k = 0; k < 400 && open; ++k) open = client.frame(0, std::string(1000, 'x'), false);
  EXPECT_TRUE(client.closed());
}

TEST_F(Hostile, HalfMessagesAndSuddenEnds) {
  const std::string hello = wire::encode(wire::ClientMessage{wire::Hello{}});
  const std::string pose = wire::encode(wire::ClientMessage{wire::PoseMessage{1, path_->at(0)}});
  for (std::size_t k = 0; k < pose.size(); ++k) {
    SocketClient client(port());
    ASSERT_TRUE(client.upgrade());
    client.message(hello);
    client.frame(2, pose.substr(0, k), true, pose.size());
  }
  // An upgrade, a hello and a pose, and away before the answer.
  for (int k = 0; k < 20; ++k) {
    SocketClient client(port());
    ASSERT_TRUE(client.upgrade());
    client.message(hello);
    client.message(pose);
  }
  SocketClient client(port());
  client.send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nConn");
}

TEST_F(Hostile, HeadersThatNeverEnd) {
  std::vector<std::unique_ptr<SocketClient>> clients;
  for (int k = 0; k < 20; ++k) clients.push_back(std::make_unique<SocketClient>(port()));
  for (auto& c : clients) c->send("GET / HTTP/1.1\r\n");
  // A line every half second does not buy more time than the server's timeout of two seconds.
  for (int n = 0; n < 6; ++n) {
    std::this_thread::sleep_for(500ms);
    for (auto& c : clients) c->send("X-" + std::to_string(n) + ": y\r\n");
  }
  for (auto& c : clients) {
    std::this_thread::sleep_for(1ms);
    EXPECT_TRUE(c->closed());
  }
}

// Memory really runs out, under a limit of address space: cameras end, the server stays.
TEST(HostileToMemory, WhatRunsOutEndsCamerasAndNotTheServer) {
  if (kSanitized) GTEST_SKIP() << "the sanitizers need all address space";
  ScratchFolder folder;
  const std::string program = folder / "server";
  std::ofstream(program) << "#!/bin/sh\nulimit -v 1000000\nexec " RIDGECAST_SERVER " \"$@\"\n";
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  ServerProcess server(program, {"--max-total-triangles", "1000000000", "--threads", "2"});
  wire::Settings greedy;
  greedy.threshold = 0.05;
  greedy.triangleBudget = 2'000'000;
  std::vector<std::unique_ptr<Flier>> fliers;
  std::string end;
  camera::Camera camera;
  camera.pose.y = 1500;
  for (int k = 0; k < 6 && end.empty(); ++k) try {
      fliers.push_back(std::make_unique<Flier>(server.url(), greedy));
      for (int step = 0; step < 60; ++step) fliers.back()->step(camera);
    } catch (const std::exception& e) {
      end = e.what();
    }
  EXPECT_THAT(end, testing::HasSubstr("The server ran out of memory at this camera's work; connect again with a smaller triangle budget."));
  EXPECT_TRUE(server.healthy()) << server.process().output();
  fliers.clear();
  EXPECT_TRUE(await([&] {
    try {
      Flier(server.url(), {}).step(camera);
      return true;
    } catch (const std::exception&) {
      return false;
    }
  }));
}

}  // namespace
}  // namespace ridgecast
