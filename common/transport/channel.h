#pragma once
// One connection's bytes, in the clear or under TLS, with a deadline: what HTTP and WebSocket read from and write to, on both sides.
// Beast's templates are made once for it, whatever lies below; OpenSSL stays in channel.cpp. Heavy: for .cpp files that see sockets.
//
// Everything on the socket's strand. An asynchronous stream in Asio's sense; at most one read and one write at a time.

#include <array>
#include <boost/asio/async_result.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/role.hpp>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

namespace ridgecast::transport {

class TlsContext;  // a server's certificate and its key
// Error: a file cannot be read, is no PEM, or the two do not belong together.
Outcome<std::shared_ptr<TlsContext>> loadTls(const std::filesystem::path& certificate, const std::filesystem::path& key);
std::chrono::sys_seconds expiryOf(const TlsContext& context);  // of its certificate

class Channel {
 public:
  using executor_type = boost::asio::ip::tcp::socket::executor_type;
  using error_code = boost::system::error_code;
  using Clock = std::chrono::steady_clock;

  // A completion handler of any type.
  class Done {
   public:
    template <class Handler>
    explicit Done(Handler handler)
        : call_([own = std::make_shared<Handler>(std::move(handler))](error_code ec, std::size_t bytes) { (*own)(ec, bytes); }) {}
    void operator()(error_code ec, std::size_t bytes) {
      expects(static_cast<bool>(call_), "an operation ends once");
      std::exchange(call_, nullptr)(ec, bytes);
    }

   private:
    std::function<void(error_code, std::size_t)> call_;  // shared, since a std::function is copyable
  };

  explicit Channel(boost::asio::ip::tcp::socket&& socket);
  Channel(Channel&&) noexcept;
  Channel& operator=(Channel&&) = delete;
  ~Channel();

  executor_type get_executor() const;
  boost::asio::ip::tcp::socket& socket();

  // Server side. Waits for the first byte. If that begins a TLS handshake, it follows, and `done` gets its result. Otherwise
  // done(error::no_protocol_option): the channel then is in the clear.
  void startTls(std::shared_ptr<TlsContext> context, Done done);
  // Client side: the server must have a certificate for `host` (a name or an address) from these authorities. `done` gets nothing, or what
  // was wrong.
  struct Authorities {
    std::string file;                  // PEM; empty: those that this system trusts
    const char* flag = "--ca";         // that names the file, for errors
    const char* withoutTls = "ws://";  // how a URL asks for none
  };
  void startTls(const std::string& host, const Authorities& authorities, std::function<void(std::optional<std::string>)> done);

  // The next data read is an HTTP response: interim responses (1xx except 101) before it are reported to `tell` and discarded. A head of
  // more than 8 KiB is passed on as it is.
  void passOverInterim(std::function<void()> tell);

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

  // Ends the sending side, and discards the little that still comes until the other side ends, too.
  void finish(Done done);

  // The channel closes at this time; operations then end with an error. A new time replaces the last.
  void expires_at(Clock::time_point when);
  void expires_after(Clock::duration timeout) { expires_at(Clock::now() + timeout); }
  void expires_never();
  void cancel();  // operations end; the channel stays open
  void close();

 private:
  static constexpr std::size_t kMaxBuffers = 8;  // of one operation; the rest follows in the next
  using MutableBuffers = std::array<boost::asio::mutable_buffer, kMaxBuffers>;
  using ConstBuffers = std::array<boost::asio::const_buffer, kMaxBuffers>;
  template <class Some, class Buffers>
  static Some some(const Buffers& buffers) {
    Some out;
    std::size_t count = 0;
    const auto end = boost::asio::buffer_sequence_end(buffers);
    for (auto at = boost::asio::buffer_sequence_begin(buffers); at != end && count < kMaxBuffers; ++at)
      if (typename Some::value_type buffer = *at; buffer.size() > 0) out[count++] = buffer;
    return out;
  }
  void readSome(const MutableBuffers& buffers, Done done);
  void writeSome(const ConstBuffers& buffers, Done done);

  struct Body;
  std::shared_ptr<Body> body_;
};

// How Beast ends a WebSocket on it, after both close frames: a server has little to wait for, and a client, which must say why the
// connection ended, does not wait at all.
inline void beast_close_socket(Channel& channel) { channel.close(); }
template <class Handler>
void async_teardown(boost::beast::role_type role, Channel& channel, Handler&& handler) {
  if (role == boost::beast::role_type::client) {
    channel.close();
    return boost::asio::post(channel.get_executor(), [h = std::forward<Handler>(handler)]() mutable { h(boost::system::error_code{}); });
  }
  channel.expires_after(std::chrono::milliseconds(250));
  channel.finish(Channel::Done([h = std::forward<Handler>(handler)](boost::system::error_code ec, std::size_t) mutable { h(ec); }));
}

}  // namespace ridgecast::transport
