#include "client/connection/connection.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <functional>
#include <iterator>
#include <mutex>
#include <span>
#include <thread>
#include <utility>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/http/status.hpp>
#include <boost/beast/websocket.hpp>

#include "client/connection/asked.h"
#include "client/connection/line.h"
#include "common/wire/wire.h"

namespace ridgecast::connection {
namespace {

namespace net = boost::asio;
namespace websocket = boost::beast::websocket;
using boost::system::error_code;
using std::chrono::milliseconds;

constexpr milliseconds kPartingPatience{200};
constexpr std::chrono::seconds kSilence{30};  // without a word, ping or pong from the server

using Executor = net::io_context::executor_type;
using Resolver = net::ip::basic_resolver<net::ip::tcp, Executor>;
using Timer = net::basic_waitable_timer<std::chrono::steady_clock, net::wait_traits<std::chrono::steady_clock>, Executor>;

// One line of a text from the network, fit for a terminal.
std::string oneLine(std::string_view text) {
  std::string out(text.substr(0, std::min<std::size_t>(text.size(), 300)));
  for (char& c : out)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out;
}

}  // namespace

//   resolving -> connecting (-> securing) -> upgrading -> greeting -> streaming -> ended
// Every state may go to ended. All members below "network thread" are touched by that thread alone; those below "shared" under mutex_.
// Handlers hold a plain `this`: the destructor of Connection joins the thread first, and none of them runs after it.
struct Connection::Impl {
  enum class State { kResolving, kConnecting, kSecuring, kUpgrading, kGreeting, kStreaming, kEnded };

  Impl(Url url, wire::Hello hello, milliseconds patience, Waiting waiting)
      : url_(std::move(url)),
        hello_(std::move(hello)),
        patience_(patience),
        waiting_(std::move(waiting)),
        unheard_(makesWorld() ? std::max(patience, waiting_.unheard) : patience),
        resolver_(context_.get_executor()),
        socket_(context_.get_executor()),
        timer_(context_.get_executor()),
        askTimer_(context_.get_executor()) {}

  // ---- owner's thread ----

  void start() {
    net::post(context_, [this] { resolve(); });
    thread_ = std::thread([this] { context_.run(); });
  }

  void stop() {
    net::post(context_, [this] { part(); });
    thread_.join();
  }

  std::optional<Error> waitForWorld() {
    const std::stop_callback stopped(waiting_.stop, [this] { net::post(context_, [this] { giveUp(); }); });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return hasWorld_ || error_; });
    return hasWorld_ ? std::nullopt : error_;
  }

  void wake() {
    net::post(context_, [this] { write(); });
  }

  // ---- network thread: the way to the world ----

  bool makesWorld() const { return url_.world.find("terrain=") != std::string::npos; }

  // It ends here when what follows has not come within `patience`. A new limit replaces the last.
  void limit(milliseconds patience) {
    timer_.expires_after(patience);
    timer_.async_wait([this](error_code e) {
      if (!e) end(late());
    });
  }

  void giveUp() {
    if (state_ != State::kStreaming) end("gave up waiting for the server at " + where());
  }

  void resolve() {
    limit(patience_);
    resolver_.async_resolve(url_.host, url_.port, [this](error_code e, const Resolver::results_type& found) {
      if (state_ == State::kEnded) return;
      if (e) return end("the host '" + url_.host + "' is not known (" + e.message() + "); check the server's address");
      connect(found);
    });
  }

  void connect(const Resolver::results_type& found) {
    state_ = State::kConnecting;
    net::async_connect(socket_.next_layer().socket(), found, [this](error_code e, const net::ip::tcp::endpoint&) {
      if (state_ == State::kEnded) return;
      if (e == net::error::connection_refused)
        return end("no server at " + where() + "; start one with ridgecast-server --port " + url_.port);
      if (e) return end("no connection to " + where() + ": " + e.message());
      if (!url_.secure) return upgrade();
      state_ = State::kSecuring;
      socket_.next_layer().startTls(url_.host, url_.ca, [this](std::optional<std::string> wrong) {
        if (state_ == State::kEnded) return;
        wrong ? end("no secure connection to " + where() + ": " + *wrong) : upgrade();
      });
    });
  }

  void upgrade() {
    state_ = State::kUpgrading;
    error_code ignored;
    socket_.next_layer().socket().set_option(net::ip::tcp::no_delay(true), ignored);
    websocket::stream_base::timeout timeout;
    timeout.handshake_timeout = websocket::stream_base::none();  // timer_ ends it, and says why
    timeout.idle_timeout = kSilence;
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    socket_.set_option(websocket::stream_base::decorator([this](websocket::request_type& request) {
      request.set(boost::beast::http::field::user_agent, "ridgecast-client");
      request.set("Prefer", "progress");
      if (!url_.token.empty()) request.set(boost::beast::http::field::authorization, "Bearer " + url_.token);
    }));
    socket_.auto_fragment(false);
    socket_.binary(true);
    socket_.read_message_max(wire::kMaxServerMessageBytes);
    limit(unheard_);
    socket_.next_layer().passOverInterim([this] {
      heard_ = true;
      limit(waiting_.heard);
      if (waiting_.preparing) waiting_.preparing();
    });
    const std::string target = "/v1/stream?session=" + url_.session + (url_.world.empty() ? "" : "&" + url_.world);
    socket_.async_handshake(response_, where(), target, [this](error_code e) {
      if (state_ == State::kEnded) return;
      if (e) return end(notUpgraded(e));
      greet();
    });
  }

  std::string notUpgraded(const error_code& e) const {
    if (e == websocket::error::upgrade_declined) {
      std::string text = where() + " answered HTTP " + std::to_string(response_.result_int()) + " instead of opening a stream";
      const std::string body = oneLine(response_.body());
      if (!body.empty() && body.front() != '<') return text + ": " + body;
      return text + "; is there a ridgecast-server, and a session '" + url_.session + "'?";
    }
    if (heard_) return "the server at " + where() + " went away while it prepared the terrain (" + e.message() + "); try again";
    return "what answers at " + where() + " is no Ridgecast server (" + e.message() + "); check host and port";
  }

  void greet() {
    state_ = State::kGreeting;
    limit(patience_);
    writing_ = true;
    frame_ = wire::encode(wire::ClientMessage(hello_));
    socket_.async_write(net::buffer(frame_), [this](error_code e, std::size_t) { written(e); });
    read();
  }

  std::string late() const {
    const auto within = [](milliseconds patience) { return " within " + std::to_string(patience.count()) + " ms"; };
    if (state_ == State::kUpgrading && heard_)
      return "the server at " + where() + " began to prepare the terrain and said nothing more" + within(waiting_.heard) +
             "; try again later";
    switch (state_) {
      case State::kResolving:
        return "the host '" + url_.host + "' could not be looked up" + within(patience_) + "; check the server's address";
      case State::kConnecting:
        return "no answer from " + where() + within(patience_) + "; check host, port and firewall";
      default:
        return "what listens at " + where() + " did not answer like a Ridgecast server" +
               within(state_ == State::kUpgrading ? unheard_ : patience_) + "; check host and port";
    }
  }

  // ---- network thread: streaming ----

  void read() {
    socket_.async_read(buffer_, [this](error_code e, std::size_t) {
      if (state_ == State::kEnded) return;
      if (e) return end(readFailed(e));
      take();
    });
  }

  std::string readFailed(const error_code& e) const {
    if (e == websocket::error::closed) {
      const std::string reason = oneLine({socket_.reason().reason.data(), socket_.reason().reason.size()});
      return "the server at " + where() + " closed the connection" +
             (reason.empty() ? " (code " + std::to_string(socket_.reason().code) + ")" : ": " + reason);
    }
    if (e == boost::beast::error::timeout) return "the server at " + where() + " has been silent for too long";
    if (e == websocket::error::message_too_big) return "the server at " + where() + " sent a message of more than 256 MiB";
    if (e == net::error::eof || e == net::error::connection_reset || e == net::error::broken_pipe)
      return "the server at " + where() + " went away without a goodbye";
    return "the stream from " + where() + " broke: " + e.message();
  }

  void take() {
    const std::size_t size = buffer_.size();
    if (!socket_.got_binary()) return end("the server at " + where() + " sent text, the stream is binary; is it a Ridgecast server?");
    Outcome<wire::ServerMessage> message = wire::decodeServer({static_cast<const std::uint8_t*>(buffer_.data().data()), size});
    buffer_.clear();
    if (size > kRoomyFrame) buffer_.shrink_to_fit();  // one large frame must not hold its memory for good
    if (!message) return end("the server at " + where() + " sent what cannot be read: " + message.error().message);
    if (auto* error = std::get_if<wire::ErrorMessage>(&*message)) {
      if (error->code == wire::ErrorCode::kGoingAway) {
        const std::lock_guard lock(mutex_);
        sentTo_ = error->reconnectUrl;
      }
      return end("the server at " + where() + " says: " + oneLine(error->message));
    }
    if (auto* world = std::get_if<wire::World>(&*message)) {
      if (state_ != State::kGreeting) return end("the server at " + where() + " sent a second world");
      if (world->protocolVersion != wire::kProtocolVersion)
        return end("the server at " + where() + " speaks protocol version " + std::to_string(world->protocolVersion) + ", this client " +
                   std::to_string(wire::kProtocolVersion) + "; use equal versions of both");
      timer_.cancel();
      state_ = State::kStreaming;
      const std::lock_guard lock(mutex_);
      bytes_ += size;
      world_ = std::move(*world);
      granted_ = world_.settings;
      hasWorld_ = true;
      changed_.notify_all();
      if (hello_.clock && world_.revision >= 1) askClock(0);
    } else if (auto* tiles = std::get_if<wire::HeightTiles>(&*message)) {
      const std::lock_guard lock(mutex_);
      bytes_ += size;
      if (tiles->tiles.size() > unanswered_ - tiles_.size())
        return endLocked("the server at " + where() + " sent tiles of heights that were not asked for");
      std::move(tiles->tiles.begin(), tiles->tiles.end(), std::back_inserter(tiles_));
      changed_.notify_all();
    } else if (!std::holds_alternative<wire::Iteration>(*message)) {
      if (state_ != State::kStreaming) return end("the server at " + where() + " spoke of its session before its world");
      const std::lock_guard lock(mutex_);
      bytes_ += size;
      if (const auto wrong = takeNews(*message)) return endLocked("the server at " + where() + " sent what cannot be: " + *wrong);
      changed_.notify_all();
    } else {
      if (state_ != State::kStreaming) return end("the server at " + where() + " sent an iteration before its world");
      const std::lock_guard lock(mutex_);
      bytes_ += size;
      if (queue_.size() >= world_.window)
        return endLocked("the server at " + where() + " sent more than the " + std::to_string(world_.window) + " iterations it may");
      queue_.push_back({.iteration = std::get<wire::Iteration>(std::move(*message)), .bytes = size});
      changed_.notify_all();
    }
    write();
    read();
  }

  // Under the lock. What is wrong with it, if anything.
  std::optional<std::string> takeNews(wire::ServerMessage& message) {
    const auto now = std::chrono::steady_clock::now();
    if (const auto* members = std::get_if<wire::Members>(&message)) {
      if (const auto applied = roster_.apply(*members, now); !applied) return applied.error().message;
    } else if (const auto* clock = std::get_if<wire::Clock>(&message)) {
      clock_.hear(*clock, now);
    } else if (auto* answer = std::get_if<wire::Answer>(&message)) {
      if (!queries_.take(answer->id, std::move(*answer))) return "an answer to a query that was not asked";
    } else if (auto* ground = std::get_if<wire::Ground>(&message)) {
      if (!grounds_.take(ground->id, std::move(*ground))) return "a ground that was not asked for";
    } else if (const auto* granted = std::get_if<wire::Granted>(&message)) {
      granted_ = granted->settings;
    }
    return {};
  }

  // A few times at once, so that one question finds the way free, then every second.
  void askClock(int asked) {
    asks_ = true;
    askTimer_.expires_after(asked < kFirstAsks ? kFirstAskPause : kAskPause);
    askTimer_.async_wait([this, asked](error_code e) {
      if (e || state_ == State::kEnded) return;
      askClock(asked + 1);
      write();
    });
  }

  // One frame at a time; what is most urgent first.
  void write() {
    if (writing_ || state_ != State::kStreaming) return;
    {
      const std::lock_guard lock(mutex_);
      wire::ClientMessage message;
      if (asks_) {  // at once: the time on its way is what makes the answer unsure
        asks_ = false;
        message = clock_.ask(std::chrono::steady_clock::now());
      } else if (!resumes_.empty()) {
        message = std::move(resumes_.front());
        resumes_.pop_front();
      } else if (resend_) {  // before the hash that it explains
        message = *std::exchange(resend_, std::nullopt);
      } else if (acknowledge_) {
        message = *std::exchange(acknowledge_, std::nullopt);
      } else if (!wants_.empty()) {
        message = std::move(wants_.front());
        wants_.pop_front();
      } else if (settings_) {
        message = wire::ChangeSettings{*std::exchange(settings_, std::nullopt)};
      } else if (!poses_.empty()) {
        message = poses_.front();
        poses_.pop_front();
      } else if (!sayings_.empty()) {
        message = std::move(sayings_.front());
        sayings_.pop_front();
      } else if (auto query = queries_.next()) {
        message = std::move(*query);
      } else if (auto ask = grounds_.next()) {
        message = std::move(*ask);
      } else {
        return;
      }
      frame_ = wire::encode(message);
    }
    writing_ = true;
    socket_.async_write(net::buffer(frame_), [this](error_code e, std::size_t) { written(e); });
  }

  void written(error_code e) {
    writing_ = false;
    // A failed write is followed by a failed read, which knows better why: a server that refuses says so before it closes.
    if (!e) write();
  }

  // ---- network thread: the end ----

  void end(std::string why) {
    const std::lock_guard lock(mutex_);
    endLocked(std::move(why));
  }

  void endLocked(std::string why) {
    if (state_ == State::kEnded) return;
    state_ = State::kEnded;
    error_ = Error{std::move(why)};
    queries_.fail(*error_);
    grounds_.fail(*error_);
    changed_.notify_all();
    hangUp();
  }

  void hangUp() {
    timer_.cancel();
    askTimer_.cancel();
    resolver_.cancel();
    error_code ignored;
    socket_.next_layer().socket().close(ignored);
    context_.stop();  // or Beast's own timers would keep the thread until they expire
  }

  // Under the lock: why nothing can be asked, if so.
  std::optional<Error> deaf() const {
    if (error_) return error_;
    if (world_.revision < 1) return Error{"the server at " + where() + " is of a version that answers no queries"};
    return std::nullopt;
  }

  // The owner leaves: say goodbye when there is somebody to say it to, and do not wait long.
  void part() {
    if (state_ == State::kEnded) return;
    {
      const std::lock_guard lock(mutex_);
      queries_.fail({"the connection was closed"});
      grounds_.fail({"the connection was closed"});
    }
    const bool polite = state_ == State::kGreeting || state_ == State::kStreaming;
    state_ = State::kEnded;
    if (!polite) return hangUp();
    timer_.expires_after(kPartingPatience);
    timer_.async_wait([this](error_code) { hangUp(); });
    socket_.async_close(websocket::close_code::normal, [this](error_code) { hangUp(); });
  }

  std::string where() const { return (url_.host.find(':') == std::string::npos ? url_.host : "[" + url_.host + "]") + ":" + url_.port; }

  void say(wire::ClientMessage message) {
    {
      const std::lock_guard lock(mutex_);
      if (sayings_.size() >= kMaxSayings) {
        net::post(context_, [this] { end(std::to_string(kMaxSayings) + " messages wait to leave: the server does not read"); });
        return;
      }
      sayings_.push_back(std::move(message));
    }
    wake();
  }

  static constexpr std::size_t kRoomyFrame = std::size_t{4} << 20;
  static constexpr int kFirstAsks = 5;
  static constexpr milliseconds kFirstAskPause{20}, kAskPause{1000};

  const Url url_;
  const wire::Hello hello_;
  const milliseconds patience_;
  const Waiting waiting_;
  const milliseconds unheard_;  // for the answer to the upgrade
  net::io_context context_{1};
  std::thread thread_;

  // network thread
  State state_ = State::kResolving;
  Resolver resolver_;
  websocket::stream<Line, false> socket_;
  Timer timer_, askTimer_;
  websocket::response_type response_;
  boost::beast::flat_buffer buffer_;
  std::string frame_;  // being written
  bool writing_ = false;
  bool heard_ = false;  // that the server prepares the world
  bool asks_ = false;   // a question for the clock is to be sent

  // shared
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool hasWorld_ = false;
  wire::World world_;  // constant once hasWorld_
  std::optional<Error> error_;
  std::optional<std::string> sentTo_;
  std::deque<Received> queue_;
  std::uint64_t bytes_ = 0;
  std::deque<wire::PoseMessage> poses_;
  std::deque<wire::Resume> resumes_;     // the owner's scene bounds them
  std::deque<wire::WantTiles> wants_;    // bounded by what may be unanswered
  std::vector<wire::HeightTile> tiles_;  // that came
  std::size_t unanswered_ = 0;           // wanted and not taken, tiles_ included
  std::optional<wire::Acknowledge> acknowledge_;
  std::optional<wire::ResendLeaves> resend_;
  std::optional<wire::Settings> settings_;  // to leave
  wire::Settings granted_;
  std::deque<wire::ClientMessage> sayings_;
  Roster roster_;
  SessionClock clock_;
  Asked<wire::Query, wire::Answer> queries_{wire::kMaxQueries, kMaxSayings};
  Asked<wire::AskGround, wire::Ground> grounds_{wire::kMaxGrounds, kMaxSayings};
};

Outcome<std::unique_ptr<Connection>> Connection::open(const Url& url, const wire::Hello& hello, milliseconds patience,
                                                      const Waiting& waiting) {
  std::unique_ptr<Connection> connection(new Connection(std::make_unique<Impl>(url, hello, patience, waiting)));
  connection->impl_->start();
  if (std::optional<Error> error = connection->impl_->waitForWorld()) return *error;
  return connection;
}

Connection::Connection(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Connection::~Connection() { impl_->stop(); }

const wire::World& Connection::world() const { return impl_->world_; }

void Connection::send(const wire::PoseMessage& pose) {
  {
    const std::lock_guard lock(impl_->mutex_);
    if (impl_->hello_.pacing == wire::Pacing::kFree) impl_->poses_.clear();
    if (impl_->poses_.size() >= kMaxPoses) {
      net::post(impl_->context_,
                [impl = impl_.get()] { impl->end(std::to_string(kMaxPoses) + " poses wait to leave: the server does not read"); });
      return;
    }
    impl_->poses_.push_back(pose);
  }
  impl_->wake();
}

void Connection::acknowledge(const wire::Acknowledge& acknowledge) {
  {
    const std::lock_guard lock(impl_->mutex_);
    impl_->acknowledge_ = acknowledge;
  }
  impl_->wake();
}

void Connection::resume(const wire::Resume& resume) {
  {
    const std::lock_guard lock(impl_->mutex_);
    impl_->resumes_.push_back(resume);
  }
  impl_->wake();
}

void Connection::resend(const wire::ResendLeaves& resend) {
  {
    const std::lock_guard lock(impl_->mutex_);
    std::optional<wire::ResendLeaves>& waiting = impl_->resend_;
    const bool all = resend.leaves.empty() || (waiting && waiting->leaves.empty());
    if (!waiting) waiting.emplace();
    waiting->leaves.insert(waiting->leaves.end(), resend.leaves.begin(), resend.leaves.end());
    if (all || waiting->leaves.size() > wire::kMaxResendLeaves) waiting->leaves.clear();
  }
  impl_->wake();
}

void Connection::want(const wire::WantTiles& wanted) {
  {
    const std::lock_guard lock(impl_->mutex_);
    impl_->unanswered_ += wanted.tiles.size();
    impl_->wants_.push_back(wanted);
  }
  impl_->wake();
}

std::vector<wire::HeightTile> Connection::takeTiles() {
  const std::lock_guard lock(impl_->mutex_);
  impl_->unanswered_ -= impl_->tiles_.size();
  return std::exchange(impl_->tiles_, {});
}

std::optional<Received> Connection::receive(milliseconds patience) {
  std::unique_lock lock(impl_->mutex_);
  impl_->changed_.wait_for(lock, patience, [&] { return !impl_->queue_.empty() || impl_->error_; });
  if (impl_->queue_.empty()) return std::nullopt;
  Received received = std::move(impl_->queue_.front());
  impl_->queue_.pop_front();
  return received;
}

std::optional<Roster> Connection::others(std::uint64_t seen) const {
  const std::lock_guard lock(impl_->mutex_);
  if (impl_->roster_.version() == seen) return std::nullopt;
  return impl_->roster_;
}

SessionClock Connection::clock() const {
  const std::lock_guard lock(impl_->mutex_);
  return impl_->clock_;
}

bool Connection::waitForClock(std::uint64_t seen, milliseconds patience) const {
  std::unique_lock lock(impl_->mutex_);
  impl_->changed_.wait_for(lock, patience, [&] { return impl_->clock_.version() > seen || impl_->error_; });
  return impl_->clock_.version() > seen;
}

void Connection::setClock(const wire::SetClock& set) { impl_->say(set); }
void Connection::step(const wire::Step& step) { impl_->say(step); }
void Connection::stepDone(const wire::StepDone& done) { impl_->say(done); }

std::future<Outcome<wire::Answer>> Connection::ask(wire::Query query) {
  std::future<Outcome<wire::Answer>> future;
  {
    const std::lock_guard lock(impl_->mutex_);
    future = impl_->queries_.add(std::move(query), impl_->deaf());
  }
  impl_->wake();
  return future;
}

std::future<Outcome<wire::Ground>> Connection::askGround(const wire::AskGround& ask) {
  std::future<Outcome<wire::Ground>> future;
  {
    const std::lock_guard lock(impl_->mutex_);
    future = impl_->grounds_.add(ask, impl_->deaf());
  }
  impl_->wake();
  return future;
}

void Connection::change(const wire::Settings& settings) {
  {
    const std::lock_guard lock(impl_->mutex_);
    if (impl_->world_.revision < 2) return;
    impl_->settings_ = settings;
  }
  impl_->wake();
}

wire::Settings Connection::granted() const {
  const std::lock_guard lock(impl_->mutex_);
  return impl_->granted_;
}

std::optional<Error> Connection::error() const {
  const std::lock_guard lock(impl_->mutex_);
  return impl_->error_;
}

std::optional<std::string> Connection::sentTo() const {
  const std::lock_guard lock(impl_->mutex_);
  return impl_->sentTo_;
}

std::uint64_t Connection::bytesReceived() const {
  const std::lock_guard lock(impl_->mutex_);
  return impl_->bytes_;
}

}  // namespace ridgecast::connection
