#pragma once
// A server in this process whose access rules are set by each test.

#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "client/link/connection.h"
#include "common/wire/wire.h"
#include "server/access/jwt.h"
#include "server/access/tokens.h"
#include "server/directory/directory.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "tests/support/process.h"
#include "tests/support/socket_client.h"
#include "tests/support/still_mesh.h"
#include "tests/support/waiting.h"

namespace ridgecast {

using namespace std::chrono_literals;
using testing_support::SocketClient;
using testing_support::StillMesh;

inline const std::string kSecret = "an integration test's secret of enough bytes";

class AccessTest : public testing::Test {
 protected:
  void SetUp() override {
    logging::setUp(logging::Format::kText, logging::Level::kError);
    settings.port = 0;
    settings.drain = 2s;
  }
  void TearDown() override { stop(); }
  virtual std::vector<http::Route> routes() { return {}; }  // beside the server's own
  void start() {
    stop();
    executor = std::make_unique<scheduling::Executor>(2);
    resources = std::make_shared<session::Resources>();
    resources->executor = executor.get();
    resources->makeMesh = [](auto, const auto&, auto) { return std::make_unique<StillMesh>(); };
    resources->makeTerrain = [](const session::WorldSpec& spec, const std::stop_token&) {
      return terrain::create(spec.terrain, spec.seed);
    };
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 1).value());
    auto made = net::Server::listen(settings, directory, routes());
    ASSERT_TRUE(made) << made.error().message;
    server = std::move(*made);
  }
  void stop() {
    if (server) server->shutdown();
    executor.reset();
    server.reset();
    directory.reset();
  }
  std::string file(const std::string& name, const std::string& text) {
    const auto path = folder / name;
    std::ofstream(path) << text;
    return path.string();
  }
  static access::Time now() { return std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now()); }
  static std::string jwt(access::Rights rights, const std::string& session = "", std::chrono::seconds lasts = 1h) {
    return access::issueJwt({"tester", rights, session, now() + lasts}, kSecret, now());
  }
  // The status of a GET, or of the upgrade where the path is a stream's.
  int status(const std::string& target, const std::string& headers, const std::string& method = "GET") {
    SocketClient client(server->port());
    std::string answer;
    if (target.starts_with("/v1/stream")) {
      if (client.upgrade(target, headers)) return 101;
      answer = client.refusal();
    } else {
      client.send(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + headers + "\r\n");
      answer = client.answer(method != "HEAD");
    }
    return answer.size() > 12 ? std::stoi(answer.substr(9, 3)) : 0;
  }
  std::string get(const std::string& target, const std::string& headers = "") {
    SocketClient client(server->port());
    client.send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + headers + "\r\n");
    return client.answer();
  }
  double refusals(metrics::Refusal reason) const { return resources->figures->refusals[static_cast<std::size_t>(reason)]->Value(); }
  Outcome<std::unique_ptr<link::Connection>> connect(const std::string& address, const std::string& ca,
                                                     const std::string& token = "") const {
    auto url = core::parseUrl(address).value();
    url.ca = ca;
    url.token = token;
    return link::Connection::open(url, wire::Hello{}, {.reconnects = false, .timeout = testing_support::kTimeout});
  }

  testing_support::ScratchFolder folder;
  net::Settings settings;
  std::unique_ptr<net::Server> server;  // outlives the executor, whose tasks send through it
  std::unique_ptr<scheduling::Executor> executor;
  std::shared_ptr<session::Resources> resources;
  std::shared_ptr<directory::Directory> directory;
};

}  // namespace ridgecast
