#pragma once
// One connection's bytes, in the clear or under TLS, with a deadline: what HTTP and WebSocket read from and write to. Beast's templates
// are made once for it, whatever lies below; OpenSSL stays in channel.cpp. For the room's own sources.
//
// Everything on the socket's strand. An asynchronous stream in Asio's sense; at most one read and one write at a time.

#include <array>
#include <boost/asio/async_result.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/role.hpp>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <utility>

#include "common/outcome/outcome.h"

namespace ridgecast::net {

class TlsContext;  // a certificate and its key
// Error: a file cannot be read, is no PEM, or the two do not belong together.
Outcome<std::shared_ptr<TlsContext>> loadTls(const std::filesystem::path& certificate, const std::filesystem::path& key);

class Channel {
 public:
  using executor_type = boost::asio::ip::tcp::socket::executor_type;
  using error_code = boost::system::error_code;
  using Clock = std::chrono::steady_clock;

  // What is called when an operation ends: any handler, without its type.
  class Done {
   public:
    template <class Handler>
    explicit Done(Handler handler) : call_(std::make_unique<Of<Handler>>(std::move(handler))) {}
    void operator()(error_code ec, std::size_t bytes) { std::exchange(call_, nullptr)->call(ec, bytes); }

   private:
    struct Call {
      virtual ~Call() = default;
      virtual void call(error_code ec, std::size_t bytes) = 0;
    };
    template <class Handler>
    struct Of final : Call {
      explicit Of(Handler h) : handler(std::move(h)) {}
      void call(error_code ec, std::size_t bytes) override { handler(ec, bytes); }
      Handler handler;
    };
    std::unique_ptr<Call> call_;
  };

  explicit Channel(boost::asio::ip::tcp::socket&& socket);
  Channel(Channel&&) noexcept;
  Channel& operator=(Channel&&) = delete;
  ~Channel();

  executor_type get_executor() const;
  boost::asio::ip::tcp::endpoint peer() const;  // unspecified when it is gone already

  // Waits for the first byte. A TLS handshake follows when it begins one, and `done` says how it went. Else done(error::no_protocol_option):
  // the channel then is in the clear.
  void startTls(std::shared_ptr<TlsContext> context, Done done);

  template <class Buffers, class Token>
  auto async_read_some(const Buffers& buffers, Token&& token) {
    return boost::asio::async_initiate<Token, void(error_code, std::size_t)>(
        [this](auto handler, const MutableBuffers& b) { readSome(b, Done(std::move(handler))); }, token, some<MutableBuffers>(buffers));
  }
  template <class Buffers, class Token>
  auto async_write_some(const Buffers& buffers, Token&& token) {
    return boost::asio::async_initiate<Token, void(error_code, std::size_t)>(
        [this](auto handler, const ConstBuffers& b) { writeSome(b, Done(std::move(handler))); }, token, some<ConstBuffers>(buffers));
  }

  // Says that nothing follows, and passes over the little that still comes until the other side says the same.
  void finish(Done done);

  // The channel closes when this time comes; operations then end with an error. A new time replaces the last.
  void expires_at(Clock::time_point when);
  void expires_after(Clock::duration patience) { expires_at(Clock::now() + patience); }
  void expires_never();
  void cancel();  // operations end; the channel stays open
  void close();

 private:
  static constexpr std::size_t kMostBuffers = 8;  // of one operation; what more there is follows in the next
  using MutableBuffers = std::array<boost::asio::mutable_buffer, kMostBuffers>;
  using ConstBuffers = std::array<boost::asio::const_buffer, kMostBuffers>;
  template <class Some, class Buffers>
  static Some some(const Buffers& buffers) {
    Some out;
    std::size_t count = 0;
    const auto end = boost::asio::buffer_sequence_end(buffers);
    for (auto at = boost::asio::buffer_sequence_begin(buffers); at != end && count < kMostBuffers; ++at)
      if (typename Some::value_type buffer = *at; buffer.size() > 0) out[count++] = buffer;
    return out;
  }
  void readSome(const MutableBuffers& buffers, Done done);
  void writeSome(const ConstBuffers& buffers, Done done);

  struct Body;
  std::shared_ptr<Body> body_;
};

// How Beast ends a WebSocket on it. Both sides have said that they close by then: there is little to wait for.
inline void beast_close_socket(Channel& channel) { channel.close(); }
template <class Handler>
void async_teardown(boost::beast::role_type, Channel& channel, Handler&& handler) {
  channel.expires_after(std::chrono::milliseconds(250));
  channel.finish(Channel::Done([h = std::forward<Handler>(handler)](boost::system::error_code ec, std::size_t) mutable { h(ec); }));
}

}  // namespace ridgecast::net
