#include "tests/simulation/line.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

namespace ridgecast::simulation {
namespace {

std::span<const std::uint8_t> bytesOf(const std::string& s) { return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()}; }

}  // namespace

std::shared_ptr<Line> Line::open(session::Directory& directory, const SimulatedTimer& timer, Way way, Take take) {
  const auto session = directory.find(session::kDefaultName);
  auto place = session->enter();
  if (!place) return nullptr;
  auto line = std::make_shared<Line>(timer, way, directory.resources().limits.maxQueuedBytes, std::move(take));
  line->camera_ = std::make_shared<session::CameraSession>(session, std::move(*place), directory.nextCameraId(), line);
  return line;
}

void Line::say(const wire::ClientMessage& message) {
  if (cut_) return;
  said_ = std::max(said_, timer_.now() + way_.delay);
  timer_.at(said_, [self = shared_from_this(), bytes = wire::encode(message)] {
    if (self->cut_) return;
    auto heard = wire::decodeClient(bytesOf(bytes));
    ASSERT_TRUE(heard) << heard.error().message;
    self->camera_->receive(std::move(*heard));
  });
}

void Line::cut(Duration unheard) {
  {
    const std::lock_guard lock(mutex_);
    cut_ = true;
  }
  timer_.at(timer_.now() + unheard, [self = shared_from_this()] {
    std::exchange(self->camera_, nullptr)->close();
    std::vector<std::shared_ptr<const void>> freed;  // destroyed without the lock
    const std::lock_guard lock(self->mutex_);
    freed.swap(self->stuck_);
  });
}

void Line::send(wire::ServerMessage message, std::shared_ptr<const void> ticket) {
  const std::lock_guard lock(mutex_);
  if (std::holds_alternative<wire::Iteration>(message)) {
    EXPECT_LE(queued_, maxQueuedBytes_) << "an iteration was made for a client that takes none";
  }
  auto bytes = std::make_shared<const std::string>(wire::encode(message));
  queued_ += bytes->size();
  if (cut_) return stuck_.push_back(std::move(ticket));
  left_ = std::max(left_, timer_.now()) +
          std::chrono::duration_cast<Duration>(std::chrono::duration<double>(bytes->size() / way_.bytesPerSecond));
  timer_.at(left_, [self = shared_from_this(), size = bytes->size(), ticket = std::move(ticket)] {
    const std::lock_guard hold(self->mutex_);
    if (self->cut_) return self->stuck_.push_back(ticket);
    self->queued_ -= size;
  });
  timer_.at(left_ + way_.delay, [self = shared_from_this(), bytes] {
    if (self->cut_) return;
    auto heard = wire::decodeServer(bytesOf(*bytes));
    ASSERT_TRUE(heard) << heard.error().message;
    self->take_(std::move(*heard));
  });
}

std::size_t Line::queuedBytes() const {
  const std::lock_guard lock(mutex_);
  return queued_;
}

}  // namespace ridgecast::simulation
