// How a server ends: what its manager hears, who is still served, and what it finishes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <memory>
#include <string>
#include <vector>

#include "tests/e2e/operator.h"
#include "tests/support/flier.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

TEST(Operations, TellsItsManagerAndEndsWithinItsBound) {
  // What systemd would hear.
  ScratchFolder folder;
  const std::string path = (folder / "notify").string();
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  ASSERT_LT(path.size(), sizeof address.sun_path);
  path.copy(address.sun_path, path.size());
  ASSERT_EQ(bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  const auto heard = [&](const std::string& what) {
    for (pollfd p{socket, POLLIN, 0}; poll(&p, 1, 120'000) == 1;) {
      char text[512];
      const ssize_t size = recv(socket, text, sizeof text, 0);
      if (size > 0 && std::string(text, static_cast<std::size_t>(size)).starts_with(what)) return true;
    }
    return false;
  };
  Process server({RIDGECAST_SERVER, "--port", "0", "--port-file", (folder / "port").string(), "--drain", "2"}, {{"NOTIFY_SOCKET", path}});
  ASSERT_TRUE(heard("READY=1"));
  const auto port = static_cast<std::uint16_t>(std::stoul(readText(folder / "port")));
  server.signal(SIGHUP);
  EXPECT_TRUE(heard("RELOADING=1\nMONOTONIC_USEC="));
  EXPECT_TRUE(heard("READY=1"));
  // Clients that never answer anything cannot hold it.
  SocketClient stream(port), half(port), idle(port);
  ASSERT_TRUE(stream.upgrade());
  half.send("GET /healthz HTT");
  const auto began = Clock::now();
  server.signal(SIGTERM);
  EXPECT_TRUE(heard("STOPPING=1"));
  EXPECT_EQ(server.wait(kTimeout), 0);
  if (measures()) {
    EXPECT_LT(Clock::now() - began, 6s);
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "port"));
  close(socket);
}

// A server that is told to end goes on serving for a while: balancers and proxies learn late that it leaves.
TEST(Operations, WhoStillComesDuringADrainsDelayIsServed) {
  const std::uint16_t admin = freePort();
  ServerProcess server(RIDGECAST_SERVER, {"--drain-delay", "6", "--admin-port", std::to_string(admin)});
  EXPECT_EQ(get(admin, "/readyz"), "ready\n");
  Flier before(server.url(), coarse());
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", before.world());
  before.step(path.at(0));
  server.process().signal(SIGTERM);
  ASSERT_TRUE(await([&] { return get(admin, "/readyz") == "This server is leaving.\n"; }));
  EXPECT_EQ(get(admin, "/healthz"), "ok\n");
  int come = 0;
  const auto lags = Clock::now() + 5s;  // what kube-proxy may need
  for (int k = 1; Clock::now() < lags || k < 5; ++k, ++come) {
    ASSERT_EQ(get(server.port(), "/healthz"), "ok\n") << k;
    Flier late(server.url(), coarse());
    ASSERT_EQ(late.step(path.at(0.1 * k)).number, 1u) << k;
    ASSERT_NO_THROW(before.step(path.at(0.1 * k))) << k;
  }
  EXPECT_GE(come, 5);
  EXPECT_EQ(server.process().wait(kTimeout), 0);
  EXPECT_ANY_THROW(before.step(path.at(0)));
}

// What waits can be seen, and a server that is told to end hands over what it is working at.
TEST(Operations, QueuesAreCountedAndSnapshotsInTheMakingAreFinished) {
  ServerProcess server(RIDGECAST_SERVER, {"--drain", "60"});
  const std::string slow = snapshotOf("x0=0&z0=0&x1=400&z1=400&error=0.5");
  std::vector<std::unique_ptr<SocketClient>> askers;
  for (int k = 0; k < 2; ++k) {  // one client's share
    askers.push_back(std::make_unique<SocketClient>(server.port()));
    askers.back()->send(slow);
  }
  double waiting = 0;
  await([&] { return (waiting = scrape(server.port())["ridgecast_queue_depth{queue=\"snapshots\"}"]) == 1; });
  EXPECT_EQ(waiting, 1);
  server.process().signal(SIGTERM);
  for (auto& asker : askers) {
    std::string answer;
    for (int k = 0; k < 4 && answer.find("\r\n\r\n") == std::string::npos; ++k) answer += asker->answer();
    EXPECT_THAT(answer, testing::StartsWith("HTTP/1.1 200"));
    const auto body = answer.find("\r\n\r\n");
    ASSERT_NE(body, std::string::npos);
    EXPECT_THAT(answer, HasSubstr("Content-Length: " + std::to_string(answer.size() - body - 4) + "\r\n"));
  }
  EXPECT_EQ(server.process().wait(kTimeout), 0);
}

TEST(Operations, ASecondSignalDuringTheDrainEndsAtOnce) {
  for (const int second : {SIGTERM, SIGINT}) {
    ServerProcess server(RIDGECAST_SERVER, {"--drain", "600", "--max-snapshot-seconds", "600", "--log-level", "info"});
    SocketClient first(server.port()), next(server.port());
    for (SocketClient* asker : {&first, &next}) asker->send(snapshotOf("x0=-4000&z0=-4000&x1=4000&z1=4000&error=0.05"));
    ASSERT_TRUE(await([&] { return scrape(server.port())["ridgecast_queue_depth{queue=\"snapshots\"}"] == 1; }));
    server.process().signal(SIGTERM);
    ASSERT_TRUE(await([&] { return server.process().output().find("shutting down") != std::string::npos; })) << server.process().output();
    server.process().signal(second);
    EXPECT_TRUE(await([&] { return !server.process().running(); })) << "a second signal was not heard";
    if (server.process().running()) server.process().signal(SIGKILL);
  }
}

TEST(Operations, ASnapshotThatTakesTooLongDoesNotHoldTheEnd) {
  ServerProcess server(RIDGECAST_SERVER, {"--drain", "1"});
  SocketClient asker(server.port());
  asker.send(
      "GET /v1/sessions/default/snapshot.glb?x0=0&z0=0&x1=20000&z1=20000&error=6 HTTP/1.1\r\nHost: localhost\r\nPrefer: progress\r\n\r\n");
  for (std::string word; !testing::Matches(testing::AnyOf(HasSubstr("meshing"), HasSubstr("checking")))(word);) {
    word = asker.answer(false);  // how far it is
    ASSERT_THAT(word, testing::StartsWith("HTTP/1.1 102"));
  }
  const auto began = Clock::now();
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(kTimeout), 0);
  EXPECT_GE(Clock::now() - began, 900ms);
  if (measures()) {
    EXPECT_LT(Clock::now() - began, 6s);
  }
}

}  // namespace
}  // namespace ridgecast
