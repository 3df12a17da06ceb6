#pragma once
// Servers with one engine between them, and clients that ask them, in simulated time.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "server/directory/directory.h"
#include "server/http/lists.h"
#include "server/http/routes.h"
#include "tests/support/replies.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::http {

using namespace std::chrono_literals;
using directory::Directory;
using session::Session;
using testing_support::Replied;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;

// Its ground is its file's.
class FileTerrain final : public terrain::Terrain {
 public:
  FileTerrain(std::string name, std::uint32_t seed, std::string file) : name_(std::move(name)), seed_(seed), file_(std::move(file)) {}
  std::string_view name() const override { return name_; }
  std::string_view source() const override { return file_; }
  std::uint32_t seed() const override { return seed_; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    std::ranges::fill(out, 0.0f);
  }

 private:
  const std::string name_;
  const std::uint32_t seed_;
  const std::string file_;
};

class TestTimer final : public scheduling::Timer {  // of all servers
 public:
  explicit TestTimer(const SimulatedTimer& all) : all_(all) {}
  Time now() const override { return all_.now(); }
  void at(Time when, std::function<void()> call) const override { all_.at(when, std::move(call)); }

 private:
  const SimulatedTimer& all_;
};

class SharedSessions : public testing::Test {
 protected:
  struct Server {
    ~Server() {
      members.clear();
      directory.reset();
      executor.work();
    }
    scheduling::Executor executor{scheduling::Executor::WithoutThreads{}};
    std::shared_ptr<session::Resources> resources = std::make_shared<session::Resources>();
    std::shared_ptr<Directory> directory;
    std::map<std::string, std::string> files;  // by terrain; others are empty
    std::vector<std::string> removed, sentAway;
    bool hasLeft = false;
    std::map<std::shared_ptr<Session>, std::vector<session::Membership>> members;
  };

  explicit SharedSessions(std::uint64_t seed = 1) : engine(timer, seed) {}

  // The sentence of its refusal, empty: it serves.
  std::string start(const session::Limits& limits = {}, std::uint32_t defaultSeed = 1, const std::filesystem::path& state = {}) {
    auto server = std::make_unique<Server>();
    Server& s = *server;
    s.resources->executor = &s.executor;
    s.resources->timer = std::make_unique<TestTimer>(timer);
    s.resources->limits = limits;
    s.resources->state = state;
    s.resources->bus = engine.connect();
    s.resources->makeTerrain = [&s](const session::WorldSpec& spec,
                                    const std::stop_token&) -> Outcome<std::shared_ptr<const terrain::Terrain>> {
      return std::make_shared<const FileTerrain>(spec.terrain, spec.seed, s.files[spec.terrain]);
    };
    const auto terrain = std::make_shared<FileTerrain>("home", defaultSeed, "");
    std::optional<Outcome<void>> claimed;
    Directory::claimDefault(*s.resources, *terrain, {}, [&](Outcome<void> c) { claimed = std::move(c); });
    timer.advance(1s);
    if (!claimed) return "no answer";
    if (!*claimed) return claimed->error().message;
    s.directory = std::make_shared<Directory>(s.resources, terrain);
    s.directory->join({.url = "http://server" + std::to_string(s.resources->bus->server()),
                       .load = [] { return 0.25; },
                       .entry = sessionEntry,
                       .remove =
                           [&s](const Session& session, std::optional<std::uint64_t> camera) {
                             s.removed.push_back(session.name() + (camera ? " " + std::to_string(*camera) : ""));
                             if (!camera) std::erase_if(s.members, [&](const auto& m) { return m.first.get() == &session; });
                           },
                       .sendAway =
                           [&s](const Session& session) {
                             s.sentAway.push_back(session.name());
                             std::erase_if(s.members, [&](const auto& m) { return m.first.get() == &session; });
                           },
                       .leave = [&s] { s.hasLeft = true; }});
    servers.push_back(std::move(server));
    pass(1s);
    return "";
  }

  void pass(SimulatedTimer::Time::duration time) {
    for (const auto end = timer.now() + time; timer.step(end);)
      for (const auto& server : servers)
        if (server) server->executor.work();
  }

  Replied ask(int server, const std::string& method, std::string target, const std::string& client = "token of ann",
              access::Rights rights = access::Rights::all()) {
    Request request;
    request.method = method;
    request.target = target;
    request.host = "localhost";
    request.client = client;
    request.rights = rights;
    request.upgrade = target.starts_with("/v1/stream");
    request.webSocketVersion = "13";
    request.contentType = "application/json";
    Reply reply = answer(request, *servers[server]->directory, "1", {editsRoute()});
    request = {};
    std::string().swap(target);  // the work has its own copies
    for (int turns = 0; turns < 10'000; ++turns) {
      auto* const later = std::get_if<DeferredResponse>(&reply);
      if (!later) return Replied(std::move(reply));
      Reply next = later->work({});
      if (std::holds_alternative<RetryAt>(next))
        pass(1ms);
      else
        reply = std::move(next);
    }
    ADD_FAILURE() << method << " was never answered";
    return Replied(Answer{.status = 0});
  }
  // Answers edits by their session, to see whose they would be.
  Route editsRoute() const {
    return [](const Request& request) -> std::optional<Reply> {
      if (!request.path().ends_with("/edits")) return std::nullopt;
      return http::plain(200, std::string(request.target) + " " + std::string(request.client));
    };
  }
  // 101: one more member is in it.
  unsigned stream(int server, const std::string& query, const std::string& client = "token of ann",
                  access::Rights rights = access::Rights::all()) {
    const Replied reply = ask(server, "GET", "/v1/stream?session=" + query, client, rights);
    body = reply.body;
    if (!reply.upgradeTo) return reply.status;
    auto place = reply.upgradeTo->enter(client);
    if (!place) return body = place.error().message, 1013;
    reply.upgradeTo->use();
    servers[server]->members[reply.upgradeTo].push_back(std::move(*place));
    return 101;
  }
  void leave(int server, const std::string& name) {
    std::erase_if(servers[server]->members, [&](const auto& m) { return m.first->name() == name; });
  }
  std::shared_ptr<Session> find(int server, const std::string& name) const { return servers[server]->directory->find(name); }
  nlohmann::json list(int server) {
    const nlohmann::json all = nlohmann::json::parse(ask(server, "GET", "/v1/sessions").body);
    nlohmann::json byName;
    for (const nlohmann::json& session : all["sessions"]) byName[session["name"].get<std::string>()] = session;
    return byName;
  }
  // How many names are two worlds.
  int splits() const {
    std::map<std::string, std::set<std::pair<std::string, std::uint64_t>>> worlds;
    for (const auto& server : servers)
      if (server)
        for (const auto& session : server->directory->all())
          worlds[session->name()].emplace(session->spec().terrain + std::to_string(session->spec().seed), session->contentHash());
    return static_cast<int>(std::ranges::count_if(worlds, [](const auto& w) { return w.second.size() > 1; }));
  }
  bus::Bus& busOf(int server) const { return *servers[server]->resources->bus; }

  SimulatedTimer timer;
  SimulatedEngine engine;
  std::vector<std::unique_ptr<Server>> servers;
  std::string body;
};

}  // namespace ridgecast::http
