#include "client/connection/reconnecting.h"

#include <algorithm>
#include <thread>
#include <utility>

namespace ridgecast::connection {

using namespace std::chrono_literals;

namespace {
constexpr auto kTimeout = 5s;  // of one attempt
}  // namespace

ReconnectingConnection::ReconnectingConnection(Url url, wire::Hello hello, Resume resume, bool reconnects,
                                               std::unique_ptr<Connection> connection)
    : url_(std::move(url)),
      target_(url_),
      hello_(std::move(hello)),
      resume_(std::move(resume)),
      reconnects_(reconnects),
      connection_(std::move(connection)) {}

Outcome<std::unique_ptr<ReconnectingConnection>> ReconnectingConnection::open(const Url& url, const wire::Hello& hello, Resume resume,
                                                                              const Options& options) {
  auto connection = Connection::open(url, hello, options.timeout, options.waiting);
  if (!connection) return connection.error();
  return std::unique_ptr<ReconnectingConnection>(
      new ReconnectingConnection(url, hello, std::move(resume), options.reconnects, std::move(*connection)));
}

void ReconnectingConnection::send(const wire::PoseMessage& pose) {
  pose_ = pose;
  connection_->send(pose);
}

void ReconnectingConnection::change(const wire::Settings& settings) {
  hello_.settings = settings;
  connection_->change(settings);
}

void ReconnectingConnection::skipSteps(bool skips) {
  skipsSteps_ = skips;
  connection_->skipSteps(skips);
}

std::future<Outcome<wire::Answer>> ReconnectingConnection::ask(wire::Query query) {
  const auto connection = [&] {
    const std::lock_guard lock(asks_);
    return connection_;
  }();
  return connection->ask(std::move(query));
}

std::vector<wire::MadeEdit> ReconnectingConnection::takeEdits() {
  const auto connection = [&] {
    const std::lock_guard lock(asks_);
    return connection_;
  }();
  return connection->takeEdits();
}

void ReconnectingConnection::pause() {
  const auto half = static_cast<unsigned>(pause_.count() / 2);
  next_ = Clock::now() + std::chrono::milliseconds(half + random_() % (half + 1));
  pause_ = std::min(2 * pause_, kLongestPause);
}

void ReconnectingConnection::noteLoss() {
  lost_ = connection_->error();
  if (!lost_) return;
  target_ = url_;
  if (const auto sentTo = connection_->sentTo(); sentTo && !sentTo->empty()) {
    const auto other = parseUrl(*sentTo);
    if (other && (other->secure || !url_.secure)) {  // a token and a mesh that were encrypted stay so
      target_.host = other->host;
      target_.port = other->port;
      target_.secure = other->secure;
      if (other->host != url_.host) target_.token.clear();  // given for the server that the user named
    }
  }
  pause();
}

void ReconnectingConnection::lookAfter() {
  if (!lost_) noteLoss();
  if (!lost_ || !comesBack()) return;
  if (!attempt_.valid()) {
    if (Clock::now() < next_) return;
    attempt_ = std::async(std::launch::async, [url = target_, hello = hello_, stop = stop_.get_token()] {
      return Connection::open(url, hello, kTimeout, {.stop = stop});
    });
  }
  if (attempt_.wait_for(0ms) != std::future_status::ready) return;
  if (auto opened = attempt_.get())
    return adopt(std::move(*opened));
  else
    lost_ = opened.error();
  target_ = url_;
  pause();
}

void ReconnectingConnection::adopt(std::unique_ptr<Connection> connection) {
  otherWorld_ = connection->world().contentHash != connection_->world().contentHash;
  if (otherWorld_) {
    lost_ = Error{"the server has another world now"};
    return;
  }
  bytesBefore_ += connection_->bytesReceived();
  std::shared_ptr<Connection> ended(std::move(connection));
  {
    const std::lock_guard lock(asks_);
    std::swap(connection_, ended);
  }
  connection_->skipSteps(skipsSteps_);
  lost_.reset();
  ++reconnections_;
  for (const wire::Resume& held : resume_()) connection_->resume(held);
  if (pose_) connection_->send(*pose_);
}

std::optional<core::Received> ReconnectingConnection::receive(std::chrono::milliseconds timeout) {
  const auto until = Clock::now() + timeout;
  const auto left = [&] { return std::max(std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()), 0ms); };
  for (;;) {
    // What came before the end is taken first.
    if (!lost_)
      if (auto received = connection_->receive(left())) return received;
    lookAfter();
    if (Clock::now() >= until || (lost_ && !comesBack())) return std::nullopt;
    if (lost_) std::this_thread::sleep_for(std::min(left(), 5ms));
  }
}

}  // namespace ridgecast::connection
