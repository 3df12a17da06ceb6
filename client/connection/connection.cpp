#include "client/connection/connection.h"

#include <condition_variable>
#include <deque>
#include <iterator>
#include <mutex>
#include <utility>

#include "client/connection/outbox.h"
#include "client/connection/websocket.h"
#include "common/wire/wire.h"

namespace ridgecast::connection {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

namespace {

// The session's clock is requested a few times at once, so that one request finds the way free, then every second.
constexpr int kFirstRequests = 5;
constexpr milliseconds kFirstPause{20}, kPause{1000};

}  // namespace

// Everything below `mutex_` is for both threads, the rest for the WebSocket's alone.
struct Connection::Impl final : WebSocket::Listener {
  Impl(const Url& url, wire::Hello hello, milliseconds timeout, const Waiting& waiting)
      : hello_(std::move(hello)), outbox_(hello_.pacing), socket_(url, timeout, waiting, *this) {}

  // ---- owner's thread ----

  std::optional<Error> waitForWorld(const std::stop_token& stop) {
    socket_.start();
    const std::stop_callback stopped(stop, [this] { socket_.post([this] { socket_.giveUp(); }); });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return hasWorld_ || error_; });
    return hasWorld_ ? std::nullopt : error_;
  }

  // Changes the outbox, if there still is somebody to send to; what is wrong with it ends the connection.
  template <class Change>
  void put(const Change& change) {
    {
      const std::lock_guard lock(mutex_);
      if (error_) return;
      if (const std::optional<std::string> wrong = change()) {
        socket_.post([this, why = *wrong] { socket_.end(why); });
        return;
      }
    }
    socket_.post([this] { write(); });
  }

  template <class Message>
  void post(const Message& message) {
    put([&] { return outbox_.put(message), std::optional<std::string>(); });
  }
  void say(const wire::ClientMessage& message) {
    put([&] { return outbox_.put(message); });
  }

  template <class Requests, class Request>
  auto ask(Requests& requests, Request request, std::uint32_t revision = 1, const char* lacks = "answers no queries") {
    std::unique_lock lock(mutex_);
    std::optional<Error> refusal = error_;
    if (!refusal && world_.revision < revision) refusal = Error{"the server at " + socket_.where() + " is of a version that " + lacks};
    auto future = requests.add(std::move(request), refusal);
    lock.unlock();
    socket_.post([this] { write(); });
    return future;
  }

  template <class Value>
  Value copyOf(const Value& value) const {
    const std::lock_guard lock(mutex_);
    return value;
  }

  // ---- the WebSocket's thread ----

  void opened() override {
    writing_ = true;
    socket_.send(wire::encode(wire::ClientMessage(hello_)));
  }

  void received(std::span<const std::uint8_t> frame) override {
    auto message = wire::decodeServer(frame);
    const auto wrong =
        message ? take(*message, frame.size()) : std::optional("sent something that cannot be read: " + message.error().message);
    if (wrong) return socket_.end("the server at " + socket_.where() + " " + *wrong);
    write();
  }

  // What is wrong with the message, if anything.
  std::optional<std::string> take(wire::ServerMessage& message, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    if (const auto* error = std::get_if<wire::ErrorMessage>(&message)) {
      if (error->code == wire::ErrorCode::kGoingAway) sentTo_ = error->reconnectUrl;
      return "says: " + oneLine(error->message);
    }
    bytes_ += bytes;
    if (std::holds_alternative<wire::UnknownKind>(message)) return std::nullopt;
    auto* const world = std::get_if<wire::World>(&message);
    if (!world && !hasWorld_)
      return std::holds_alternative<wire::Iteration>(message) ? "sent an iteration before its world"
                                                              : "spoke of its session before its world";
    changed_.notify_all();
    if (world) return greet(std::move(*world));
    if (auto* answer = std::get_if<wire::Answer>(&message); answer && !outbox_.queries.take(answer->id, std::move(*answer)))
      return "broke the protocol: an answer to no query";
    if (auto* ground = std::get_if<wire::Ground>(&message); ground && !outbox_.grounds.take(ground->id, std::move(*ground)))
      return "broke the protocol: a ground that was not requested";
    if (auto* edit = std::get_if<wire::EditAnswer>(&message); edit && !outbox_.edits.take(edit->id, std::move(*edit)))
      return "broke the protocol: an answer to no edit";
    return keep(message, bytes);
  }

  // For the owner to take or look at. What is wrong with the message, if anything.
  std::optional<std::string> keep(wire::ServerMessage& message, std::uint64_t size) {
    const auto now = Clock::now();
    if (auto* iteration = std::get_if<wire::Iteration>(&message)) {
      if (iterations_.size() >= world_.window) return "sent more than the " + std::to_string(world_.window) + " iterations it may";
      if (waitingBytes_ + size > wire::kMaxServerMessageBytes) return "sent more than 256 MiB of iterations that nobody has taken yet";
      waitingBytes_ += size;
      iterations_.push_back({.iteration = std::move(*iteration), .bytes = size});
    } else if (auto* come = std::get_if<wire::HeightTiles>(&message)) {
      if (come->tiles.size() > unanswered_ - tiles_.size()) return "sent tiles of heights that were not requested";
      std::move(come->tiles.begin(), come->tiles.end(), std::back_inserter(tiles_));
    } else if (auto* squares = std::get_if<wire::Squares>(&message)) {
      if (squares->squares.size() > squaresOpen_) return "sent squares of edits that were not requested";
      squaresOpen_ -= squares->squares.size();
      found_.squares.push_back(std::move(*squares));
    } else if (auto* found = std::get_if<wire::FoundEdits>(&message)) {
      if (findsOpen_ == 0) return "broke the protocol: where edits are, without being asked";
      --findsOpen_;
      found_.found.push_back(std::move(*found));
    } else if (const auto* members = std::get_if<wire::Members>(&message)) {
      if (const auto applied = roster_.apply(*members, now); !applied) return "broke the protocol: " + applied.error().message;
    } else if (const auto* said = std::get_if<wire::Clock>(&message)) {
      clock_.hear(*said, now);
      return skipStep();
    } else if (auto* edited = std::get_if<wire::Edited>(&message)) {
      for (wire::MadeEdit& made : edited->edits) {
        if (!hello_.edits || made.number != lastEdit_ + 1) return "broke the protocol: edits that leave a gap, or that nobody wanted";
        if (edits_.size() >= Connection::kMaxEdits)
          return "sent more than " + std::to_string(Connection::kMaxEdits) + " edits that nobody has taken yet";
        lastEdit_ = made.number;
        edits_.push_back(std::move(made));
      }
    } else if (const auto* settings = std::get_if<wire::Granted>(&message)) {
      granted_ = settings->settings;
    }
    return std::nullopt;
  }

  std::optional<std::string> greet(wire::World&& world) {
    if (hasWorld_) return "sent a second world";
    if (world.protocolVersion != wire::kProtocolVersion)
      return "speaks protocol version " + std::to_string(world.protocolVersion) + ", this client " +
             std::to_string(wire::kProtocolVersion) + "; use equal versions of both";
    socket_.greeted();
    world_ = std::move(world);
    granted_ = world_.settings;
    lastEdit_ = std::max(lastEdit_, world_.compacted);
    hasWorld_ = true;
    if (hello_.clock && world_.revision >= 1) requestClock(0);
    return std::nullopt;
  }

  void requestClock(int earlier) {
    requestsClock_ = true;
    socket_.after(earlier < kFirstRequests ? kFirstPause : kPause, [this, earlier] {
      requestClock(earlier + 1);
      write();
    });
  }

  std::optional<std::string> skipStep() {
    if (!skipsSteps_ || !clock_.waitsFor(world_.camera)) return std::nullopt;
    return outbox_.put(wire::StepDone{clock_.said().step});
  }

  // One frame at a time.
  void write() {
    if (writing_) return;
    std::optional<wire::ClientMessage> message;
    {
      const std::lock_guard lock(mutex_);
      if (!hasWorld_ || error_) return;
      if (std::exchange(requestsClock_, false))  // at once: its time on the way makes the answer unsure
        message = clock_.ask(Clock::now());
      else
        message = outbox_.next();
      if (message && std::holds_alternative<wire::SetClock>(*message)) {
        clock_.setLeft();
        requestsClock_ = hello_.clock && world_.revision >= 1;
      }
    }
    if (!message) return;
    writing_ = true;
    socket_.send(wire::encode(*message));
  }

  void sent() override {
    writing_ = false;
    write();
  }

  void ended(std::string why) override {
    const std::lock_guard lock(mutex_);
    error_ = Error{std::move(why)};
    fail(*error_);
    changed_.notify_all();
  }

  void fail(const Error& error) {
    outbox_.queries.fail(error);
    outbox_.grounds.fail(error);
    outbox_.edits.fail(error);
  }

  const wire::Hello hello_;
  bool writing_ = false;
  bool requestsClock_ = false;  // with the next frame

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool hasWorld_ = false, skipsSteps_ = false;
  std::optional<Error> error_;
  std::optional<std::string> sentTo_;
  wire::World world_;
  wire::Settings granted_;
  std::deque<Received> iterations_;  // at most world_.window
  std::uint64_t waitingBytes_ = 0;   // of their frames, at most one of the largest
  std::size_t unanswered_ = 0;       // tiles that are requested and not taken, including those that came
  std::vector<wire::HeightTile> tiles_;
  std::size_t squaresOpen_ = 0, findsOpen_ = 0;  // requested and not answered
  Connection::EditsFound found_;
  std::uint64_t lastEdit_ = hello_.editsAfter;
  std::vector<wire::MadeEdit> edits_;
  Roster roster_;
  SessionClock clock_;
  std::uint64_t bytes_ = 0;
  Outbox outbox_;

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
  impl_->fail({"the connection was closed"});
}

const wire::World& Connection::world() const { return impl_->world_; }

void Connection::send(const wire::PoseMessage& pose) {
  impl_->put([&] { return impl_->outbox_.put(pose); });
}

void Connection::acknowledge(const wire::Acknowledge& acknowledge) { impl_->post(acknowledge); }
void Connection::resume(const wire::Resume& resume) { impl_->post(resume); }
void Connection::resend(const wire::ResendLeaves& resend) { impl_->post(resend); }
void Connection::change(const wire::Settings& settings) {
  if (world().revision >= 2) impl_->post(settings);
}

void Connection::want(const wire::WantTiles& wanted) {
  impl_->put([&] {
    impl_->unanswered_ += wanted.tiles.size();
    return impl_->outbox_.put(wanted), std::optional<std::string>();
  });
}

void Connection::want(const wire::WantSquares& wanted) {
  if (world().revision < 5) return;
  impl_->put([&] {
    impl_->squaresOpen_ += wanted.squares.size();
    return impl_->outbox_.put(wanted), std::optional<std::string>();
  });
}

void Connection::find(const wire::FindEdits& find) {
  if (world().revision < 5) return;
  impl_->put([&] {
    ++impl_->findsOpen_;
    return impl_->outbox_.put(find), std::optional<std::string>();
  });
}

void Connection::setClock(const wire::SetClock& set) {
  impl_->put([&] {
    impl_->clock_.set();
    return impl_->outbox_.put(set);
  });
}
void Connection::step(const wire::ClockStep& step) { impl_->say(step); }
void Connection::stepDone(const wire::StepDone& done) { impl_->say(done); }
void Connection::skipSteps(bool skips) {
  impl_->put([&] {
    impl_->skipsSteps_ = skips;
    return impl_->skipStep();
  });
}
void Connection::passOver(std::uint64_t camera) {
  if (world().revision >= 3) impl_->say(wire::PassOver{camera});
}

std::future<Outcome<wire::Answer>> Connection::ask(wire::Query query) { return impl_->ask(impl_->outbox_.queries, std::move(query)); }
std::future<Outcome<wire::Ground>> Connection::askGround(const wire::AskGround& ask) { return impl_->ask(impl_->outbox_.grounds, ask); }

std::future<Outcome<wire::EditAnswer>> Connection::edit(wire::Edit edit) {
  return impl_->ask(impl_->outbox_.edits, std::move(edit), 4, "knows no edits");
}

bool Connection::followsEdits() const { return impl_->hello_.edits || world().revision < 4; }

std::vector<wire::MadeEdit> Connection::takeEdits() {
  const std::lock_guard lock(impl_->mutex_);
  return std::exchange(impl_->edits_, {});
}

std::optional<Received> Connection::receive(milliseconds timeout) {
  std::unique_lock lock(impl_->mutex_);
  impl_->changed_.wait_for(lock, timeout, [&] { return !impl_->iterations_.empty() || impl_->error_; });
  if (impl_->iterations_.empty()) return std::nullopt;
  Received received = std::move(impl_->iterations_.front());
  impl_->iterations_.pop_front();
  impl_->waitingBytes_ -= received.bytes;
  return received;
}

bool Connection::waitForClock(std::uint64_t seen, milliseconds timeout) const {
  std::unique_lock lock(impl_->mutex_);
  const auto newer = [&] { return impl_->clock_.version() > seen; };
  impl_->changed_.wait_for(lock, timeout, [&] { return newer() || impl_->error_; });
  return newer();
}

std::optional<Roster> Connection::others(std::uint64_t seen) const {
  const std::lock_guard lock(impl_->mutex_);
  if (impl_->roster_.version() == seen) return std::nullopt;
  return impl_->roster_;
}

std::vector<wire::HeightTile> Connection::takeTiles() {
  const std::lock_guard lock(impl_->mutex_);
  impl_->unanswered_ -= impl_->tiles_.size();
  return std::exchange(impl_->tiles_, {});
}

Connection::EditsFound Connection::takeEditsFound() {
  const std::lock_guard lock(impl_->mutex_);
  return std::exchange(impl_->found_, {});
}

SessionClock Connection::clock() const { return impl_->copyOf(impl_->clock_); }
wire::Settings Connection::granted() const { return impl_->copyOf(impl_->granted_); }
std::optional<Error> Connection::error() const { return impl_->copyOf(impl_->error_); }
std::optional<std::string> Connection::sentTo() const { return impl_->copyOf(impl_->sentTo_); }
std::uint64_t Connection::bytesReceived() const { return impl_->copyOf(impl_->bytes_); }

}  // namespace ridgecast::connection
