#include "client/connection/resuming.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "common/wire/wire.h"

namespace ridgecast::connection {

using namespace std::chrono_literals;

namespace {
constexpr auto kFirstPatience = 10s;
}

Resuming::Resuming(Url url, wire::Hello hello, Held held, const Pauses& pauses, std::unique_ptr<Connection> connection)
    : url_(std::move(url)),
      target_(url_),
      hello_(std::move(hello)),
      held_(std::move(held)),
      pauses_(pauses),
      connection_(std::move(connection)),
      pause_(pauses.first) {}

Outcome<std::unique_ptr<Resuming>> Resuming::open(const Url& url, const wire::Hello& hello, Held held, const Pauses& pauses,
                                                  const Waiting& waiting) {
  auto connection = Connection::open(url, hello, kFirstPatience, waiting);
  if (!connection) return connection.error();
  return std::unique_ptr<Resuming>(new Resuming(url, hello, std::move(held), pauses, std::move(*connection)));
}

void Resuming::send(const wire::PoseMessage& pose) {
  pose_ = pose;
  if (!lost_) connection_->send(pose);
}
void Resuming::acknowledge(const wire::Acknowledge& acknowledge) {
  if (!lost_) connection_->acknowledge(acknowledge);
}
void Resuming::resend(const wire::ResendLeaves& resend) {
  if (!lost_) connection_->resend(resend);
}

void Resuming::change(const wire::Settings& settings) {
  hello_.settings = settings;
  if (!lost_) connection_->change(settings);
}

std::optional<Error> Resuming::error() const { return lost_; }

void Resuming::pause() {
  const auto half = static_cast<unsigned>(pause_.count() / 2);
  next_ = Clock::now() + std::chrono::milliseconds(half + random_() % (half + 1));
  pause_ = std::min(2 * pause_, pauses_.longest);
}

void Resuming::lookAfter() {
  if (!lost_) {
    lost_ = connection_->error();
    if (!lost_) return;
    target_ = url_;
    if (const auto sentTo = connection_->sentTo(); sentTo && !sentTo->empty()) {
      const auto other = parseUrl(*sentTo);
      if (other && (other->secure || !url_.secure)) {  // a token and a mesh that were encrypted stay so
        target_.host = other->host;
        target_.port = other->port;
        target_.secure = other->secure;
      }
    }
    pause();
  }
  if (!attempt_.valid()) {
    if (Clock::now() < next_) return;
    attempt_ = std::async(std::launch::async, [url = target_, hello = hello_, patience = pauses_.patience, stop = stop_.get_token()] {
      return Connection::open(url, hello, patience, {.stop = stop});
    });
  }
  if (attempt_.wait_for(0ms) != std::future_status::ready) return;
  auto opened = attempt_.get();
  if (!opened) {
    lost_ = opened.error();
    target_ = url_;
    pause();
    return;
  }
  bytesBefore_ += connection_->bytesReceived();
  connection_ = std::move(*opened);
  lost_.reset();
  pause_ = pauses_.first;
  ++reconnections_;
  const std::vector<wire::HeldLeaf> held = held_(connection_->world());
  for (std::size_t at = 0; at < held.size(); at += wire::kMaxResumeLeaves) {
    const auto end = std::min(held.size(), at + wire::kMaxResumeLeaves);
    connection_->resume({{held.begin() + static_cast<std::ptrdiff_t>(at), held.begin() + static_cast<std::ptrdiff_t>(end)}});
  }
  if (pose_) connection_->send(*pose_);
}

std::optional<Received> Resuming::receive(std::chrono::milliseconds patience) {
  const auto until = Clock::now() + patience;
  for (;;) {
    if (!lost_) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
      // What came before the end is taken first.
      if (auto received = connection_->receive(std::max(left, 0ms))) return received;
    }
    lookAfter();
    if (Clock::now() >= until) return std::nullopt;
    if (lost_)
      std::this_thread::sleep_for(std::clamp(std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()), 0ms, 5ms));
  }
}

}  // namespace ridgecast::connection
