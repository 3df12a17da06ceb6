#include "tests/simulation/line.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "common/edits/author.h"
#include "server/presence/presence.h"
#include "tests/support/bytes.h"

namespace ridgecast::simulation {
namespace {

constexpr Duration kBuffered = std::chrono::milliseconds(1);  // how long what is sent without a limit takes to leave, at most

const std::string kQuestionAboutTheTime = wire::encode(wire::ClientMessage(wire::AskClock{})).substr(0, 1);  // the tag of its kind

}  // namespace

void Line::open(Server& server, const std::string& name, const std::string& client, const SimulatedTimer& timer, Way way, Take take,
                const Opened& opened, Duration entering) {
  if (!server.isShared())
    return opened(begin(server, name, client, timer, way, std::move(take), server.runs() ? server.enter(name, entering) : nullptr));
  server.join(name, client, [&server, name, client, &timer, way, take = std::move(take), opened](const auto& session) {
    opened(begin(server, name, client, timer, way, take, session && !session->isRetired() ? session : nullptr));
  });
}

std::shared_ptr<Line> Line::begin(Server& server, const std::string& name, const std::string& client, const SimulatedTimer& timer, Way way,
                                  Take take, const std::shared_ptr<session::Session>& session) {
  if (!session) return nullptr;
  auto place = session->enter(client);
  if (!place) return nullptr;
  auto line = std::make_shared<Line>(server, name, timer, way, std::move(take));
  line->author_ = client;
  line->camera_ = std::make_shared<member::CameraSession>(session, std::move(*place), server.directory()->nextCameraId(), line);
  server.add(line, line->camera_);
  return line;
}

void Line::say(std::string frame) {
  if (cut_) return;
  said_ = std::max(said_, timer_.now() + way_.delay);
  if (!frame.starts_with(kQuestionAboutTheTime)) quietFrom_ = std::max(quietFrom_, said_);
  timer_.at(said_, [self = shared_from_this(), bytes = std::move(frame)] {
    if (self->cut_ || self->fell_) return;
    auto heard = wire::decodeClient(testing_support::bytesOf(bytes));
    ASSERT_TRUE(heard) << heard.error().message;
    self->hear(std::move(*heard));
  });
}

void Line::hear(wire::ClientMessage message) {
  const auto* const edit = std::get_if<wire::Edit>(&message);
  const std::uint64_t id = edit ? edit->id : 0;
  if (edit) opens(*edit);
  if (const auto* hello = std::get_if<wire::Hello>(&message)) {
    isLockstep_ = hello->pacing == wire::Pacing::kLockstep;
    author_ = edits::toText({author_, hello->clientName});
  }
  if (const auto* pose = std::get_if<wire::PoseMessage>(&message)) newestPose_ = pose->sequence;
  if (const auto* acknowledge = std::get_if<wire::Acknowledge>(&message)) acknowledged_ = acknowledge->iteration;
  if (camera_)
    camera_->receive(std::move(message));
  else
    failed_ = true;
  if (failed_) {
    if (edit) closes(id);  // it was refused with its sender, or nobody listens
    return;
  }
  EXPECT_LE(openEdits_, wire::kMaxEdits + 2) << "more edits of one client are open than there may be";
  const std::size_t claiming = server_.isShared() ? session::Session::kMaxClaiming : 0;
  EXPECT_LE(openEditsOfAll_.edits, static_cast<std::int64_t>(editing::Edits::kMaxWaiting + claiming))
      << "more edits wait than there may be";
}

void Line::opens(const wire::Edit& edit) {
  ++openEdits_;
  const std::string key = edit.key.empty() ? "" : author_ + '\n' + edit.key;
  keys_.emplace(edit.id, key);
  openEditsOfAll_.open(key);
}

void Line::closes(std::uint64_t edit) {
  const auto one = keys_.find(edit);
  if (one == keys_.end()) return;
  openEditsOfAll_.close(one->second);
  keys_.erase(one);
}

void Line::leaves(const wire::ServerMessage& message) {
  failed_ = failed_ || std::holds_alternative<wire::ErrorMessage>(message);
  if (const auto* ground = std::get_if<wire::Ground>(&message)) {
    EXPECT_EQ(ground->leaves.empty(), !ground->refusal.empty()) << ground->refusal;
  }
  const auto* answer = std::get_if<wire::EditAnswer>(&message);
  if (!answer) return;
  EXPECT_NE(answer->number == 0, answer->refusal.empty()) << answer->refusal;
  if (!server_.isShared() && answer->refusal.find("edits of this session wait") != std::string::npos) {
    EXPECT_EQ(openEditsOfAll_.edits, static_cast<std::int64_t>(editing::Edits::kMaxWaiting) + 1) << answer->refusal;
  }
  --openEdits_;
  closes(answer->id);
}

void Line::judge(const wire::Iteration& iteration) {
  EXPECT_LE(queued_, maxQueuedBytes_ + granted_) << "an iteration was made for a client that takes none";
  EXPECT_LE(iteration.number - acknowledged_, window_) << "more iterations than the window";
  const std::uint64_t before = std::exchange(edit_, iteration.edit);
  if (isLockstep_ || iteration.edit > before) return;  // new ground comes first
  EXPECT_EQ(iteration.poseSequence, newestPose_) << "an iteration was made for another pose than the newest";
}

void Line::cut(Duration unheard) {
  cut_ = true;
  timer_.at(timer_.now() + unheard, [self = shared_from_this()] {
    if (const auto camera = std::exchange(self->camera_, nullptr)) camera->close();
    self->stuck_.clear();
  });
}

void Line::fall() {
  camera_.reset();
  fell_ = timer_.now() + kBuffered;
}

// As net/stream.cpp does.
void Line::sendAway(Duration after) {
  const auto go = [weak = weak_from_this(), &timer = timer_] {
    timer.at(timer.now(), [weak] {
      if (const auto self = weak.lock()) self->goAway();
    });
  };
  timer_.at(timer_.now() + after, [self = shared_from_this(), go] {
    if (self->fell_ || !self->camera_) return;
    if (!self->camera_->handOver(go)) return go();
    self->timer_.at(self->timer_.now() + std::chrono::seconds(1), go);
  });
}

void Line::goAway() {
  if (fell_ || !camera_) return;
  send(wire::ErrorMessage{wire::ErrorCode::kGoingAway, "The server is leaving; connect again.", {}}, {});
  std::exchange(camera_, nullptr)->close();
}

void Line::send(wire::ServerMessage message, std::shared_ptr<const void> ticket) {
  if (server_.lostPower()) return;
  leaves(message);
  if (const auto* world = std::get_if<wire::World>(&message)) window_ = world->window;
  if (const auto* iteration = std::get_if<wire::Iteration>(&message)) judge(*iteration);
  const bool isMembers = std::holds_alternative<wire::Members>(message), isPage = std::holds_alternative<wire::Edited>(message);
  queuedPages_ += isPage;
  EXPECT_LE(queuedPages_, 1u) << "pages of edits wait for a client that does not read";
  queuedMembers_ += isMembers;
  EXPECT_LE(queuedMembers_, presence::Presence::kMaxQueued) << "news of members wait for a client behind others";
  auto bytes = std::make_shared<const std::string>(wire::encode(message));
  queued_ += bytes->size();
  granted_ = std::holds_alternative<wire::Granted>(message) ? bytes->size() : 0;
  if (cut_) return stuck_.push_back(std::move(ticket));
  left_ = std::max(left_, timer_.now()) +
          std::chrono::duration_cast<Duration>(std::chrono::duration<double>(bytes->size() / way_.bytesPerSecond));
  const auto* clock = std::get_if<wire::Clock>(&message);
  if (!clock || clock->echo == 0) quietFrom_ = std::max(quietFrom_, left_ + way_.delay);
  timer_.at(left_, [self = shared_from_this(), size = bytes->size(), ticket = std::move(ticket), isMembers, isPage] {
    if (self->cut_) return self->stuck_.push_back(ticket);
    self->queued_ -= size;
    self->queuedMembers_ -= isMembers;
    self->queuedPages_ -= isPage;
  });
  timer_.at(left_ + way_.delay, [self = shared_from_this(), bytes, left = left_] {
    if (self->cut_ || left > self->fell_.value_or(left)) return;
    self->take_(*bytes);
  });
}

}  // namespace ridgecast::simulation
