#include "client/link/websocket.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/status.hpp>
#include <boost/beast/websocket.hpp>

#include "client/link/dial.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "common/transport/channel.h"
#include "common/wire/wire.h"

namespace ridgecast::link {
namespace {

namespace net = boost::asio;
namespace websocket = boost::beast::websocket;
using boost::system::error_code;
using net::ip::tcp;
using std::chrono::milliseconds;

constexpr milliseconds kPartingTimeout{200};
constexpr std::chrono::seconds kSilence{30};  // without a word, ping or pong from the server
constexpr std::size_t kRoomyFrame = std::size_t{4} << 20;

}  // namespace

// Handlers hold a plain `this`: none of them runs outside run().
struct WebSocket::Impl {
  enum class State { kDialing, kUpgrading, kGreeting, kStreaming, kEnded };

  Impl(const core::Url& url, milliseconds timeout, const Waiting& waiting, Listener& listener)
      : url_(url),
        where_(url.where()),
        timeout_(timeout),
        waiting_(waiting),
        unheard_(url.world.find("terrain=") != std::string::npos ? std::max(timeout, waiting.unheard) : timeout),
        listener_(listener) {}

  transport::Channel& channel() { return socket_.next_layer(); }

  // It ends here when what follows has not come within `timeout`. A new limit replaces the last.
  void limit(milliseconds timeout) {
    timer_.expires_after(timeout);
    timer_.async_wait([this](error_code e) {
      if (!e) end(late());
    });
  }

  // ---- the way to the upgrade ----

  void begin() {
    if (state_ == State::kEnded) return;
    limit(timeout_);
    dial(url_, resolver_, channel(), dialing_, [this](std::optional<std::string> wrong) {
      if (state_ != State::kEnded) wrong ? end(std::move(*wrong)) : upgrade();
    });
  }

  void upgrade() {
    state_ = State::kUpgrading;
    error_code ignored;
    channel().socket().set_option(tcp::no_delay(true), ignored);
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
    channel().passOverInterim([this] {
      heard_ = true;
      limit(waiting_.heard);
      if (waiting_.preparing) waiting_.preparing();
    });
    const std::string target = "/v1/stream?session=" + url_.session + (url_.world.empty() ? "" : "&" + url_.world);
    socket_.async_handshake(response_, where_, target, [this](error_code e) {
      if (state_ == State::kEnded) return;
      if (e) return end(notUpgraded(e));
      state_ = State::kGreeting;
      limit(timeout_);
      listener_.opened();
      read();
    });
  }

  std::string notUpgraded(const error_code& e) const {
    if (e == websocket::error::upgrade_declined) {
      std::string text = where_ + " answered HTTP " + std::to_string(response_.result_int()) + " instead of opening a stream";
      const std::string body = text::oneLine(response_.body());
      if (!body.empty() && body.front() != '<') return text + ": " + body;
      return text + "; is there a ridgecast-server, and a session '" + url_.session + "'?";
    }
    if (heard_) return "the server at " + where_ + " went away while it prepared the terrain (" + e.message() + "); try again";
    return "what answers at " + where_ + " is not a Ridgecast server (" + e.message() + "); check host and port";
  }

  std::optional<std::chrono::seconds> retryAfter() const {
    if (response_.result() != boost::beast::http::status::service_unavailable) return {};
    const auto seconds = text::number<std::uint32_t>(response_[boost::beast::http::field::retry_after]);
    return seconds ? std::optional(std::chrono::seconds(*seconds)) : std::nullopt;
  }

  std::string late() const {
    const auto within = [](milliseconds timeout) { return " within " + std::to_string(timeout.count()) + " ms"; };
    if (state_ == State::kUpgrading && heard_)
      return "the server at " + where_ + " began to prepare the terrain and said nothing more" + within(waiting_.heard) +
             "; try again later";
    if (dialing_ == Dialing::kResolving)
      return "the host '" + url_.host + "' could not be looked up" + within(timeout_) + "; check the server's address";
    if (dialing_ == Dialing::kConnecting) return "no answer from " + where_ + within(timeout_) + "; check host, port and firewall";
    return "what listens at " + where_ + " did not answer like a Ridgecast server" +
           within(state_ == State::kUpgrading ? unheard_ : timeout_) + "; check host and port";
  }

  // ---- frames ----

  void read() {
    socket_.async_read(buffer_, [this](error_code e, std::size_t size) {
      if (state_ == State::kEnded) return;
      if (e) return end(readFailed(e));
      if (!socket_.got_binary()) return end("the server at " + where_ + " sent text, the stream is binary; is it a Ridgecast server?");
      listener_.received({static_cast<const std::uint8_t*>(buffer_.data().data()), size});
      buffer_.clear();
      if (size > kRoomyFrame) buffer_.shrink_to_fit();  // one large frame must not hold its memory for good
      if (state_ != State::kEnded) read();
    });
  }

  std::string readFailed(const error_code& e) const {
    if (e == websocket::error::closed) {
      const std::string reason = text::oneLine({socket_.reason().reason.data(), socket_.reason().reason.size()});
      return "the server at " + where_ + " closed the connection" +
             (reason.empty() ? " (code " + std::to_string(socket_.reason().code) + ")" : ": " + reason);
    }
    if (e == boost::beast::error::timeout) return "the server at " + where_ + " has been silent for too long";
    if (e == websocket::error::message_too_big) return "the server at " + where_ + " sent a message of more than 256 MiB";
    if (e == net::error::eof || e == net::error::connection_reset || e == net::error::broken_pipe)
      return "the server at " + where_ + " went away without a goodbye";
    return "the stream from " + where_ + " broke: " + e.message();
  }

  void send(std::string frame) {
    expects(frame_.empty() && !frame.empty(), "one frame leaves at a time");
    frame_ = std::move(frame);
    socket_.async_write(net::buffer(frame_), [this](error_code e, std::size_t) {
      frame_.clear();
      // A failed write is followed by a failed read, which knows better why: a server that refuses says so before it closes.
      if (!e && state_ != State::kEnded) listener_.sent();
    });
  }

  // ---- the end ----

  void end(std::string why) {
    if (state_ == State::kEnded) return;
    state_ = State::kEnded;
    listener_.ended(std::move(why), retryAfter());
    hangUp();
  }

  void hangUp() {
    timer_.cancel();
    later_.cancel();
    resolver_.cancel();
    error_code ignored;
    channel().socket().close(ignored);
    context_.stop();  // or Beast's own timers would keep run() until they expire
  }

  // The owner leaves.
  void part() {
    if (state_ == State::kEnded) return;
    const bool polite = state_ == State::kGreeting || state_ == State::kStreaming;
    state_ = State::kEnded;
    if (!polite) return hangUp();
    timer_.expires_after(kPartingTimeout);
    timer_.async_wait([this](error_code) { hangUp(); });
    socket_.async_close(websocket::close_code::normal, [this](error_code) { hangUp(); });
  }

  const core::Url url_;
  const std::string where_;
  const milliseconds timeout_;
  const Waiting waiting_;
  const milliseconds unheard_;  // for the answer to the upgrade
  Listener& listener_;
  net::io_context context_{1};
  State state_ = State::kDialing;
  tcp::resolver resolver_{context_};
  websocket::stream<transport::Channel, false> socket_{tcp::socket(context_)};
  net::steady_timer timer_{context_}, later_{context_};
  websocket::response_type response_;
  boost::beast::flat_buffer buffer_;
  Dialing dialing_ = Dialing::kResolving;
  std::string frame_;   // being written
  bool heard_ = false;  // that the server prepares the world
};

WebSocket::WebSocket(const core::Url& url, milliseconds timeout, const Waiting& waiting, Listener& listener)
    : impl_(std::make_unique<Impl>(url, timeout, waiting, listener)) {}

WebSocket::~WebSocket() = default;

void WebSocket::run() {
  post([this] { impl_->begin(); });
  impl_->context_.run();
}

void WebSocket::post(std::function<void()> work) { net::post(impl_->context_, std::move(work)); }
void WebSocket::send(std::string frame) { impl_->send(std::move(frame)); }

void WebSocket::greeted() {
  expects(impl_->state_ == Impl::State::kGreeting, "a stream is greeted once");
  impl_->state_ = Impl::State::kStreaming;
  impl_->timer_.cancel();
}

void WebSocket::after(milliseconds pause, std::function<void()> work) {
  impl_->later_.expires_after(pause);
  impl_->later_.async_wait([this, work = std::move(work)](error_code e) {
    if (!e && impl_->state_ != Impl::State::kEnded) work();
  });
}

void WebSocket::end(std::string why) { impl_->end(std::move(why)); }

void WebSocket::giveUp() {
  post([this] {
    if (impl_->state_ != Impl::State::kStreaming) end("gave up waiting for the server at " + impl_->where_);
  });
}

void WebSocket::part() {
  post([this] { impl_->part(); });
}

}  // namespace ridgecast::link
