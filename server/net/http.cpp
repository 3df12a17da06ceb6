#include "server/net/http.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <exception>
#include <optional>
#include <stop_token>
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

constexpr char kRetrySeconds[] = "5";     // after which who found us busy may ask again
constexpr std::size_t kSlowest = 65'536;  // bytes a second that a reader must take of a long answer

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
    request.acceptEncoding = view(header[http::field::accept_encoding]);
    Answer a = answer(request, *shared_->directory, RIDGECAST_VERSION, shared_->routes);
    const bool hasBody = parser_->chunked() || parser_->content_length().value_or(0) > 0;
    if (request.upgrade && hasBody) return refuse(400, "Something follows the request before the upgrade is answered.");
    keepAlive_ = header.keep_alive() && !hasBody && ++answered_ < 1000;
    head_ = header.method() == http::verb::head;
    ifNoneMatch_ = header[http::field::if_none_match];
    if (a.later && !namesEtag(ifNoneMatch_, a.etag)) return work(a.later);
    a.upgradeTo ? upgrade(std::move(a.upgradeTo)) : send(std::move(a));
  }

  void upgrade(std::shared_ptr<session::Session> session) {
    if (buffer_.size() > 0) return refuse(400, "Something follows the request before the upgrade is answered.");
    error_code ignored;
    const auto endpoint = stream_.socket().remote_endpoint(ignored);
    startStream(std::move(stream_), std::move(counted_), shared_, std::move(session), nameOf(endpoint), parser_->release());
  }

  void refuse(unsigned status, std::string sentence) {
    keepAlive_ = head_ = false;
    send(sentenceOf(status, std::move(sentence)));
  }

  static Answer sentenceOf(unsigned status, std::string sentence) {
    Answer a;
    a.status = status;
    a.body = std::move(sentence) + "\n";
    return a;
  }

  void busy() {
    Answer a = sentenceOf(503, "This server is busy with the work of others; ask again in " + std::string(kRetrySeconds) + " seconds.");
    a.headers = {{"Retry-After", kRetrySeconds}};
    send(std::move(a));
  }

  // Work for an answer, watching meanwhile whether the asker is still there.
  void work(std::shared_ptr<const Later> later) {
    if (later->patient && shared_->answerBytes > shared_->settings.maxAnswerBytes) return busy();
    asker_ = std::stop_source();
    auto run = [self = shared_from_this(), later](std::stop_token stop) {
      Answer a;
      try {
        a = later->work(stop);
      } catch (const std::exception& e) {
        spdlog::error("work for an answer failed: {}", e.what());
        a = sentenceOf(500, "The server failed at this; its log says why.");
      }
      self->shared_->answerBytes += a.body.size();
      auto done = std::make_shared<Answer>(std::move(a));
      asio::post(self->stream_.get_executor(), [self, done] { self->worked(std::move(*done)); });
    };
    if (!(later->patient ? shared_->patientJobs : shared_->promptJobs).post(asker_, std::move(run))) return busy();
    working_ = true;
    stream_.expires_never();
    watch();
  }

  void watch() {
    const std::size_t room = std::min<std::size_t>(4096, buffer_.max_size() - buffer_.size());
    if (room == 0) return;
    watching_ = true;
    stream_.async_read_some(buffer_.prepare(room), [self = shared_from_this()](error_code ec, std::size_t bytes) {
      self->watching_ = false;
      self->buffer_.commit(bytes);
      if (self->made_) return self->worked(std::move(*std::exchange(self->made_, {})));
      if (!self->working_) return;
      if (!ec) return self->watch();  // the next request, early
      self->asker_.request_stop();
      self->close();
    });
  }

  void worked(Answer a) {
    if (watching_) {  // one reader at a time: its end sends the answer
      made_ = std::move(a);
      stream_.cancel();
      return;
    }
    working_ = false;
    const std::size_t bytes = a.body.size();
    if (asker_.stop_requested()) {
      shared_->answerBytes -= bytes;
      return close();
    }
    answerBytes_ = bytes;
    if (!a.upgradeTo) return send(std::move(a));
    stream_.expires_never();
    upgrade(std::move(a.upgradeTo));
  }

  void send(Answer a) {
    const bool known = a.status == 200 && namesEtag(ifNoneMatch_, a.etag);
    if (known) {
      a.status = 304;
      a.body.clear();
    }
    http::response<http::string_body> response(static_cast<http::status>(a.status), 11);
    response.set(http::field::server, kServerName);
    if (!known) response.set(http::field::content_type, a.type);
    response.set(http::field::cache_control, a.etag.empty() ? "no-store" : "no-cache");
    if (!a.etag.empty()) response.set(http::field::etag, '"' + a.etag + '"');
    response.set("X-Content-Type-Options", "nosniff");
    response.keep_alive(keepAlive_);
    for (const auto& [name, value] : a.headers) response.set(name, value);
    response.body() = std::move(a.body);
    if (!known) response.prepare_payload();
    if (head_) response.body().clear();
    response_ = std::move(response);
    serializer_.emplace(response_);
    serializer_->split(head_);
    patienceEnds_ =
        std::chrono::steady_clock::now() + shared_->settings.patience + std::chrono::seconds(response_.body().size() / kSlowest);
    if (head_) {
      stream_.expires_after(shared_->settings.patience);
      http::async_write_header(stream_, *serializer_, [self = shared_from_this()](error_code ec, std::size_t) { self->sent(ec); });
    } else {
      write();
    }
  }

  // A piece at a time: who takes no piece for too long, or takes all of them too slowly, is not waited for.
  void write() {
    stream_.expires_at(std::min(patienceEnds_, std::chrono::steady_clock::now() + shared_->settings.patience));
    http::async_write_some(stream_, *serializer_, [self = shared_from_this()](error_code ec, std::size_t) {
      ec || self->serializer_->is_done() ? self->sent(ec) : self->write();
    });
  }

  void sent(error_code ec) {
    shared_->answerBytes -= std::exchange(answerBytes_, 0);
    serializer_.reset();
    response_ = {};
    if (ec) return close();
    keepAlive_ ? read() : closePolitely();
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

  // Of the request that is being answered.
  bool keepAlive_ = false, head_ = false;
  std::string ifNoneMatch_;
  std::chrono::steady_clock::time_point patienceEnds_;
  // While work is done for it.
  std::stop_source asker_{std::nostopstate};
  bool working_ = false, watching_ = false;
  std::optional<Answer> made_;
  std::size_t answerBytes_ = 0;  // what this answer adds to the shared number
};

}  // namespace

void startHttp(tcp::socket&& socket, Counted counted, std::shared_ptr<Shared> shared) {
  std::make_shared<HttpConnection>(std::move(socket), std::move(counted), std::move(shared))->start();
}

}  // namespace ridgecast::net
