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
               std::uint64_t seed)
    : terrain_(std::move(terrain)),
      limits_(limits),
      timer_(timer),
      random_(seed),
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

bool Server::start() {
  if (isUp() && !runs()) return false;  // a third server might take the session that the second waits for, and members would not know
  Program& program = isUp() ? beside_ : now_;
  if (program.directory) return true;
  program.executor = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
  program.writer = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
  program.alive = std::make_shared<bool>(true);
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
  resources->timer = std::make_unique<Clock>(timer_, program.alive);
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
  if (!program.executor) return;
  *program.alive = false;
  program.entering.clear();
  program.directory.reset();
  program = {};
}

void Server::stopOther() { end(beside_); }

void Server::fall(bool withPower) {
  release();
  if (withPower) {
    do {
      now_.writer->work();
      now_.executor->work();
    } while (now_.writer->queued() > 0);
  } else {
    disk_.cutPower();
  }
  if (now_.alive) *now_.alive = false;
  for (const auto& line : std::exchange(lines_, {}))
    if (const auto open = line.lock()) open->fall();
  const std::weak_ptr<session::Session> session = isUp() ? this->session() : nullptr;
  end(now_);
  if (!withPower) end(beside_);
  disk_.restorePower();
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
