#pragma once
// The bytes to and from a server, in the clear or under TLS. Beast's WebSocket is made once for it, whatever lies below; OpenSSL stays in
// line.cpp. For the room's own sources.
//
// Everything on the context's one thread. An asynchronous stream in Asio's sense; at most one read and one write at a time.

#include <array>
#include <boost/asio/async_result.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/role.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace ridgecast::connection {

class Line {
 public:
  using executor_type = boost::asio::io_context::executor_type;
  using Socket = boost::asio::basic_stream_socket<boost::asio::ip::tcp, executor_type>;
  using error_code = boost::system::error_code;

  explicit Line(const executor_type& executor);
  ~Line();
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  executor_type get_executor() { return socket_.get_executor(); }
  Socket& socket() { return socket_; }

  // Speaks TLS with a server that must be `host` (a name or an address) by the word of the authorities in the file `ca` (PEM); empty: of
  // those that this system trusts. `done` gets nothing, or what was wrong.
  void startTls(const std::string& host, const std::string& ca, std::function<void(std::optional<std::string>)> done);

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

  // What is read next is an answer to an HTTP request: interim ones (1xx, but for 101) before it are told of and read by nobody. A head of
  // more than 8 KiB is passed on as it is.
  void passOverInterim(std::function<void()> tell) { interim_ = std::move(tell); }

  void hangUp() {
    error_code ignored;
    socket_.shutdown(boost::asio::socket_base::shutdown_both, ignored);
    socket_.close(ignored);
  }

 private:
  // A handler without its type.
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
  void readBelow(const MutableBuffers& buffers, Done done);
  bool beginsAnswer();
  void writeSome(const ConstBuffers& buffers, Done done);

  struct Tls;
  Socket socket_;
  std::unique_ptr<Tls> tls_;
  std::function<void()> interim_;  // set: the answer has not begun
  std::string head_;               // what was read of it, and nobody has had yet
  std::array<char, 2048> chunk_;
};

// How a WebSocket ends below its last frame (found by Beast through its argument). Beast's own way waits for the server to hang up
// first; whoever has to say why the connection ended cannot wait for that.
template <class Handler>
void async_teardown(boost::beast::role_type, Line& line, Handler&& handler) {
  line.hangUp();
  boost::asio::post(line.get_executor(), [h = std::forward<Handler>(handler)]() mutable { h(boost::system::error_code{}); });
}
inline void beast_close_socket(Line& line) { line.hangUp(); }

}  // namespace ridgecast::connection
