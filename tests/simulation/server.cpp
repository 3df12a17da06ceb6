#include "tests/simulation/server.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <new>
#include <span>
#include <stdexcept>
#include <utility>

#include "common/edits/history.h"
#include "common/edits/packed.h"
#include "server/edit_log/log.h"
#include "server/http/worlds.h"
#include "tests/simulation/line.h"
#include "tests/simulation/sound_mesh.h"
#include "tests/simulation/world.h"

namespace ridgecast::simulation {

// The simulation's, for as long as the server lives.
class Server::Clock final : public scheduling::Timer {
 public:
  Clock(const testing_support::SimulatedTimer& timer, std::shared_ptr<const bool> alive) : timer_(timer), alive_(std::move(alive)) {}
  Time now() const override { return timer_.now(); }
  void at(Time when, std::function<void()> call) const override {
    if (!*alive_) return;
    timer_.at(when, [alive = alive_, call = std::move(call)] {
      if (*alive) call();
    });
  }

 private:
  const testing_support::SimulatedTimer& timer_;
  const std::shared_ptr<const bool> alive_;
};

// Its memory runs out, now and then while `starves`.
class Server::Starving final : public terrain::Terrain {
 public:
  Starving(std::shared_ptr<const terrain::Terrain> of, std::shared_ptr<const bool> starves)
      : of_(std::move(of)), starves_(std::move(starves)) {}
  std::string_view name() const override { return of_->name(); }
  std::string_view source() const override { return of_->source(); }
  std::uint32_t seed() const override { return of_->seed(); }
  terrain::Relief relief() const override { return of_->relief(); }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    if (*starves_ && ++asked_ % 3 == 0) {
      ++met.starved;
      throw std::bad_alloc();
    }
    of_->heights(x, z, out);
  }

 private:
  const std::shared_ptr<const terrain::Terrain> of_;
  const std::shared_ptr<const bool> starves_;
  mutable std::uint64_t asked_ = 0;
};

Server::Server(std::shared_ptr<const terrain::Terrain> terrain, const session::Limits& limits, const testing_support::SimulatedTimer& timer,
               std::uint64_t seed, std::optional<Shared> shared)
    : terrain_(std::move(terrain)),
      limits_(limits),
      timer_(timer),
      random_(seed),
      shared_(shared),
      ownDisk_(shared ? nullptr : std::make_unique<testing_support::ForgetfulDisk>(random_)),
      disk_(shared ? shared->disk : *ownDisk_),
      diskTime_(std::chrono::milliseconds(seed % 3 == 0 ? 1 + seed % 97 : 0)) {
  std::filesystem::create_directory(folder());
}

Server::~Server() {
  if (isUp()) fall(false);
}

void Server::fill(std::uint64_t edits, lattice::Point near) {
  const auto log = edit_log::Log::create(folder() / (std::string(directory::kDefaultName) + ".edits"),
                                         {std::string(terrain_->name()), terrain_->seed(), {}, terrain::contentHash(*terrain_)})
                       .value();
  edits::History history(terrain_);
  for (std::vector<editing::Applied> group; edits > 0; group.clear()) {
    const auto before = history.layer();
    std::vector<edits::Posts> changed;
    for (; edits > 0 && group.size() < 256; --edits) {
      const auto at = [&](lattice::Step middle) { return middle + static_cast<lattice::Step>(random_() % 100'000) - 50'000; };
      const edits::Operation crater{edits::Crater{{at(near.x), at(near.z)}, 700, 300}, 0};
      changed.push_back(history.add(crater).value());
      group.push_back({history.last(), "", "before", 0, edits::pack(crater), edits::groundOf(changed.back())});
    }
    log->append(group, {*before, *history.layer(), changed}).value();
  }
}

std::shared_ptr<session::Resources> Server::begin(Program& program) {
  program.executor = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
  program.writer = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
  program.alive = std::make_shared<bool>(true);
  program.isTimed = isShared() ? std::make_shared<bool>(true) : program.alive;
  auto resources = std::make_shared<session::Resources>();
  resources->executor = program.executor.get();
  resources->disk = program.writer.get();
  resources->makeMesh = [](std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted,
                           std::shared_ptr<scheduling::Pool> pool) {
    return std::make_unique<SoundMesh>(std::move(terrain), granted, std::move(pool));
  };
  resources->serverName = "simulated";
  resources->limits = limits_;
  resources->state = folder();
  resources->timer = std::make_unique<Clock>(timer_, program.isTimed);
  if (isShared()) program.resources = resources;
  return resources;
}

bool Server::start() {
  if (isShared()) return startShared(), isUp();
  if (isUp() && !runs()) return false;  // a third server might take the session that the second waits for, and members would not know
  Program& program = isUp() ? beside_ : now_;
  if (program.directory) return true;
  const auto resources = begin(program);
  try {
    program.directory = std::make_shared<directory::Directory>(resources, std::make_shared<Starving>(terrain_, starves_));
    program.directory->awaitDefault();
  } catch (const std::runtime_error& e) {
    EXPECT_TRUE(disk_.isOff()) << e.what();
    fall(false);
  }
  return isUp();
}

std::shared_ptr<session::Session> Server::enter(const std::string& name, Duration takes) {
  if (auto session = this->session(name)) return session;
  auto reservation = now_.directory->reserve(name);
  EXPECT_TRUE(reservation || disk_.isOff() || beside_.entering.contains(name)) << reservation.error().message;
  if (!reservation || !*reservation) return nullptr;  // somebody is making it
  const auto make = [this](std::unique_ptr<directory::Reservation> reserved) {
    const auto made = now_.directory->add(std::move(reserved), std::make_shared<Starving>(terrain_, starves_));
    EXPECT_TRUE(made || disk_.isOff()) << made.error().message;
    return made ? *made : nullptr;
  };
  if (takes == Duration::zero()) return make(std::move(*reservation));
  now_.entering[name] = std::move(*reservation);
  timer_.at(timer_.now() + takes, [this, name, make, alive = now_.alive] {
    if (*alive) make(std::move(now_.entering.extract(name).mapped()));
  });
  return nullptr;
}

void Server::claim(const std::string& session, Duration time) {
  if (!hasOther() || beside_.entering.contains(session)) return;
  auto reservation = beside_.directory->reserve(session);
  const bool isFree = !this->session(session) && !now_.entering.contains(session);
  EXPECT_TRUE(isFree || !reservation) << "two servers have the session " << session;
  if (!reservation || !*reservation) return;
  beside_.entering[session] = std::move(*reservation);
  timer_.at(timer_.now() + time, [this, session, alive = beside_.alive] {
    if (*alive) (now_.alive == alive ? now_ : beside_).entering.erase(session);
  });
}

void Server::end(Program& program) {
  if (!program.alive) return;
  *program.alive = *program.isTimed = false;
  program.entering.clear();
  program.directory.reset();
  program.bus.reset();
  program = {};
}

// ---- one of several ----

void Server::startShared() {
  if (now_.executor || disk_.isOff()) return;
  const auto resources = begin(now_);
  resources->makeTerrain = [this](const session::WorldSpec& spec,
                                  const std::stop_token&) -> Outcome<std::shared_ptr<const terrain::Terrain>> {
    auto made = spec.seed == terrain_->seed() ? terrain_ : terrain::create(spec.terrain, spec.seed).value();
    return std::shared_ptr<const terrain::Terrain>(std::make_shared<Starving>(std::move(made), starves_));
  };
  resources->bus = now_.bus = shared_->engine.connect();
  takesMembers_ = true;
  directory::Directory::claimDefault(*resources, *terrain_, {}, [this, resources, alive = now_.alive](const Outcome<void>& claimed) {
    timer_.at(timer_.now(), [this, resources, alive, isClaimed = claimed.has_value()] {
      if (!*alive) return;
      isClaimed ? serve(resources) : end(now_);
    });
  });
}

void Server::serve(const std::shared_ptr<session::Resources>& resources) {
  try {
    now_.directory = std::make_shared<directory::Directory>(resources, std::make_shared<Starving>(terrain_, starves_));
  } catch (const std::runtime_error& e) {
    EXPECT_TRUE(disk_.isOff()) << e.what();
    return end(now_);
  }
  now_.directory->awaitDefault();
  now_.directory->join({.url = {},
                        .load = [] { return 0; },
                        .entry = [](const session::Session&) { return "{}"; },
                        .remove = [](const session::Session&, std::optional<std::uint64_t>) { ADD_FAILURE() << "nobody is removed"; },
                        .sendAway =
                            [](const session::Session& session) {
                              for (const auto& camera : session.live().all()) camera->goAway();
                            },
                        .leave = [] { ADD_FAILURE() << "the default session is one world"; }});
}

void Server::join(const std::string& name, const std::string& client, std::function<void(std::shared_ptr<session::Session>)> then,
                  std::uint32_t seed) {
  if (!takesMembers()) return then(nullptr);
  std::string target = "/v1/stream?session=" + name;
  if (name != directory::kDefaultName)
    target += "&terrain=" + std::string(terrain_->name()) + "&seed=" + std::to_string(seed == 0 ? terrain_->seed() : seed);
  http::Request request;
  request.method = "GET";
  request.target = target;
  request.upgrade = true;
  request.webSocketVersion = "13";
  request.client = client;
  http::Reply reply = http::streamAnswer(request, *now_.directory);
  auto* const later = std::get_if<http::DeferredResponse>(&reply);
  if (!later) return then(sessionOf(reply));
  joining_[++lastJoining_] = {std::move(*later), std::move(then)};
  poll(lastJoining_);
}

std::shared_ptr<session::Session> Server::sessionOf(const http::Reply& reply) const {
  if (const auto* answer = std::get_if<http::Answer>(&reply)) {
    EXPECT_TRUE(answer->status == 503 || answer->status == 409) << answer->body;
    return nullptr;
  }
  return takesMembers() ? std::get<http::Upgrade>(reply).session : nullptr;
}

// In turns, as its threads would.
void Server::poll(std::uint64_t joining) {
  timer_.at(timer_.now() + std::chrono::milliseconds(2), [this, joining, alive = now_.alive] {
    if (!*alive) return;
    http::Reply reply = joining_.at(joining).work.work({});
    if (std::holds_alternative<http::RetryAt>(reply)) return poll(joining);
    if (auto* const later = std::get_if<http::DeferredResponse>(&reply)) {
      joining_.at(joining).work = std::move(*later);
      return poll(joining);
    }
    joining_.extract(joining).mapped().then(sessionOf(reply));
  });
}

// What it has asked of the engine holds its edits and their files until the connection is taken for broken; a process has none then.
void Server::cease() {
  if (!now_.executor) return;
  if (isUp())
    for (const auto& session : now_.directory->all()) session->edits().end();
  now_.directory.reset();
  shared_->engine.end(*now_.bus);
  now_.executor.reset(), now_.writer.reset();  // with what waits in them
  auto gone = std::make_shared<Program>(std::exchange(now_, {}));
  gone_.push_back(gone);
  timer_.at(timer_.now() + kCeasing, [this, weak = std::weak_ptr(gone)] {
    const auto ended = weak.lock();
    if (!ended) return;
    std::erase(gone_, ended);
    const std::weak_ptr<bus::Bus> bus = ended->bus;
    ended->bus.reset();
    ended->resources.reset();
    EXPECT_TRUE(bus.expired()) << "something holds the bus of a server that is gone";
    end(*ended);
  });
}

void Server::keep(std::shared_ptr<void> what, Duration time) {
  timer_.at(timer_.now() + time, [this, weak = std::weak_ptr(what)] {
    if (const auto there = weak.lock()) kept_.erase(there);
  });
  kept_.insert(std::move(what));
}

void Server::drain() {
  takesMembers_ = false;
  Duration pause{};
  for (const auto& weak : lines_)
    if (const auto line = weak.lock()) line->sendAway(pause += std::chrono::milliseconds(5));
}

void Server::stopOther() { end(beside_); }

void Server::fall(bool withPower) {
  release();
  if (now_.bus && !withPower) shared_->engine.end(*now_.bus);
  if (withPower && now_.writer) {
    do {
      now_.writer->work();
      now_.executor->work();
    } while (now_.writer->queued() > 0);
  } else if (!isShared()) {
    disk_.cutPower();
  }
  if (now_.alive) *now_.alive = false;
  for (const auto& line : std::exchange(lines_, {}))
    if (const auto open = line.lock()) open->fall();
  for (auto& [number, joining] : std::exchange(joining_, {})) joining.then(nullptr);
  kept_.clear();
  const std::weak_ptr<session::Session> session = isUp() ? this->session() : nullptr;
  isShared() ? cease() : end(now_);
  if (!withPower) end(beside_);
  if (!isShared()) disk_.restorePower();
  EXPECT_TRUE(session.expired()) << "something holds the session of a server that is gone";
  for (auto& [name, open] : openEdits_) open = {};
  now_ = std::exchange(beside_, {});
}

void Server::add(const std::shared_ptr<Line>& line, const std::shared_ptr<member::CameraSession>& camera) {
  lines_.push_back(line);
  cameras_.push_back(camera);
}

bool Server::hasCameras() const {
  return !std::ranges::all_of(cameras_, [](const auto& camera) { return camera.expired(); });
}

void Server::settle() {
  if (isHeld_) return;
  work(now_);
  work(beside_);
}

void Server::work(Program& program) {
  if (!program.executor) return;
  *starves_ = timer_.now() < starvesUntil_;
  program.executor->work();
  for (; diskTime_ == Duration::zero() && program.writer->queued() > 0; program.executor->work()) program.writer->work();
  *starves_ = false;
  if (program.writer->queued() == 0 || std::exchange(program.isWriting, true)) return;
  timer_.at(timer_.now() + diskTime_, [this, alive = program.alive] {
    if (!*alive) return;
    Program& its = now_.alive == alive ? now_ : beside_;
    its.isWriting = false;
    its.writer->work();
  });
}

void Server::hold() {
  settle();
  isHeld_ = true;
}

}  // namespace ridgecast::simulation
