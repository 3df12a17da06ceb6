#pragma once
// A server in this process whose ground is edited, and members whose meshes follow.

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/core/mesh/follower.h"
#include "client/link/connection.h"
#include "common/edits/json.h"
#include "server/http/edits.h"
#include "server/http/map_tiles.h"
#include "server/http/queries.h"
#include "tests/integration/loopback.h"
#include "tests/support/crater.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {

using namespace std::chrono_literals;
using link::Connection;
using Time = std::chrono::steady_clock;
using testing_support::kTimeout;

using testing_support::m;

inline std::string craterAt(double x, double z = 0, double radius = 8) {
  return edits::toJson(testing_support::craterAt(x, z, radius, radius / 3));
}

// A member with a mesh of its own; flies, or stands.
class Member {
 public:
  Member(std::uint16_t port, const std::string& name, bool wantsEdits = true, std::uint64_t after = 0) {
    wire::Hello hello;
    hello.clientName = name;
    hello.points = true;
    hello.edits = wantsEdits;
    hello.editsAfter = after;
    auto opened = Connection::open({"127.0.0.1", std::to_string(port), "default"}, hello, {.reconnects = false, .timeout = kTimeout});
    if (!opened) throw std::runtime_error(opened.error().message);
    connection_ = std::move(*opened);
    follower_.follow({true, false, connection_->world().settings.triangleBudget});
  }
  Connection& connection() { return *connection_; }
  void stand(double x, double z, double y = 400) {
    wire::PoseMessage pose;
    pose.sequence = ++sequence_;
    pose.camera.pose.x = m(x);
    pose.camera.pose.z = m(z);
    pose.camera.pose.y = y;
    pose.camera.pose.pitch = -0.5;
    connection_->send(pose);
  }
  // Applies the next iteration; false: none came. Its hash is checked.
  bool follow(std::chrono::milliseconds wait = kTimeout) {
    const auto received = connection_->receive(wait);
    if (!received) return false;
    const auto answer = follower_.apply(received->iteration);
    EXPECT_FALSE(answer.wrong) << answer.wrong->message;
    connection_->acknowledge(answer.acknowledge);
    hash_ = answer.acknowledge.meshHash;
    EXPECT_EQ(hash_, received->iteration.meshHash);
    edit_ = received->iteration.edit;
    settled_ = received->iteration.settled;
    ++iterations_;
    return true;
  }
  void settle(std::uint64_t edit) {
    while (!(settled_ && edit_ >= edit)) ASSERT_TRUE(follow());
  }
  Outcome<wire::EditAnswer> edit(const std::string& operation, const std::string& key = "") {
    auto answer = connection_->edit({0, key, operation});
    return answer.get();
  }
  std::vector<wire::MadeEdit> edits(std::uint64_t until) {
    const auto deadline = Time::now() + kTimeout;
    while ((edits_.empty() || edits_.back().number < until) && Time::now() < deadline) {
      for (auto& made : connection_->takeEdits().made) edits_.push_back(std::move(made));
      std::this_thread::sleep_for(1ms);
    }
    return edits_;
  }
  std::uint64_t hash() const { return hash_; }
  std::uint64_t edit() const { return edit_; }
  int iterations() const { return iterations_; }

 private:
  std::unique_ptr<Connection> connection_;
  core::Follower follower_;
  std::vector<wire::MadeEdit> edits_;
  std::uint64_t sequence_ = 0, hash_ = 0, edit_ = 0;
  bool settled_ = false;
  int iterations_ = 0;
};

class EditsTest : public LoopbackTest {
 protected:
  void SetUp() override { serve(std::make_unique<scheduling::SteadyTimer>()); }
  void serve(std::unique_ptr<const scheduling::Timer> timer) {
    open({}, {}, std::move(timer));
    listen({http::queryRoute(directory), http::editsRoute(directory), http::mapTileRoute(directory)});
  }
  std::uint16_t port() const { return server->port(); }
  std::string ask(const std::string& method, const std::string& path, const std::string& body = "", const std::string& headers = "") const {
    testing_support::SocketClient client(port());
    client.send(method + " /v1/" + (path.starts_with("heights?") ? path : "sessions/default/" + path) + " HTTP/1.1\r\nHost: localhost\r\n" +
                headers +
                (body.empty() ? "" : "Content-Type: application/json\r\nContent-Length: " + std::to_string(body.size()) + "\r\n") + "\r\n" +
                body);
    return client.answer();
  }
  static void has(const std::string& answer, const std::string& words) { EXPECT_NE(answer.find(words), std::string::npos) << answer; }

  std::shared_ptr<const terrain::Terrain> base = terrain::create("alpine", 1).value();
};

}  // namespace ridgecast
