#include "tests/simulation/server.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "tests/simulation/line.h"

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
    directory_ = std::make_shared<session::Directory>(resources, terrain_);
  } catch (const std::runtime_error& e) {
    EXPECT_TRUE(disk_.isOff()) << e.what();
    fall(false);
  }
  return runs();
}

std::shared_ptr<session::Session> Server::enter(const std::string& name) {
  if (auto session = this->session(name)) return session;
  auto made = directory_->add(name, terrain_);
  return made ? *made : nullptr;
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
  executor_->work();
  for (; diskTime_ == Duration::zero() && writer_->queued() > 0; executor_->work()) writer_->work();
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
