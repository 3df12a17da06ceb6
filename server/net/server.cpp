#include "server/net/server.h"

#include <spdlog/spdlog.h>

#include <atomic>
#include <boost/asio/bind_executor.hpp>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/wire/wire.h"
#include "server/net/routes.h"
#include "server/session/camera_session.h"

namespace ridgecast::net {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using beast::error_code;

constexpr char kServerName[] = "ridgecast-server/" RIDGECAST_VERSION;
// Connections beyond the limit that are still told so, instead of being closed at once.
constexpr std::uint32_t kRefusedAtATime = 32;
// After an error the client has this long to take it and to answer the close.
constexpr std::chrono::seconds kFarewellPatience{3};
constexpr std::chrono::milliseconds kShutdownPatience{500};

class Stream;

// What all connections share. Outlives them.
struct Shared {
  explicit Shared(const Settings& s, std::shared_ptr<session::Directory> d) : settings(s), directory(std::move(d)) {}
  const Settings settings;
  const std::shared_ptr<session::Directory> directory;
  std::atomic<std::uint32_t> connections{0};

  std::mutex mutex;
  std::condition_variable fewerStreams;
  std::unordered_map<const Stream*, std::weak_ptr<Stream>> streams;
};

// Counts a connection for as long as it lives.
class Counted {
 public:
  explicit Counted(std::shared_ptr<Shared> shared) : shared_(std::move(shared)), rank_(++shared_->connections) {}
  Counted(Counted&&) = default;
  Counted& operator=(Counted&&) = delete;
  ~Counted() {
    if (shared_) --shared_->connections;
  }
  std::uint32_t rank() const { return rank_; }

 private:
  std::shared_ptr<Shared> shared_;
  std::uint32_t rank_;
};

std::string nameOf(const tcp::endpoint& endpoint) {
  const std::string address = endpoint.address().to_string();
  return (endpoint.address().is_v6() ? "[" + address + "]" : address) + ":" + std::to_string(endpoint.port());
}

websocket::close_reason closeReason(const wire::ErrorMessage& message, std::optional<websocket::close_code> code) {
  websocket::close_reason reason;
  switch (message.code) {
    case wire::ErrorCode::kVersion:
    case wire::ErrorCode::kMalformed:
      reason.code = websocket::close_code::protocol_error;
      break;
    case wire::ErrorCode::kInternal:
      reason.code = websocket::close_code::internal_error;
      break;
    default:
      reason.code = websocket::close_code::policy_error;
  }
  if (code) reason.code = *code;
  reason.reason =
      beast::string_view(message.message.data(), std::min<std::size_t>(message.message.size(), 120));  // a control frame has 125 bytes
  return reason;
}

// One client's stream. Everything runs on its strand but for the counter of queued bytes.
//
//   accepting -> open -> farewell (an error or the server's end: one last message, then the closing handshake) -> over
class Stream : public std::enable_shared_from_this<Stream> {
 public:
  Stream(beast::tcp_stream&& stream, Counted counted, std::shared_ptr<Shared> shared, std::shared_ptr<session::Session> session,
         std::string peer)
      : ws_(std::move(stream)),
        timer_(ws_.get_executor()),
        counted_(std::move(counted)),
        shared_(std::move(shared)),
        session_(std::move(session)),
        peer_(std::move(peer)) {}

  ~Stream() {
    const std::lock_guard lock(shared_->mutex);
    shared_->streams.erase(this);
    shared_->fewerStreams.notify_all();
  }

  void start(http::request<http::empty_body> request) {
    {
      const std::lock_guard lock(shared_->mutex);
      shared_->streams.emplace(this, weak_from_this());
    }
    request_ = std::move(request);
    beast::get_lowest_layer(ws_).expires_never();  // the stream has timeouts of its own
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = shared_->settings.patience;
    timeout.idle_timeout = shared_->settings.idle;
    timeout.keep_alive_pings = true;
    ws_.set_option(timeout);
    ws_.set_option(
        websocket::stream_base::decorator([](websocket::response_type& response) { response.set(http::field::server, kServerName); }));
    ws_.read_message_max(0);  // counted here, so that the client is told before it is closed
    ws_.auto_fragment(false);
    ws_.binary(true);
    ws_.async_accept(request_, [self = shared_from_this()](error_code ec) { self->accepted(ec); });
  }

  // Any thread.
  void post(std::string bytes) {
    asio::post(ws_.get_executor(), [self = shared_from_this(), bytes = std::move(bytes)]() mutable { self->enqueue(std::move(bytes)); });
  }
  void postFailure(wire::ErrorMessage message) {
    asio::post(ws_.get_executor(), [self = shared_from_this(), message = std::move(message)] { self->fail(message); });
  }
  void postGoingAway() {
    asio::post(ws_.get_executor(), [self = shared_from_this()] {
      self->farewell({}, {websocket::close_code::going_away, "The server shuts down."});
    });
  }
  const std::shared_ptr<std::atomic<std::size_t>>& queuedBytes() const { return queuedBytes_; }

 private:
  void accepted(error_code ec);

  void read() {
    const std::size_t room = wire::kMaxClientMessageBytes + 1 - buffer_.size();
    ws_.async_read_some(buffer_, room, [self = shared_from_this()](error_code ec, std::size_t) { self->hasRead(ec); });
  }

  void hasRead(error_code ec) {
    if (ec) return end();
    if (stage_ != Stage::kOpen) {  // what still arrives after an error is passed over
      buffer_.clear();
      return read();
    }
    if (buffer_.size() > wire::kMaxClientMessageBytes)
      return fail({wire::ErrorCode::kLimit,
                   "A message has more than " + std::to_string(wire::kMaxClientMessageBytes) + " bytes, the most there may be."},
                  websocket::close_code::too_big);
    if (!ws_.is_message_done()) return read();
    if (ws_.got_text())
      return fail({wire::ErrorCode::kMalformed, "A text message came; messages are binary, one protobuf ClientMessage each."},
                  websocket::close_code::unknown_data);
    const auto bytes = buffer_.cdata();
    auto message = wire::decodeClient({static_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    buffer_.clear();
    if (!message) return fail({wire::ErrorCode::kMalformed, message.error().message});
    if (!greeted_) {
      greeted_ = true;
      timer_.cancel();
      if (const auto* hello = std::get_if<wire::Hello>(&*message))
        spdlog::info("camera {}: {} says hello as '{}', protocol {}", camera_->id(), peer_, hello->clientName, hello->protocolVersion);
    }
    camera_->receive(std::move(*message));
    read();
  }

  void enqueue(std::string bytes) {
    if (stage_ != Stage::kOpen) {
      *queuedBytes_ -= bytes.size();
      return;
    }
    if (out_.size() >= kMaxQueuedMessages) {
      *queuedBytes_ -= bytes.size();
      return fail({wire::ErrorCode::kLimit, "Too much waits for this client."});
    }
    out_.push_back(std::move(bytes));
    if (!writing_) write();
  }

  void write() {
    writing_ = true;
    ws_.async_write(asio::buffer(out_.front()), [self = shared_from_this()](error_code ec, std::size_t) {
      self->writing_ = false;
      *self->queuedBytes_ -= self->out_.front().size();
      self->out_.pop_front();
      if (ec) return self->end();
      if (!self->out_.empty()) return self->write();
      if (self->stage_ == Stage::kFarewell) self->sayClose();
    });
  }

  void fail(const wire::ErrorMessage& message, std::optional<websocket::close_code> code = {}) {
    if (stage_ != Stage::kOpen) return;
    spdlog::info("camera {}: {} is sent away: {}", camera_ ? camera_->id() : 0, peer_, message.message);
    farewell(wire::encode(wire::ServerMessage(message)), closeReason(message, code));
  }

  // One last message, when there is one, then the closing handshake.
  void farewell(std::string last, websocket::close_reason reason) {
    if (stage_ == Stage::kAccepting) return end();
    if (stage_ != Stage::kOpen) return;
    stage_ = Stage::kFarewell;
    reason_ = std::move(reason);
    leave();
    while (out_.size() > (writing_ ? 1u : 0u)) {
      *queuedBytes_ -= out_.back().size();
      out_.pop_back();
    }
    timer_.expires_after(kFarewellPatience);
    timer_.async_wait([weak = weak_from_this()](error_code ec) {
      if (ec) return;
      if (auto self = weak.lock()) self->end();
    });
    if (!last.empty()) {
      *queuedBytes_ += last.size();
      out_.push_back(std::move(last));
    }
    if (writing_) return;
    out_.empty() ? sayClose() : write();
  }

  void sayClose() {
    ws_.async_close(reason_, [self = shared_from_this()](error_code) { self->end(); });
  }

  // Gives the camera's place back.
  void leave() {
    if (camera_) camera_->close();
    camera_.reset();
  }

  void end() {
    if (stage_ == Stage::kOver) return;
    stage_ = Stage::kOver;
    timer_.cancel();
    if (camera_) spdlog::info("camera {}: {} is gone", camera_->id(), peer_);
    leave();
    beast::get_lowest_layer(ws_).close();
  }

  enum class Stage { kAccepting, kOpen, kFarewell, kOver };

  websocket::stream<beast::tcp_stream, false> ws_;
  asio::steady_timer timer_;
  const Counted counted_;
  const std::shared_ptr<Shared> shared_;
  const std::shared_ptr<session::Session> session_;
  const std::string peer_;
  http::request<http::empty_body> request_;
  Stage stage_ = Stage::kAccepting;
  std::shared_ptr<session::CameraSession> camera_;
  beast::flat_buffer buffer_;
  bool greeted_ = false;
  std::deque<std::string> out_;  // at most kMaxQueuedMessages; the first is being written while writing_
  bool writing_ = false;
  websocket::close_reason reason_;
  std::shared_ptr<std::atomic<std::size_t>> queuedBytes_ = std::make_shared<std::atomic<std::size_t>>(0);
};

// A camera session's way to its client. Messages are encoded here, on the thread that sends: a camera's pool.
class StreamSender final : public session::Sender {
 public:
  explicit StreamSender(const std::shared_ptr<Stream>& stream) : stream_(stream), queuedBytes_(stream->queuedBytes()) {}

  void send(wire::ServerMessage message) override {
    const auto stream = stream_.lock();
    if (!stream) return;
    std::string bytes = wire::encode(message);
    *queuedBytes_ += bytes.size();
    stream->post(std::move(bytes));
  }
  std::size_t queuedBytes() const override { return *queuedBytes_; }
  void fail(wire::ErrorMessage message) override {
    if (const auto stream = stream_.lock()) stream->postFailure(std::move(message));
  }

 private:
  const std::weak_ptr<Stream> stream_;
  const std::shared_ptr<std::atomic<std::size_t>> queuedBytes_;
};

void Stream::accepted(error_code ec) {
  if (ec || stage_ != Stage::kAccepting) return end();
  stage_ = Stage::kOpen;
  auto place = session_->enter();
  if (!place) return fail({wire::ErrorCode::kLimit, place.error().message});
  camera_ = std::make_shared<session::CameraSession>(session_, std::move(*place), shared_->directory->nextCameraId(),
                                                     std::make_shared<StreamSender>(shared_from_this()));
  timer_.expires_after(shared_->settings.patience);
  timer_.async_wait([weak = weak_from_this()](error_code waited) {
    if (waited) return;
    const auto self = weak.lock();
    if (self && !self->greeted_)
      self->fail({wire::ErrorCode::kLimit, "No hello came within " + std::to_string(self->shared_->settings.patience.count()) + " ms."},
                 websocket::close_code::policy_error);
  });
  read();
}

// A connection before it is a stream: requests and answers, one after the other.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(tcp::socket&& socket, Counted counted, std::shared_ptr<Shared> shared)
      : stream_(std::move(socket)),
        counted_(std::move(counted)),
        shared_(std::move(shared)),
        buffer_(shared_->settings.maxHeaderBytes + 4096) {}

  void start() {
    error_code ignored;
    stream_.socket().set_option(tcp::no_delay(true), ignored);
    asio::dispatch(stream_.get_executor(), [self = shared_from_this()] { self->read(); });
  }

 private:
  void read() {
    parser_.emplace();
    parser_->header_limit(shared_->settings.maxHeaderBytes);
    stream_.expires_after(shared_->settings.patience);
    http::async_read_header(stream_, buffer_, *parser_, [self = shared_from_this()](error_code ec, std::size_t) { self->hasRead(ec); });
  }

  void hasRead(error_code ec) {
    if (ec == http::error::header_limit || ec == http::error::buffer_overflow)
      return refuse(
          431, "The request's header has more than " + std::to_string(shared_->settings.maxHeaderBytes) + " bytes, the most there may be.");
    if (ec && ec != http::error::end_of_stream && ec != http::error::partial_message &&
        ec.category() == http::make_error_code(http::error::bad_method).category())
      return refuse(400, "This is no HTTP request (" + ec.message() + ").");
    if (ec) return close();
    if (counted_.rank() > shared_->settings.maxConnections)
      return refuse(
          503, "This server has " + std::to_string(shared_->settings.maxConnections) + " connections, the most it takes; try again later.");

    const auto& header = parser_->get();
    Request request;
    request.method = view(header.method_string());
    request.target = view(header.target());
    request.host = view(header[http::field::host]);
    request.upgrade = websocket::is_upgrade(header);
    request.webSocketVersion = view(header[http::field::sec_websocket_version]);
    Answer a = answer(request, *shared_->directory, RIDGECAST_VERSION);
    const bool hasBody = parser_->chunked() || parser_->content_length().value_or(0) > 0;
    if (a.upgradeTo && (hasBody || buffer_.size() > 0)) return refuse(400, "Something follows the request before the upgrade is answered.");
    if (!a.upgradeTo) return send(a, header.keep_alive() && !hasBody && ++answered_ < 1000, header.method() == http::verb::head);

    error_code ignored;
    const auto endpoint = stream_.socket().remote_endpoint(ignored);
    auto session = std::move(a.upgradeTo);
    std::make_shared<Stream>(std::move(stream_), std::move(counted_), shared_, std::move(session), nameOf(endpoint))
        ->start(parser_->release());
  }

  void refuse(unsigned status, std::string sentence) {
    Answer a;
    a.status = status;
    a.body = std::move(sentence) + "\n";
    send(a, false, false);
  }

  void send(const Answer& a, bool keepAlive, bool head) {
    http::response<http::string_body> response(static_cast<http::status>(a.status), 11);
    response.set(http::field::server, kServerName);
    response.set(http::field::content_type, a.type);
    response.set(http::field::cache_control, "no-store");
    response.set("X-Content-Type-Options", "nosniff");
    response.keep_alive(keepAlive);
    for (const auto& [name, value] : a.headers) response.set(name, value);
    response.body() = a.body;
    response.prepare_payload();
    if (head) response.body().clear();
    response_ = std::move(response);
    serializer_.emplace(response_);
    serializer_->split(head);
    stream_.expires_after(shared_->settings.patience);
    const auto done = [self = shared_from_this(), keepAlive](error_code ec, std::size_t) {
      if (ec) return self->close();
      keepAlive ? self->read() : self->closePolitely();
    };
    if (head)
      http::async_write_header(stream_, *serializer_, done);
    else
      http::async_write(stream_, *serializer_, done);
  }

  // Says that nothing follows and passes over what the client still sends for a moment: closing with unread bytes would reset the
  // connection and could take the answer with it.
  void closePolitely() {
    error_code ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_.expires_after(std::chrono::seconds(1));
    drain(64);
  }
  void drain(int more) {
    buffer_.clear();
    stream_.async_read_some(buffer_.prepare(4096), [self = shared_from_this(), more](error_code ec, std::size_t) {
      ec || more == 0 ? self->close() : self->drain(more - 1);
    });
  }
  void close() { stream_.close(); }

  static std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

  beast::tcp_stream stream_;
  Counted counted_;
  const std::shared_ptr<Shared> shared_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::empty_body>> parser_;
  http::response<http::string_body> response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
  int answered_ = 0;
};

class BeastServer final : public Server {
 public:
  BeastServer(const Settings& settings, std::shared_ptr<session::Directory> directory)
      : shared_(std::make_shared<Shared>(settings, std::move(directory))),
        acceptor_(asio::make_strand(io_)),
        retry_(acceptor_.get_executor()) {}

  ~BeastServer() override { shutdown(); }

  std::optional<Error> open() {
    const Settings& settings = shared_->settings;
    error_code ec;
    tcp::resolver resolver(io_);
    const auto found =
        resolver.resolve(settings.host, std::to_string(settings.port), tcp::resolver::passive | tcp::resolver::numeric_service, ec);
    if (ec || found.empty())
      return Error{"Cannot listen on '" + settings.host + "': it is no address or name of this machine; 127.0.0.1 is the usual one."};
    const tcp::endpoint endpoint = found.begin()->endpoint();
    if (!endpoint.address().is_loopback() && !settings.allowInsecure)
      return Error{"Refusing to listen on " + settings.host +
                   ": there is no encryption and no access control yet, so everybody who reaches the port could use it; say "
                   "--allow-insecure if that "
                   "is meant, or listen on 127.0.0.1."};
    const std::string where = nameOf(endpoint);
    acceptor_.open(endpoint.protocol(), ec);
    if (ec) return Error{"Cannot listen on " + where + ": " + ec.message() + "."};
    acceptor_.set_option(asio::socket_base::reuse_address(true), ec);
    acceptor_.bind(endpoint, ec);
    if (!ec) acceptor_.listen(asio::socket_base::max_listen_connections, ec);
    if (ec == asio::error::address_in_use)
      return Error{"Cannot listen on " + where + ": the port is in use; choose another with --port, or --port 0 for any free one."};
    if (ec == asio::error::access_denied)
      return Error{"Cannot listen on " + where + ": that takes rights this user lacks; choose a port above 1023."};
    if (ec) return Error{"Cannot listen on " + where + ": " + ec.message() + "; 127.0.0.1 is the usual address."};
    endpoint_ = acceptor_.local_endpoint(ec);
    asio::post(acceptor_.get_executor(), [this] { accept(); });
    for (unsigned k = 0; k < std::max(1u, settings.threads); ++k) threads_.emplace_back([this] { serve(); });
    return {};
  }

  std::uint16_t port() const override { return endpoint_.port(); }
  std::string url() const override { return "http://" + nameOf(endpoint_); }

  void shutdown() override {
    if (threads_.empty()) return;
    asio::post(acceptor_.get_executor(), [this] {
      error_code ignored;
      acceptor_.close(ignored);
      retry_.cancel();
    });
    std::vector<std::shared_ptr<Stream>> streams;
    {
      const std::lock_guard lock(shared_->mutex);
      for (const auto& [key, weak] : shared_->streams)
        if (auto stream = weak.lock()) streams.push_back(std::move(stream));
    }
    for (auto& stream : streams) stream->postGoingAway();
    streams.clear();
    {
      std::unique_lock lock(shared_->mutex);
      shared_->fewerStreams.wait_for(lock, kShutdownPatience, [this] { return shared_->streams.empty(); });
    }
    io_.stop();
    for (auto& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  void serve() {
    for (;;) {
      try {
        io_.run();
        return;
      } catch (const std::exception& e) {
        spdlog::error("a connection failed: {}", e.what());
      }
    }
  }

  void accept() {
    acceptor_.async_accept(asio::make_strand(io_), [this](error_code ec, tcp::socket socket) {
      if (ec == asio::error::operation_aborted || !acceptor_.is_open()) return;
      if (ec) {  // most likely out of file descriptors: the ones that are open may end
        spdlog::warn("cannot accept a connection: {}", ec.message());
        retry_.expires_after(std::chrono::milliseconds(200));
        retry_.async_wait([this](error_code waited) {
          if (!waited) accept();
        });
        return;
      }
      Counted counted(shared_);
      if (counted.rank() <= shared_->settings.maxConnections + kRefusedAtATime)
        std::make_shared<HttpConnection>(std::move(socket), std::move(counted), shared_)->start();
      accept();
    });
  }

  std::shared_ptr<Shared> shared_;
  asio::io_context io_;
  tcp::acceptor acceptor_;
  asio::steady_timer retry_;
  tcp::endpoint endpoint_;
  std::vector<std::thread> threads_;
};

}  // namespace

Outcome<std::unique_ptr<Server>> Server::listen(const Settings& settings, std::shared_ptr<session::Directory> directory) {
  auto server = std::make_unique<BeastServer>(settings, std::move(directory));
  if (auto error = server->open()) return std::move(*error);
  return std::unique_ptr<Server>(std::move(server));
}

}  // namespace ridgecast::net
