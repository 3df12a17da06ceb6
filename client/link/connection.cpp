#include "client/link/connection.h"

#include <condition_variable>
#include <mutex>
#include <random>
#include <thread>
#include <type_traits>
#include <utility>

#include "client/link/websocket.h"
#include "common/outcome/contract.h"

namespace ridgecast::link {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;
using core::Conversation, core::Reconnector;

namespace {
constexpr std::chrono::seconds kTimeout{5};  // of each line but the first
}  // namespace

// Everything below `mutex_` is for both threads, the rest for the network's alone.
struct Connection::Impl final : WebSocket::Listener {
  Impl(const core::Url& url, const wire::Hello& hello, const Options& options, Resume resume)
      : options_(options),
        resume_(std::move(resume)),
        reconnector_(url, hello, options.reconnects ? core::Returns::kToItsWorld : core::Returns::kNever, std::random_device{}()) {}

  ~Impl() {
    {
      const std::lock_guard lock(mutex_);
      leaves_ = true;
      reconnector_.conversation().end({"the connection was closed"});
      if (socket_) socket_->part();
    }
    changed_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

  // ---- owner's thread ----

  std::optional<Error> waitForWorld() {
    thread_ = std::thread([this] { run(); });
    const std::stop_callback stopped(options_.waiting.stop, [this] {
      const std::lock_guard lock(mutex_);
      givesUp_ = !hasWorld();
      if (givesUp_ && socket_) socket_->giveUp();
      changed_.notify_all();
    });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return hasWorld() || reconnector_.lost(); });
    return hasWorld() ? std::nullopt : reconnector_.lost();
  }

  // Where there is somebody to say it to; what is wrong with it ends the line.
  template <class Say>
  void say(const Say& what) {
    const std::lock_guard lock(mutex_);
    if (reconnector_.lost() && isOfConversation<Say>) return;
    if (const core::Wrong wrong = to(what)) {
      if (socket_) socket_->post([this, why = *wrong] { socket_->end(why); });
    } else {
      wake();
    }
  }

  template <class Reply, class Request>
  std::future<Outcome<Reply>> ask(Request request) {
    const auto promise = std::make_shared<std::promise<Outcome<Reply>>>();
    const std::lock_guard lock(mutex_);
    reconnector_.conversation().ask(std::move(request), [promise](Outcome<Reply> reply) { promise->set_value(std::move(reply)); });
    wake();
    return promise->get_future();
  }

  // The owner is, under the lock: a line that ended is dialled again.
  void isThere() {
    if (reconnector_.lost() && !std::exchange(comesBack_, true)) changed_.notify_all();
  }

  std::optional<core::Received> receive(milliseconds timeout) {
    const auto until = Clock::now() + timeout;
    std::unique_lock lock(mutex_);
    const auto hasNews = [&] {
      isThere();
      const bool isOver = reconnector_.lost() && !reconnector_.comesBack();
      return reconnector_.conversation().hasIterations() || reconnector_.hasReturned() || isOver;
    };
    while (changed_.wait_until(lock, until, hasNews) && reconnector_.hasReturned()) {
      reconnector_.goOn(resume_ ? resume_(reconnector_.coming()) : std::vector<wire::Resume>());
      changed_.notify_all();
      wake();
    }
    return reconnector_.conversation().receive();
  }

  // What has been heard, looked at or taken.
  template <class Look>
  auto look(const Look& at) {
    const std::lock_guard lock(mutex_);
    return to(at);
  }

  // ---- with the lock ----

  // Of the two, what it takes.
  template <class What>
  static constexpr bool isOfConversation = std::is_invocable_v<const What&, Conversation&>;
  template <class What>
  auto to(const What& what) {
    if constexpr (isOfConversation<What>)
      return what(reconnector_.conversation());
    else
      return what(reconnector_);
  }

  bool hasWorld() const { return reconnector_.conversation().hasWorld(); }
  void wake() {
    if (socket_) socket_->post([this] { write(); });
  }

  // ---- the network's thread ----

  void run() {
    patience_ = Clock::now() + options_.waiting.heard;
    for (bool isFirst = true; const auto url = dial(); isFirst = false) {
      do {
        WebSocket socket(*url, isFirst ? options_.timeout : kTimeout, isFirst ? options_.waiting : Waiting(), *this);
        if (!hold(&socket)) return;
        socket.run();
        hold(nullptr);
      } while (waitsToDialAgain());
      patience_ = {};
    }
  }

  bool waitsToDialAgain() {
    std::unique_lock lock(mutex_);
    return again_ && (changed_.wait_until(lock, *std::exchange(again_, {}), [&] { return leaves_ || givesUp_; }), true);
  }

  // Waits until a line must be opened; nothing: the owner leaves.
  std::optional<core::Url> dial() {
    std::unique_lock lock(mutex_);
    for (;;) {
      if (leaves_) return std::nullopt;
      if (comesBack_)
        if (auto url = reconnector_.dial(Clock::now())) return url;
      if (const auto due = comesBack_ ? reconnector_.due() : std::nullopt)
        changed_.wait_until(lock, *due);
      else
        changed_.wait(lock);
    }
  }

  bool hold(WebSocket* socket) {
    const std::lock_guard lock(mutex_);
    expects(!socket || !socket_, "there is one line at a time");
    socket_ = socket;
    writing_ = false;
    if (socket && givesUp_) socket->giveUp();
    return !leaves_;
  }

  void opened() override {
    expects(!writing_, "nothing is sent before hello");
    writing_ = true;
    socket_->send(reconnector_.opened());
  }

  void received(std::span<const std::uint8_t> frame) override {
    core::Wrong wrong;
    bool greeted = false;
    {
      const std::lock_guard lock(mutex_);
      greeted = !reconnector_.isGreeted();
      wrong = reconnector_.heard(frame, Clock::now());
      greeted = greeted && reconnector_.isGreeted();
    }
    if (wrong) return socket_->end(*wrong);
    if (greeted) socket_->greeted();
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
      frame = reconnector_.next(Clock::now());
      due = reconnector_.due();
    }
    writing_ = frame.has_value();
    if (frame)
      socket_->send(std::move(*frame));
    else if (due)
      socket_->after(std::chrono::ceil<milliseconds>(*due - Clock::now()), [this] { write(); });
  }

  void sent() override {
    expects(writing_, "a frame that was sent was being written");
    writing_ = false;
    write();
  }

  void ended(std::string why, std::optional<std::chrono::seconds> retryAfter) override {
    const std::lock_guard lock(mutex_);
    if (retryAfter && !givesUp_ && Clock::now() + *retryAfter < patience_) {
      again_ = Clock::now() + *retryAfter;
      return;
    }
    reconnector_.ended({std::move(why)}, Clock::now());
    comesBack_ = false;
    changed_.notify_all();
  }

  const Options options_;
  const Resume resume_;
  bool writing_ = false;
  Clock::time_point patience_;              // of the first line, with a server that refuses for a while
  std::optional<Clock::time_point> again_;  // when to dial again, of that

  std::mutex mutex_;
  std::condition_variable changed_;
  Reconnector reconnector_;
  WebSocket* socket_ = nullptr;
  bool leaves_ = false, givesUp_ = false;
  bool comesBack_ = true;  // the owner has called receive() or wait() since the line ended

  std::thread thread_;
};

Outcome<std::unique_ptr<Connection>> Connection::open(const core::Url& url, const wire::Hello& hello, const Options& options,
                                                      Resume resume) {
  std::unique_ptr<Connection> connection(new Connection(std::make_unique<Impl>(url, hello, options, std::move(resume))));
  if (std::optional<Error> error = connection->impl_->waitForWorld()) return *error;
  return connection;
}

Connection::Connection(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Connection::~Connection() = default;

void Connection::send(const wire::PoseMessage& pose) {
  impl_->say([&](Reconnector& r) { return r.send(pose); });
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
  impl_->say([&](Reconnector& r) { return r.change(settings); });
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
  impl_->say([&](Reconnector& r) { return r.skipSteps(skips); });
}
void Connection::passOver(std::uint64_t camera) {
  impl_->say([&](Conversation& c) { return c.passOver(camera); });
}

std::future<Outcome<wire::Answer>> Connection::ask(wire::Query query) { return impl_->ask<wire::Answer>(std::move(query)); }
std::future<Outcome<wire::Ground>> Connection::askGround(const wire::AskGround& ask) { return impl_->ask<wire::Ground>(ask); }
std::future<Outcome<wire::EditAnswer>> Connection::edit(wire::Edit edit) { return impl_->ask<wire::EditAnswer>(std::move(edit)); }

std::optional<core::Received> Connection::receive(milliseconds timeout) { return impl_->receive(timeout); }

bool Connection::wait(milliseconds timeout, const std::function<bool(const Reconnector&)>& holds) const {
  std::unique_lock lock(impl_->mutex_);
  return impl_->changed_.wait_for(lock, timeout, [&] {
    impl_->isThere();
    return holds(impl_->reconnector_);
  });
}
bool Connection::waitForClock(std::uint64_t seen, milliseconds timeout) const {
  bool isNewer = false;
  wait(timeout, [&](const Reconnector& r) { return (isNewer = r.conversation().clock().version() > seen) || r.lost(); });
  return isNewer;
}

const wire::World& Connection::world() const { return impl_->reconnector_.conversation().world(); }
bool Connection::followsEdits() const { return impl_->reconnector_.conversation().followsEdits(); }

std::optional<core::Roster> Connection::others(std::uint64_t seen) const {
  return impl_->look([&](const Conversation& c) { return c.roster().version() == seen ? std::nullopt : std::optional(c.roster()); });
}

core::EditsMade Connection::takeEdits() {
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
std::optional<Error> Connection::error() const {
  return impl_->look([](const Reconnector& r) { return r.lost(); });
}
std::optional<std::string> Connection::sentTo() const {
  return impl_->look([](const Conversation& c) { return c.sentTo(); });
}
bool Connection::otherWorld() const {
  return impl_->look([](const Reconnector& r) { return r.otherWorld(); });
}
bool Connection::comesBack() const {
  return impl_->look([](const Reconnector& r) { return r.comesBack(); });
}
std::uint64_t Connection::reconnections() const {
  return impl_->look([](const Reconnector& r) { return r.reconnections(); });
}
std::uint64_t Connection::bytesReceived() const {
  return impl_->look([](const Reconnector& r) { return r.bytes(); });
}

}  // namespace ridgecast::link
