#include "server/net/stream.h"

#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <optional>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/access/limits.h"
#include "server/conversation/rate.h"
#include "server/logging/logging.h"
#include "server/member/camera_session.h"

namespace ridgecast::net {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using beast::error_code;

// Time for the client to read an error and answer the close.
constexpr std::chrono::seconds kFarewellTimeout{3};
constexpr std::chrono::seconds kHandOverTimeout{1};
constexpr std::chrono::seconds kMaxDebt{1};  // of pings and pongs

// What an error is to the WebSocket and in the metrics.
std::pair<websocket::close_code, metrics::Refusal> meaningOf(wire::ErrorCode code) {
  using enum wire::ErrorCode;
  using websocket::close_code;
  if (code == kVersion) return {close_code::protocol_error, metrics::Refusal::kVersion};
  if (code == kMalformed) return {close_code::protocol_error, metrics::Refusal::kMalformed};
  if (code == kInvalid) return {close_code::policy_error, metrics::Refusal::kInvalid};
  if (code == kLimit) return {close_code::policy_error, metrics::Refusal::kLimit};
  return {code == kInternal ? close_code::internal_error : close_code::policy_error, metrics::Refusal::kInternal};
}

// The right that a message takes beyond seeing the session.
std::optional<access::Right> neededFor(const wire::ClientMessage& message) {
  if (std::holds_alternative<wire::Query>(message) || std::holds_alternative<wire::AskGround>(message)) return access::Right::kQuery;
  if (std::holds_alternative<wire::SetClock>(message) || std::holds_alternative<wire::ClockStep>(message) ||
      std::holds_alternative<wire::PassOver>(message))
    return access::Right::kClock;
  if (std::holds_alternative<wire::Edit>(message)) return access::Right::kEdit;
  return {};
}

// Of one stream, counted by whoever sends.
struct Traffic {
  std::atomic<std::size_t> queuedBytes{0};
  std::atomic<std::uint64_t> iterations{0};
};

// A message that is counted until it has left or is dropped; the ticket is released then.
class Outgoing {
 public:
  Outgoing(std::shared_ptr<Traffic> traffic, std::shared_ptr<const std::string> bytes, std::shared_ptr<const void> ticket)
      : traffic_(std::move(traffic)), bytes_(std::move(bytes)), ticket_(std::move(ticket)) {
    traffic_->queuedBytes += bytes_->size();
  }
  Outgoing(Outgoing&&) = default;
  Outgoing& operator=(Outgoing&&) = delete;
  ~Outgoing() {
    if (traffic_) expects(traffic_->queuedBytes.fetch_sub(bytes_->size()) >= bytes_->size(), "what is sent was queued");
  }
  const std::string& bytes() const { return *bytes_; }

 private:
  std::shared_ptr<Traffic> traffic_;  // null: it was moved on
  std::shared_ptr<const std::string> bytes_;
  std::shared_ptr<const void> ticket_;
};

// One client's stream. Everything runs on its strand except the counter of queued bytes.
//
//   accepting -> open -> farewell (an error or the server's end: one last message, then the closing handshake) -> over
class Stream : public OpenStream, public std::enable_shared_from_this<Stream> {
 public:
  Stream(Channel&& channel, ConnectionSlot slot, std::shared_ptr<ServerContext> shared, std::shared_ptr<session::Session> session,
         std::string peer, access::Grant grant)
      : ws_(std::move(channel)),
        timer_(ws_.get_executor()),
        expiry_(ws_.get_executor()),
        pause_(ws_.get_executor()),
        leaving_(ws_.get_executor()),
        slot_(std::move(slot)),
        shared_(std::move(shared)),
        session_(std::move(session)),
        peer_(std::move(peer)),
        grant_(std::move(grant)),
        frames_(shared_->settings.maxMessagesPerSecond) {
    shared_->figures->streams.Increment();
    shared_->figures->streamsOpen.Increment(1);
  }

  ~Stream() override {
    shared_->figures->streamsOpen.Increment(-1);
    shared_->streams.remove(this);
  }

  void start(beast::http::request<beast::http::empty_body> request) {
    shared_->streams.add(shared_from_this());
    request_ = std::move(request);
    beast::get_lowest_layer(ws_).expires_never();  // the stream has its own timeouts
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = shared_->settings.timeout;
    timeout.idle_timeout = shared_->settings.idle;
    timeout.keep_alive_pings = true;
    ws_.set_option(timeout);
    ws_.set_option(websocket::stream_base::decorator(
        [offered = request_[beast::http::field::sec_websocket_protocol]](websocket::response_type& response) {
          response.set(beast::http::field::server, kServerName);
          if (offered.find(kSubprotocol) != beast::string_view::npos)
            response.set(beast::http::field::sec_websocket_protocol, kSubprotocol);
        }));
    ws_.read_message_max(0);  // counted here, so that the client gets an error before the close
    ws_.auto_fragment(false);
    ws_.binary(true);
    ws_.async_accept(request_, [self = shared_from_this()](error_code ec) { self->accepted(ec); });
  }

  // Any thread.
  void post(Outgoing message) {
    asio::post(ws_.get_executor(),
               [self = shared_from_this(), message = std::move(message)]() mutable { self->enqueue(std::move(message)); });
  }
  void postFailure(wire::ErrorMessage message) {
    asio::post(ws_.get_executor(), [self = shared_from_this(), message = std::move(message)] { self->fail(message); });
  }
  void postGoingAway(std::chrono::milliseconds wait) override {
    asio::post(ws_.get_executor(), [self = shared_from_this(), wait] {
      if (wait.count() == 0) return self->handOver();
      self->after(self->leaving_, wait, [](Stream& s) {
        if (!s.shared_->takesStreams) s.handOver();
      });
    });
  }
  void postJudge() override {
    asio::post(ws_.get_executor(), [self = shared_from_this()] { self->judge(); });
  }
  void postRemove(std::optional<std::uint64_t> camera) override {
    asio::post(ws_.get_executor(), [self = shared_from_this(), camera] {
      if (!camera || *camera == self->stay_.camera)
        self->fail(metrics::Refusal::kRemoved, {wire::ErrorCode::kLimit, "The operator of this server has ended your stream."});
    });
  }
  std::size_t waitingBytes() const override { return traffic_->queuedBytes; }
  const session::Session& session() const override { return *session_; }
  const std::shared_ptr<Traffic>& traffic() const { return traffic_; }

 private:
  void accepted(error_code ec);

  // The token of the upgrade, by the tokens of now.
  void judge() {
    auto judged = shared_->filter.judge(requestOf(request_));
    if (auto* grant = std::get_if<access::Grant>(&judged)) {
      grant_ = std::move(*grant);
      expireInTime();
    } else {
      fail(metrics::Refusal::kToken, {wire::ErrorCode::kLimit, "The token was withdrawn."});
    }
  }

  void expireInTime() {
    expiry_.cancel();
    if (!grant_.expires) return;
    const auto left = std::max<std::chrono::nanoseconds>(*grant_.expires - std::chrono::system_clock::now(), std::chrono::seconds(0));
    after(expiry_, left, [](Stream& self) { self.fail(metrics::Refusal::kExpired, {wire::ErrorCode::kLimit, "The token has expired."}); });
  }

  // The camera's mesh first, if it has another server to go to; its client then has all that was sent.
  void handOver() {
    if (stage_ != Stage::kOpen || shared_->takesStreams || !camera_) return goAway();
    const auto done = [weak = weak_from_this()] {
      if (const auto self = weak.lock()) asio::post(self->ws_.get_executor(), [self] { self->goAway(); });
    };
    if (!camera_->handOver(done)) return goAway();
    keepsQueue_ = true;
    after(leaving_, kHandOverTimeout, [](Stream& self) { self.goAway(); });
  }

  void goAway() {
    leaving_.cancel();
    wire::ErrorMessage last{wire::ErrorCode::kGoingAway, "The server is leaving; connect again.", shared_->settings.reconnectUrl};
    stay_.endsBy = metrics::name(metrics::Refusal::kDraining);
    if (shared_->takesStreams) {
      last = {wire::ErrorCode::kGoingAway, "The session begins again; connect again.", {}};
      stay_.endsBy = "successor";
    }
    farewell(wire::encode(wire::ServerMessage(last)), {websocket::close_code::going_away, last.message});
  }

  void read() {
    expects(buffer_.size() <= shared_->settings.maxMessageBytes, "what exceeds the limit ends the stream");
    const std::size_t room = shared_->settings.maxMessageBytes + 1 - buffer_.size();
    ws_.async_read_some(buffer_, room, [self = shared_from_this()](error_code ec, std::size_t) { self->hasRead(ec); });
  }

  // Once the last message is paid for.
  void readNext() {
    const auto free = std::max(budgets_->messages.free(), frames_.free());
    if (free <= conversation::Budget::Clock::now()) return read();
    pause_.expires_at(free);
    pause_.async_wait([self = shared_from_this()](error_code ec) {
      if (!ec) self->read();
    });
  }

  // A ping or a pong, amid a read: it cannot wait for its time as messages do.
  void hasReadControl() {
    const auto now = conversation::Budget::Clock::now();
    frames_.spend(now, 1);
    if (frames_.free() <= now + kMaxDebt) return;
    const std::string most = std::to_string(shared_->settings.maxMessagesPerSecond);
    fail(metrics::Refusal::kMessageRate, {wire::ErrorCode::kLimit, "More than " + most + " pings and pongs a second, the limit."});
  }

  void hasRead(error_code ec) {
    if (ec) return end();
    if (stage_ != Stage::kOpen) {  // ignores what arrives after an error
      buffer_.clear();
      return read();
    }
    const Settings& settings = shared_->settings;
    if (buffer_.size() > settings.maxMessageBytes)
      return fail(metrics::Refusal::kMessageSize,
                  {wire::ErrorCode::kLimit, "A message has more than " + std::to_string(settings.maxMessageBytes) + " bytes, the limit."},
                  websocket::close_code::too_big);
    if (!ws_.is_message_done()) return read();
    shared_->figures->messagesReceived.Increment();
    shared_->figures->bytesReceived.Increment(buffer_.size());
    if (ws_.got_text())
      return fail(metrics::Refusal::kMalformed,
                  {wire::ErrorCode::kMalformed, "A text message came; messages are binary, one protobuf ClientMessage each."},
                  websocket::close_code::unknown_data);
    const auto bytes = buffer_.cdata();
    const auto now = conversation::Budget::Clock::now();
    budgets_->messages.spend(now, bytes.size());
    frames_.spend(now, 1);
    auto message = wire::decodeClient({static_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    buffer_.clear();
    if (!message) return fail({wire::ErrorCode::kMalformed, message.error().message});
    if (const auto right = neededFor(*message); right && !grant_.rights.has(*right)) {
      const std::string why = "The token lacks the right '" + std::string(access::name(*right)) + "'.";
      if (*right != access::Right::kClock || !greeted_) return fail(metrics::Refusal::kRight, {wire::ErrorCode::kInvalid, why});
      session().clock().refuse(camera_->id(), why);  // as to anybody else who cannot set the clock now
      return readNext();
    }
    if (!greeted_) {
      greeted_ = true;
      timer_.cancel();
      if (const auto* hello = std::get_if<wire::Hello>(&*message))
        logging::info(about("hello"), "says hello as '" + hello->clientName + "', protocol " + std::to_string(hello->protocolVersion));
    }
    camera_->receive(std::move(*message));
    readNext();
  }

  void enqueue(Outgoing message) {
    if (stage_ != Stage::kOpen) return;
    if (out_.size() >= kMaxQueuedMessages) return fail({wire::ErrorCode::kLimit, "Too much is queued for this client."});
    out_.push_back(std::move(message));
    if (!writing_) write();
  }

  void write() {
    expects(!writing_ && !out_.empty(), "one message is written at a time");
    writing_ = true;
    ws_.async_write(asio::buffer(out_.front().bytes()), [self = shared_from_this()](error_code ec, std::size_t bytes) {
      self->writing_ = false;
      self->out_.pop_front();
      if (ec) return self->end();
      self->shared_->figures->bytesSent.Increment(bytes);
      self->stay_.sentBytes += bytes;
      if (!self->out_.empty()) return self->write();
      if (self->stage_ == Stage::kFarewell) self->sayClose();
    });
  }

  void fail(const wire::ErrorMessage& message) { fail(meaningOf(message.code).second, message); }
  void fail(metrics::Refusal reason, const wire::ErrorMessage& message, std::optional<websocket::close_code> code = {}) {
    if (stage_ != Stage::kOpen) return;
    shared_->figures->refused(reason);
    stay_.endsBy = metrics::name(reason);
    logging::info(about("refused", stay_.endsBy), "is sent away: " + message.message);
    farewell(wire::encode(wire::ServerMessage(message)),
             {code.value_or(meaningOf(message.code).first), message.message.substr(0, 120)});  // a control frame has 125 bytes
  }

  // Calls `then` when the time is over, unless the stream is gone or the timer was cancelled.
  void after(asio::steady_timer& timer, std::chrono::nanoseconds time, void (*then)(Stream&)) {
    timer.expires_after(time);
    timer.async_wait([weak = weak_from_this(), then](error_code ec) {
      if (const auto self = weak.lock(); self && !ec) then(*self);
    });
  }

  // Sends one last message, if any, then the closing handshake.
  void farewell(std::string last, websocket::close_reason reason) {
    if (stage_ == Stage::kAccepting) return end();
    if (stage_ != Stage::kOpen) return;
    stage_ = Stage::kFarewell;
    reason_ = std::move(reason);
    leave();
    while (!keepsQueue_ && out_.size() > (writing_ ? 1u : 0u)) out_.pop_back();
    after(timer_, kFarewellTimeout, [](Stream& self) { self.end(); });
    if (!last.empty()) out_.emplace_back(traffic_, std::make_shared<const std::string>(std::move(last)), nullptr);
    if (writing_) return;
    out_.empty() ? sayClose() : write();
  }

  void sayClose() {
    ws_.async_close(reason_, [self = shared_from_this()](error_code) { self->end(); });
  }

  // Releases the camera's place.
  void leave() {
    if (camera_) camera_->close();
    camera_.reset();
  }

  void end() {
    if (stage_ == Stage::kOver) return;
    stage_ = Stage::kOver;
    timer_.cancel();
    expiry_.cancel();
    pause_.cancel();
    leaving_.cancel();
    leave();
    logEnd();
    beast::get_lowest_layer(ws_).close();
  }

  logging::About about(std::string_view event, std::string_view reason = {}) const {
    return {.session = session_->name(), .camera = stay_.camera, .peer = peer_, .holder = grant_.name, .event = event, .reason = reason};
  }
  void logEnd() const {
    if (stay_.camera == 0) return;
    logging::About ended = about("ended", stay_.endsBy);
    ended.stay = {std::chrono::duration<double>(std::chrono::steady_clock::now() - stay_.began).count(), stay_.sentBytes,
                  traffic_->iterations};
    char text[120];
    std::snprintf(text, sizeof text, "is gone after %.1f s, %llu iterations, %.1f MB", ended.stay->seconds,
                  static_cast<unsigned long long>(ended.stay->iterations), static_cast<double>(stay_.sentBytes) / 1e6);
    logging::info(ended, text);
  }

  enum class Stage { kAccepting, kOpen, kFarewell, kOver };

  websocket::stream<Channel, false> ws_;
  asio::steady_timer timer_, expiry_, pause_, leaving_;
  const ConnectionSlot slot_;
  const std::shared_ptr<ServerContext> shared_;
  const std::shared_ptr<session::Session> session_;
  const std::string peer_;
  access::Grant grant_;
  conversation::Budget frames_;
  std::shared_ptr<session::Budgets> budgets_;
  beast::http::request<beast::http::empty_body> request_;
  Stage stage_ = Stage::kAccepting;
  std::shared_ptr<member::CameraSession> camera_;
  beast::flat_buffer buffer_;
  bool greeted_ = false;
  std::deque<Outgoing> out_;                   // at most kMaxQueuedMessages; the first is being written while writing_
  bool writing_ = false, keepsQueue_ = false;  // keepsQueue_: the last message comes after all others
  websocket::close_reason reason_;
  std::shared_ptr<Traffic> traffic_ = std::make_shared<Traffic>();
  struct {
    std::uint64_t camera = 0;  // 0: it never had one
    const std::chrono::steady_clock::time_point began = std::chrono::steady_clock::now();
    std::uint64_t sentBytes = 0;
    std::string_view endsBy = "left";
  } stay_;  // for the log
};

// A camera session's way to its client. Messages are encoded on the sending thread, which belongs to a camera's pool.
class StreamSender final : public conversation::Sender {
 public:
  explicit StreamSender(const std::shared_ptr<Stream>& stream) : stream_(stream), traffic_(stream->traffic()) {}

  void send(wire::ServerMessage message, std::shared_ptr<const void> ticket) override {
    if (stream_.expired()) return;
    traffic_->iterations += std::holds_alternative<wire::Iteration>(message);
    sendShared(std::make_shared<const std::string>(wire::encode(message)), std::move(ticket));
  }
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    const auto stream = stream_.lock();
    if (!stream) return;
    stream->post({traffic_, std::move(encoded), std::move(ticket)});
  }
  std::size_t queuedBytes() const override { return traffic_->queuedBytes; }
  void fail(wire::ErrorMessage message) override {
    if (const auto stream = stream_.lock()) stream->postFailure(std::move(message));
  }

 private:
  const std::weak_ptr<Stream> stream_;
  const std::shared_ptr<Traffic> traffic_;
};

void Stream::accepted(error_code ec) {
  if (ec || stage_ != Stage::kAccepting) return end();
  stage_ = Stage::kOpen;
  if (!shared_->takesStreams || session_->isRetired()) return goAway();  // since meanwhile
  judge();                                                               // tokens may have been reloaded meanwhile
  if (stage_ != Stage::kOpen) return;
  auto place = session_->enter(slot_.client(grant_));
  if (!place) return fail(metrics::Refusal::kFull, {wire::ErrorCode::kLimit, place.error().message});
  budgets_ = place->budgets;
  camera_ = std::make_shared<member::CameraSession>(session_, std::move(*place), shared_->directory->nextCameraId(),
                                                    std::make_shared<StreamSender>(shared_from_this()));
  stay_.camera = camera_->id();
  after(timer_, shared_->settings.timeout, [](Stream& self) {
    if (!self.greeted_)
      self.fail(metrics::Refusal::kTimeout,
                {wire::ErrorCode::kLimit, "No hello came within " + std::to_string(self.shared_->settings.timeout.count()) + " ms."});
  });
  ws_.control_callback([this](websocket::frame_type kind, beast::string_view) {  // called amid a read
    if (kind != websocket::frame_type::close && stage_ == Stage::kOpen) hasReadControl();
  });
  read();
}

}  // namespace

Request requestOf(const beast::http::request_header<>& header) {
  return {.method = header.method_string(),
          .target = header.target(),
          .host = header[beast::http::field::host],
          .upgrade = websocket::is_upgrade(header),
          .webSocketVersion = header[beast::http::field::sec_websocket_version],
          .acceptEncoding = header[beast::http::field::accept_encoding],
          .contentType = header[beast::http::field::content_type],
          .idempotencyKey = header["Idempotency-Key"],
          .edit = header[ridgecast::http::kEditHeader],
          .origin = header[beast::http::field::origin],
          .fetchSite = header["Sec-Fetch-Site"],
          .authorization = header[beast::http::field::authorization],
          .subprotocols = header[beast::http::field::sec_websocket_protocol]};
}

void startStream(Channel&& channel, ConnectionSlot slot, std::shared_ptr<ServerContext> shared, std::shared_ptr<session::Session> session,
                 std::string peer, access::Grant grant, beast::http::request<beast::http::empty_body> request) {
  std::make_shared<Stream>(std::move(channel), std::move(slot), std::move(shared), std::move(session), std::move(peer), std::move(grant))
      ->start(std::move(request));
}

}  // namespace ridgecast::net
