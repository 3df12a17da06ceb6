#pragma once
// A server with its sessions in this process, on a free port of loopback.

#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

#include "server/directory/directory.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"

namespace ridgecast {

class LoopbackTest : public testing::Test {
 protected:
  // Alpine as the default session; others may be added before listen(). `makeTerrain`: for sessions that clients create.
  void open(session::MakeTerrain makeTerrain = {}, session::Record record = {},
            std::unique_ptr<const scheduling::Timer> timer = std::make_unique<scheduling::SteadyTimer>()) {
    logging::setUp(logging::Format::kText, logging::Level::kWarning);
    executor = std::make_unique<scheduling::Executor>(2);
    auto resources = std::make_shared<session::Resources>();
    resources->executor = executor.get();
    resources->makeMesh = session::pipelineMeshes();
    resources->makeTerrain = std::move(makeTerrain);
    resources->record = std::move(record);
    resources->timer = std::move(timer);
    resources->serverName = "integration";
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 1).value());
  }
  void listen(std::vector<http::Route> routes = {}) {
    net::Settings settings;
    settings.port = 0;
    auto made = net::Server::listen(settings, directory, std::move(routes));
    ASSERT_TRUE(made) << made.error().message;
    server = std::move(*made);
  }
  void TearDown() override {
    if (server) server->shutdown();
    executor.reset();
    server.reset();
  }
  std::unique_ptr<net::Server> server;  // outlives the executor, whose tasks send through it
  std::unique_ptr<scheduling::Executor> executor;
  std::shared_ptr<directory::Directory> directory;
};

}  // namespace ridgecast
