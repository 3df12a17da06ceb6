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
#include "tests/simulation/world.h"

namespace ridgecast::simulation {

// The simulation's, for as long as the server lives.
class Server::Clock final : public session::Timer {
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
  if (executor_) fall(false);
}

void Server::fill(std::uint64_t edits, lattice::Point near) {
  const auto log = edit_log::Log::create(folder() / (std::string(session::kDefaultName) + ".edits"),
                                         {std::string(terrain_->name()), terrain_->seed(), {}, terrain::contentHash(*terrain_)})
                       .value();
  edits::History history(terrain_);
  for (std::vector<session::Applied> group; edits > 0; group.clear()) {
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
  executor_ = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
  writer_ = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
  isWriting_ = false;
  alive_ = std::make_shared<bool>(true);
  for (auto& [session, open] : openEdits_) open = {};
  auto resources = std::make_shared<session::Resources>();
  resources->executor = executor_.get();
  resources->disk = writer_.get();
  resources->makeMesh = session::pipelineMeshes();
  resources->serverName = "simulated";
  resources->limits = limits_;
  resources->state = folder();
  resources->timer = std::make_unique<Clock>(timer_, alive_);
  try {
    directory_ = std::make_shared<session::Directory>(resources, std::make_shared<Starving>(terrain_, starves_));
  } catch (const std::runtime_error& e) {
    EXPECT_TRUE(disk_.isOff()) << e.what();
    fall(false);
  }
  return runs();
}

std::shared_ptr<session::Session> Server::enter(const std::string& name, Duration takes) {
  if (auto session = this->session(name)) return session;
  auto reservation = directory_->reserve(name);
  EXPECT_TRUE(reservation || disk_.isOff()) << reservation.error().message;
  if (!reservation || !*reservation) return nullptr;  // somebody is making it
  const auto make = [this](std::unique_ptr<session::Reservation> reserved) {
    const auto made = directory_->add(std::move(reserved), std::make_shared<Starving>(terrain_, starves_));
    EXPECT_TRUE(made || disk_.isOff()) << made.error().message;
    return made ? *made : nullptr;
  };
  if (takes == Duration::zero()) return make(std::move(*reservation));
  entering_[name] = std::move(*reservation);
  timer_.at(timer_.now() + takes, [this, name, make, alive = alive_] {
    if (*alive) make(std::move(entering_.extract(name).mapped()));
  });
  return nullptr;
}

void Server::fall(bool withPower) {
  if (withPower) {
    release();
    do {
      writer_->work();
      executor_->work();
    } while (writer_->queued() > 0);
  } else {
    disk_.cutPower();
  }
  *alive_ = false;
  for (const auto& line : std::exchange(lines_, {}))
    if (const auto open = line.lock()) open->fall();
  release();
  entering_.clear();
  const std::weak_ptr<session::Session> session = directory_ ? this->session() : nullptr;
  directory_.reset();
  executor_.reset();
  writer_.reset();
  disk_.restorePower();
  EXPECT_TRUE(session.expired()) << "something holds the session of a server that is gone";
}

void Server::add(const std::shared_ptr<Line>& line, const std::shared_ptr<session::CameraSession>& camera) {
  lines_.push_back(line);
  cameras_.push_back(camera);
}

bool Server::hasCameras() const {
  return !std::ranges::all_of(cameras_, [](const auto& camera) { return camera.expired(); });
}

void Server::settle() {
  if (!executor_ || isHeld_) return;
  *starves_ = timer_.now() < starvesUntil_;
  executor_->work();
  for (; diskTime_ == Duration::zero() && writer_->queued() > 0; executor_->work()) writer_->work();
  *starves_ = false;
  if (writer_->queued() == 0 || std::exchange(isWriting_, true)) return;
  timer_.at(timer_.now() + diskTime_, [this, alive = alive_] {
    if (!*alive) return;
    isWriting_ = false;
    writer_->work();
  });
}

void Server::hold() {
  settle();
  isHeld_ = true;
}

}  // namespace ridgecast::simulation
