#include "client/connection/connection.h"

#include <condition_variable>
#include <mutex>
#include <utility>

#include "client/connection/dial.h"
#include "client/connection/websocket.h"

namespace ridgecast::connection {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

// Everything below `mutex_` is for both threads, the rest for the WebSocket's alone.
struct Connection::Impl final : WebSocket::Listener {
  Impl(const Url& url, wire::Hello hello, milliseconds timeout, const Waiting& waiting)
      : conversation_(std::move(hello), "the server at " + whereOf(url)), socket_(url, timeout, waiting, *this) {}

  // ---- owner's thread ----

  std::optional<Error> waitForWorld(const std::stop_token& stop) {
    socket_.start();
    const std::stop_callback stopped(stop, [this] { socket_.post([this] { socket_.giveUp(); }); });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return conversation_.hasWorld() || error_; });
    return conversation_.hasWorld() ? std::nullopt : error_;
  }

  // Where there still is somebody to say it to; what is wrong with it ends the connection.
  template <class Say>
  void say(const Say& what) {
    {
      const std::lock_guard lock(mutex_);
      if (error_) return;
      if (const core::Wrong wrong = what(conversation_)) {
        socket_.post([this, why = *wrong] { socket_.end(why); });
        return;
      }
    }
    socket_.post([this] { write(); });
  }

  template <class Reply, class Request>
  std::future<Outcome<Reply>> ask(Request request) {
    const auto promise = std::make_shared<std::promise<Outcome<Reply>>>();
    {
      const std::lock_guard lock(mutex_);
      if (error_)
        promise->set_value(*error_);
      else
        conversation_.ask(std::move(request), [promise](Outcome<Reply> reply) { promise->set_value(std::move(reply)); });
    }
    socket_.post([this] { write(); });
    return promise->get_future();
  }

  // What has been heard, looked at or taken.
  template <class Look>
  auto look(const Look& at) {
    const std::lock_guard lock(mutex_);
    return at(conversation_);
  }

  // ---- the WebSocket's thread ----

  void opened() override {
    writing_ = true;
    socket_.send(conversation_.hello());
  }

  void received(std::span<const std::uint8_t> frame) override {
    core::Wrong wrong;
    bool greeted = false;
    {
      const std::lock_guard lock(mutex_);
      greeted = !conversation_.hasWorld();
      wrong = conversation_.heard(frame, Clock::now());
      greeted = greeted && conversation_.hasWorld();
    }
    if (wrong) return socket_.end(*wrong);
    if (greeted) socket_.greeted();
    changed_.notify_all();
    write();
  }

  // One frame at a time.
  void write() {
    if (writing_) return;
    std::optional<std::string> frame;
    std::optional<Clock::time_point> due;
    {
      const std::lock_guard lock(mutex_);
      if (error_) return;
      frame = conversation_.next(Clock::now());
      due = conversation_.due();
    }
    writing_ = frame.has_value();
    if (frame)
      socket_.send(std::move(*frame));
    else if (due)
      socket_.after(std::chrono::ceil<milliseconds>(*due - Clock::now()), [this] { write(); });
  }

  void sent() override {
    writing_ = false;
    write();
  }

  void ended(std::string why) override {
    const std::lock_guard lock(mutex_);
    error_ = Error{std::move(why)};
    conversation_.end(*error_);
    changed_.notify_all();
  }

  bool writing_ = false;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Error> error_;
  core::Conversation conversation_;

  WebSocket socket_;  // last: its thread ends first
};

Outcome<std::unique_ptr<Connection>> Connection::open(const Url& url, const wire::Hello& hello, milliseconds timeout,
                                                      const Waiting& waiting) {
  std::unique_ptr<Connection> connection(new Connection(std::make_unique<Impl>(url, hello, timeout, waiting)));
  if (std::optional<Error> error = connection->impl_->waitForWorld(waiting.stop)) return *error;
  return connection;
}

Connection::Connection(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Connection::~Connection() {
  const std::lock_guard lock(impl_->mutex_);
  impl_->conversation_.end({"the connection was closed"});
}

const wire::World& Connection::world() const { return impl_->conversation_.world(); }
bool Connection::followsEdits() const { return impl_->conversation_.followsEdits(); }

using core::Conversation;

void Connection::send(const wire::PoseMessage& pose) {
  impl_->say([&](Conversation& c) { return c.send(pose); });
}
void Connection::acknowledge(const wire::Acknowledge& acknowledge) {
  impl_->say([&](Conversation& c) { return c.acknowledge(acknowledge); });
}
void Connection::resume(const wire::Resume& resume) {
  impl_->say([&](Conversation& c) { return c.resume(resume); });
}
void Connection::resend(const wire::ResendLeaves& resend) {
  impl_->say([&](Conversation& c) { return c.resend(resend); });
}
void Connection::change(const wire::Settings& settings) {
  impl_->say([&](Conversation& c) { return c.change(settings); });
}
void Connection::want(const wire::WantTiles& wanted) {
  impl_->say([&](Conversation& c) { return c.want(wanted); });
}
void Connection::want(const wire::WantSquares& wanted) {
  impl_->say([&](Conversation& c) { return c.want(wanted); });
}
void Connection::find(const wire::FindEdits& find) {
  impl_->say([&](Conversation& c) { return c.find(find); });
}
void Connection::setClock(const wire::SetClock& set) {
  impl_->say([&](Conversation& c) { return c.setClock(set); });
}
void Connection::step(const wire::ClockStep& step) {
  impl_->say([&](Conversation& c) { return c.step(step); });
}
void Connection::stepDone(const wire::StepDone& done) {
  impl_->say([&](Conversation& c) { return c.stepDone(done); });
}
void Connection::skipSteps(bool skips) {
  impl_->say([&](Conversation& c) { return c.skipSteps(skips); });
}
void Connection::passOver(std::uint64_t camera) {
  impl_->say([&](Conversation& c) { return c.passOver(camera); });
}

std::future<Outcome<wire::Answer>> Connection::ask(wire::Query query) { return impl_->ask<wire::Answer>(std::move(query)); }
std::future<Outcome<wire::Ground>> Connection::askGround(const wire::AskGround& ask) { return impl_->ask<wire::Ground>(ask); }
std::future<Outcome<wire::EditAnswer>> Connection::edit(wire::Edit edit) { return impl_->ask<wire::EditAnswer>(std::move(edit)); }

std::optional<core::Received> Connection::receive(milliseconds timeout) {
  std::unique_lock lock(impl_->mutex_);
  impl_->changed_.wait_for(lock, timeout, [&] { return impl_->conversation_.hasIterations() || impl_->error_; });
  return impl_->conversation_.receive();
}

bool Connection::waitForClock(std::uint64_t seen, milliseconds timeout) const {
  std::unique_lock lock(impl_->mutex_);
  const auto newer = [&] { return impl_->conversation_.clock().version() > seen; };
  impl_->changed_.wait_for(lock, timeout, [&] { return newer() || impl_->error_; });
  return newer();
}

std::optional<core::Roster> Connection::others(std::uint64_t seen) const {
  return impl_->look([&](const Conversation& c) { return c.roster().version() == seen ? std::nullopt : std::optional(c.roster()); });
}

std::vector<wire::MadeEdit> Connection::takeEdits() {
  return impl_->look([](Conversation& c) { return c.takeEdits(); });
}
std::vector<wire::HeightTile> Connection::takeTiles() {
  return impl_->look([](Conversation& c) { return c.takeTiles(); });
}
core::EditsFound Connection::takeEditsFound() {
  return impl_->look([](Conversation& c) { return c.takeEditsFound(); });
}
core::SessionClock Connection::clock() const {
  return impl_->look([](const Conversation& c) { return c.clock(); });
}
wire::Settings Connection::granted() const {
  return impl_->look([](const Conversation& c) { return c.granted(); });
}
std::optional<std::string> Connection::sentTo() const {
  return impl_->look([](const Conversation& c) { return c.sentTo(); });
}
std::uint64_t Connection::bytesReceived() const {
  return impl_->look([](const Conversation& c) { return c.bytes(); });
}
std::optional<Error> Connection::error() const {
  return impl_->look([this](const Conversation&) { return impl_->error_; });
}

}  // namespace ridgecast::connection
