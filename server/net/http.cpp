#include "server/net/http.h"

#include <boost/asio/dispatch.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "server/net/routes.h"
#include "server/net/stream.h"

namespace ridgecast::net {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using beast::error_code;

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
    startStream(std::move(stream_), std::move(counted_), shared_, std::move(session), nameOf(endpoint), parser_->release());
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

}  // namespace

void startHttp(tcp::socket&& socket, Counted counted, std::shared_ptr<Shared> shared) {
  std::make_shared<HttpConnection>(std::move(socket), std::move(counted), std::move(shared))->start();
}

}  // namespace ridgecast::net
