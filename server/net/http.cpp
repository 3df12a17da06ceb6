#include "server/net/http.h"

#include <algorithm>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <exception>
#include <optional>
#include <stop_token>
#include <utility>

#include "common/outcome/contract.h"
#include "common/transport/channel.h"
#include "server/http/routes.h"
#include "server/logging/logging.h"
#include "server/net/stream.h"

namespace ridgecast::net {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;
using beast::error_code;

using Clock = std::chrono::steady_clock;
double seconds(Clock::duration time) { return std::chrono::duration<double>(time).count(); }

constexpr std::chrono::seconds kTurnedTimeout{2};     // timeout for the request of a connection beyond a limit
constexpr std::chrono::milliseconds kTellEvery{700};  // interval of progress messages
constexpr std::size_t kSlowest = 65'536;              // bytes a second that a client must read of a long answer, or send of a body

// A connection before it is a stream: requests and answers, one after another.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(tcp::socket&& socket, ConnectionSlot slot, std::shared_ptr<ServerContext> shared)
      : peer_(addressOf(endpointOf(socket))),
        peerName_(nameOf(endpointOf(socket))),
        stream_(noDelay(std::move(socket))),
        slot_(std::move(slot)),
        shared_(std::move(shared)),
        buffer_(shared_->settings.maxHeaderBytes + 4096),
        ticking_(stream_.get_executor()) {}

  void start() {
    asio::dispatch(stream_.get_executor(), [self = shared_from_this()] { self->begin(); });
  }

 private:
  static tcp::endpoint endpointOf(const tcp::socket& socket) {
    error_code ignored;
    return socket.remote_endpoint(ignored);
  }
  // The values of all lines of this name, in order, as one list.
  static std::string allOf(const beast::http::fields& fields, beast::string_view name) {
    std::string all;
    for (auto [line, end] = fields.equal_range(name); line != end; ++line) all.append(all.empty() ? "" : ",").append(line->value());
    return all;
  }
  static tcp::socket&& noDelay(tcp::socket&& socket) {
    error_code ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    return std::move(socket);
  }

  void begin() {
    std::shared_ptr<TlsContext> tls;
    {
      const std::lock_guard lock(shared_->mutex);
      tls = shared_->tls;
    }
    if (!tls || slot_.kind() == ConnectionSlot::Kind::kAdmin) return read();
    stream_.expires_after(timeout());
    stream_.startTls(std::move(tls), Channel::Done([self = shared_from_this()](error_code ec, std::size_t) {
                       self->clear_ = ec == asio::error::no_protocol_option;
                       self->hasTls_ = !ec;
                       if (!ec) self->shared_->figures->tlsHandshakes.Increment();
                       if (!ec || self->clear_) return self->read();
                       self->shared_->figures->refused(metrics::Refusal::kTls);
                       self->close();
                     }));
  }

  std::chrono::milliseconds timeout() const {
    const std::chrono::milliseconds usual = shared_->settings.timeout;
    return slot_.kind() == ConnectionSlot::Kind::kServed ? usual : std::min<std::chrono::milliseconds>(usual, kTurnedTimeout);
  }

  void read() {
    parser_.emplace();
    parser_->header_limit(shared_->settings.maxHeaderBytes);
    parser_->body_limit(boost::none);  // who reads a body has a limit
    stream_.expires_after(timeout());
    beast::http::async_read_header(stream_, buffer_, *parser_,
                                   [self = shared_from_this()](error_code ec, std::size_t) { self->hasRead(ec); });
  }

  void hasRead(error_code ec) {
    if (ec == beast::http::error::header_limit || ec == beast::http::error::buffer_overflow)
      return refuse(431, metrics::Refusal::kHeader,
                    "The request's header has more than " + std::to_string(shared_->settings.maxHeaderBytes) + " bytes, the limit.");
    if (ec && ec != beast::http::error::end_of_stream && ec != beast::http::error::partial_message &&
        ec.category() == beast::http::make_error_code(beast::http::error::bad_method).category())
      return refuse(400, metrics::Refusal::kRequest, "This is not an HTTP request (" + ec.message() + ").");
    if (ec == asio::error::operation_aborted && answered_ == 0) shared_->figures->refused(metrics::Refusal::kTimeout);
    if (ec) return close();
    const Settings& settings = shared_->settings;
    if (clear_) return refuse(400, metrics::Refusal::kTls, "This port speaks TLS: use https:// or wss://.");
    if (slot_.kind() == ConnectionSlot::Kind::kAdmin) return answerAdmin();
    if (slot_.kind() == ConnectionSlot::Kind::kTooMany)
      return refuse(503, {}, "This server has " + std::to_string(settings.maxConnections) + " connections, its limit; try again later.");
    if (slot_.kind() == ConnectionSlot::Kind::kTooManyOfAddress) return refuseAddress();

    const auto& header = parser_->get();
    Request request = requestOf(header);
    access::Address client = peer_;
    if (!settings.trustedProxies.empty()) {
      client = access::clientAddress(peer_, allOf(header, "X-Forwarded-For"), settings.trustedProxies);
      if (client != peer_) peerName_ = access::toText(client);
      if (!slot_.belongsTo(client)) {
        shared_->figures->refused(metrics::Refusal::kAddress);
        return refuseAddress();
      }
    }
    request.isSecure = hasTls_ || (client != peer_ && header["X-Forwarded-Proto"] == "https");
    auto judged = shared_->filter.judge(request);
    const auto* grant = std::get_if<access::Grant>(&judged);
    who_ = slot_.client(grant ? *grant : access::Grant());
    request.client = who_;
    if (grant) request.rights = grant->rights;
    Answer a = grant ? answer(request, *shared_->directory, RIDGECAST_VERSION, shared_->routes) : std::get<Answer>(std::move(judged));
    grant_ = grant ? *grant : access::Grant();
    const auto session = queryParameter(request.query(), "session");
    sessionName_ = session ? session->substr(0, 100) : std::string();
    if (request.upgrade && hasBody())
      return refuse(400, metrics::Refusal::kRequest, "Something follows the request before the upgrade is answered.");
    setAside(a.ofBody != nullptr);
    ifNoneMatch_ = header[beast::http::field::if_none_match];
    wantsProgress_ = header.version() == 11 && header["Prefer"].find("progress") != beast::string_view::npos;
    proceed(std::move(a));
  }

  // One step after another, to the answer itself.
  void proceed(Answer a) {
    if (a.ofBody) return readBody(std::move(a.ofBody));
    if (a.later && !namesEtag(ifNoneMatch_, a.etag)) return work(std::move(a.later));
    a.upgradeTo ? upgrade(std::move(a.upgradeTo)) : send(std::move(a));
  }

  void readBody(std::shared_ptr<const BodyHandler> ofBody) {
    const std::uint64_t length = parser_->content_length().value_or(parser_->chunked() ? ofBody->most : 0);
    if (length > ofBody->most) return refuse(413, metrics::Refusal::kRequest, ofBody->tooLong);
    room_.emplace(shared_->bodies, who_);
    const bool waits = parser_->get()[beast::http::field::expect] == "100-continue";
    body_.emplace(std::move(*parser_));
    body_->body_limit(ofBody->most);
    body_->eager(true);
    stream_.expires_after(shared_->settings.timeout + std::chrono::seconds(length / kSlowest));
    if (!waits || body_->is_done()) return readMore(std::move(ofBody));
    word_ = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(word_), [self = shared_from_this(), ofBody = std::move(ofBody)](error_code ec, std::size_t) {
      ec ? self->close() : self->readMore(ofBody);
    });
  }

  // Takes room for what has come, and for nothing that was only announced.
  void readMore(std::shared_ptr<const BodyHandler> ofBody) {
    if (const auto full = room_->growTo(body_->get().body().size())) {
      keepAlive_ = false;
      const bool isOwn = *full == RequestBodyBudget::Full::kShare;
      return send(refused(isOwn ? 429 : 503, metrics::Refusal::kBusy,
                          (isOwn ? "The " + who_ + " is sending" : "This server's clients are sending") +
                              std::string(" as many bytes of requests as may be open; try again when some have been answered."),
                          {{"Retry-After", "1"}}));
    }
    if (body_->is_done()) return hasReadBody({}, std::move(ofBody));
    beast::http::async_read_some(stream_, buffer_, *body_,
                                 [self = shared_from_this(), ofBody = std::move(ofBody)](error_code ec, std::size_t) {
                                   ec ? self->hasReadBody(ec, ofBody) : self->readMore(ofBody);
                                 });
  }

  void hasReadBody(error_code ec, std::shared_ptr<const BodyHandler> ofBody) {
    if (ec == beast::http::error::body_limit) return refuse(413, metrics::Refusal::kRequest, ofBody->tooLong);
    if (ec.category() == beast::http::make_error_code(beast::http::error::bad_method).category())
      return refuse(400, metrics::Refusal::kRequest, "The body is not whole (" + ec.message() + ").");
    if (ec == asio::error::operation_aborted) shared_->figures->refused(metrics::Refusal::kTimeout);
    if (ec) return close();
    // The work's thread reads it: two MiB of JSON would keep a socket's thread from all its other clients.
    work(std::make_shared<DeferredResponse>(
        DeferredResponse{.work = [body = std::make_shared<std::string>(std::move(body_->get().body())),
                                  ofBody = std::move(ofBody)](const std::stop_token&) { return ofBody->answer(std::move(*body)); }}));
  }

  bool hasBody() const { return parser_->chunked() || parser_->content_length().value_or(0) > 0; }

  // What the answer needs of the request.
  void setAside(bool readsBody = false) {
    keepAlive_ = parser_->keep_alive() && shared_->ready && (readsBody || !hasBody()) && ++answered_ < 1000;
    head_ = parser_->get().method() == beast::http::verb::head;
    path_ = requestOf(parser_->get()).path().substr(0, 100);
  }

  // The admin port serves those who operate the server, under any name and without tokens.
  void answerAdmin() {
    const Request request = requestOf(parser_->get());
    const std::string_view path = request.path();
    setAside();
    if (path == "/healthz" || path == "/readyz" || path == "/metrics" || path == "/version")
      return send(answer(request, *shared_->directory, RIDGECAST_VERSION, shared_->routes));
    send(plain(404, "The admin port has only /healthz, /readyz, /metrics and /version."));
  }

  void upgrade(std::shared_ptr<session::Session> session) {
    if (!shared_->takesStreams)
      return send(refused(503, metrics::Refusal::kDraining, "This server is leaving; connect again.", {{"Retry-After", "1"}}));
    if (buffer_.size() > 0) return refuse(400, metrics::Refusal::kRequest, "Something follows the request before the upgrade is answered.");
    startStream(std::move(stream_), std::move(slot_), shared_, std::move(session), peerName_, std::move(grant_), parser_->release());
  }

  void refuseAddress() {
    refuse(429, {},
           "Your address has " + std::to_string(shared_->settings.maxConnectionsPerAddress) +
               " connections, the most it may have; close one first.");
  }

  void refuse(unsigned status, std::optional<metrics::Refusal> reason, std::string sentence) {
    keepAlive_ = head_ = false;
    Answer a = plain(status, std::move(sentence));
    a.refusal = reason;
    send(std::move(a));
  }

  void busy(const Jobs& jobs) {
    const std::string seconds = std::to_string(jobs.secondsToWait());
    send(refused(503, metrics::Refusal::kBusy, "This server is busy with other work; try again in " + seconds + " seconds.",
                 {{"Retry-After", seconds}}));
  }

  void hasShare(const Jobs& jobs) {
    send(refused(429, metrics::Refusal::kBusy,
                 "The " + who_ + " waits for " + std::to_string(jobs.share()) +
                     " answers of this kind, the most one client may; try again when one has come.",
                 {{"Retry-After", std::to_string(jobs.secondsToWait())}}));
  }

  Work& queueFor(const DeferredResponse& later) {
    return later.makesWorld ? shared_->worlds : later.patient ? shared_->patient : later.isTile ? shared_->tiles : shared_->prompt;
  }

  // Does the work for an answer and watches meanwhile whether the client is still there.
  void work(std::shared_ptr<const DeferredResponse> later) {
    asker_ = std::stop_source();
    auto& [jobs, figures] = queueFor(*later);
    if ((later->patient || later->isTile) && shared_->answerBytes > shared_->settings.maxAnswerBytes) return busy(jobs);
    auto run = [self = shared_from_this(), later, &jobs = jobs, &figures = figures, posted = Clock::now(),
                worked = std::optional<Clock::duration>()](std::stop_token stop) mutable -> Jobs::Again {
      const Clock::time_point begun = Clock::now();
      if (!worked) figures.wait.Observe(seconds(begun - posted));
      Answer a;
      try {
        a = later->work(stop);
      } catch (const std::exception& e) {
        logging::error(std::string("work for an answer failed: ") + e.what());
        a = plain(500, "The server failed at this; its log says why.");
      }
      worked = worked.value_or(Clock::duration{}) + (Clock::now() - begun);
      if (a.again) return a.again;
      if (a.later && a.etag.empty() && &self->queueFor(*a.later).jobs == &jobs) {  // it goes on in its place
        later = std::move(a.later);
        return Clock::now();
      }
      if (a.whenWoken) {
        a.whenWoken([shared = std::weak_ptr(self->shared_), &jobs, asker = self->asker_] {
          if (const auto there = shared.lock()) jobs.wake(asker);
        });
        return Jobs::kWhenWoken;
      }
      figures.seconds.Observe(seconds(*worked));
      jobs.answered(self->asker_);
      self->shared_->answerBytes += a.body.size();
      asio::post(self->stream_.get_executor(), [self, a = std::move(a)]() mutable { self->worked(std::move(a)); });
      return {};
    };
    if (!jobs.post(asker_, std::move(run), who_)) return jobs.hasShare(who_) ? hasShare(jobs) : busy(jobs);
    working_ = true;
    stream_.expires_never();
    watch();
    if (wantsProgress_ && later->progress) tick(jobs, std::move(later));
  }

  // Reports progress at intervals. The reports fit into the socket's buffer, so they never wait for the client.
  void tick(const Jobs& jobs, std::shared_ptr<const DeferredResponse> later) {
    ticking_.expires_after(kTellEvery);
    ticking_.async_wait([self = shared_from_this(), &jobs, later = std::move(later)](error_code ec) mutable {
      if (ec || !self->working_ || self->made_) return;
      const std::size_t ahead = jobs.ahead(self->asker_);
      self->word_ =
          "HTTP/1.1 102 Processing\r\nProgress: " + (ahead > 0 ? "number " + std::to_string(ahead) + " in the queue" : later->progress()) +
          "\r\n\r\n";
      self->telling_ = true;
      asio::async_write(self->stream_, asio::buffer(self->word_),
                        [self, &jobs, later = std::move(later)](error_code failed, std::size_t bytes) mutable {
                          self->telling_ = false;
                          self->shared_->figures->bytesSent.Increment(bytes);
                          if (self->made_) return self->worked(std::move(*std::exchange(self->made_, {})));
                          if (!failed && self->working_) self->tick(jobs, std::move(later));
                        });
    });
  }

  void watch() {
    const std::size_t room = std::min<std::size_t>(4096, buffer_.max_size() - buffer_.size());
    if (room == 0) return;
    watching_ = true;
    stream_.async_read_some(buffer_.prepare(room), [self = shared_from_this()](error_code ec, std::size_t bytes) {
      self->watching_ = false;
      self->buffer_.commit(bytes);
      if (self->made_ && !self->telling_) return self->worked(std::move(*std::exchange(self->made_, {})));
      if (!self->working_) return;
      if (!ec) return self->watch();  // the next request, early
      self->asker_.request_stop();
      self->close();
    });
  }

  void worked(Answer a) {
    expects(working_, "an answer is to a request that waits for it");
    ticking_.cancel();
    if (telling_) {  // one write at a time: continues when it ends
      made_ = std::move(a);
      return;
    }
    if (watching_) {  // one read at a time: sends the answer when it ends
      made_ = std::move(a);
      stream_.cancel();
      return;
    }
    working_ = false;
    const std::size_t bytes = a.body.size();
    if (asker_.stop_requested()) {
      forget(bytes);
      return close();
    }
    answerBytes_ = bytes;
    if (a.upgradeTo) stream_.expires_never();
    proceed(std::move(a));
  }

  void send(Answer a) {
    if (a.refusal) {
      shared_->figures->refused(*a.refusal);
      logging::info({.session = sessionName_,
                     .peer = peerName_,
                     .holder = grant_.name.empty() ? a.holder : grant_.name,
                     .event = "refused",
                     .reason = metrics::name(*a.refusal),
                     .path = path_,
                     .status = a.status},
                    "is refused with " + std::to_string(a.status) + ": " + a.body.substr(0, a.body.find('\n')));
    }
    const bool known = a.status == 200 && namesEtag(ifNoneMatch_, a.etag);
    if (known) {
      a.status = 304;
      a.body.clear();
    }
    beast::http::response<beast::http::string_body> response(static_cast<beast::http::status>(a.status), 11);
    response.set(beast::http::field::server, kServerName);
    if (!known) response.set(beast::http::field::content_type, a.type);
    response.set(beast::http::field::cache_control, a.etag.empty() ? "no-store" : "no-cache");
    if (!a.etag.empty()) response.set(beast::http::field::etag, '"' + a.etag + '"');
    response.set("X-Content-Type-Options", "nosniff");
    response.keep_alive(keepAlive_);
    for (const auto& [name, value] : a.headers) response.set(name, value);
    response.body() = std::move(a.body);
    if (!known) response.prepare_payload();
    if (head_) response.body().clear();
    response_ = std::move(response);
    serializer_.emplace(response_);
    serializer_->split(head_);
    timeoutEnds_ = std::chrono::steady_clock::now() + shared_->settings.timeout + std::chrono::seconds(response_.body().size() / kSlowest);
    if (head_) {
      stream_.expires_after(shared_->settings.timeout);
      beast::http::async_write_header(stream_, *serializer_, [self = shared_from_this()](error_code ec, std::size_t) { self->sent(ec); });
    } else {
      write();
    }
  }

  // Writes a piece at a time. Closes if the client takes a piece too late, or all of them too slowly.
  void write() {
    stream_.expires_at(std::min(timeoutEnds_, std::chrono::steady_clock::now() + shared_->settings.timeout));
    beast::http::async_write_some(stream_, *serializer_, [self = shared_from_this()](error_code ec, std::size_t bytes) {
      self->shared_->figures->bytesSent.Increment(bytes);
      ec || self->serializer_->is_done() ? self->sent(ec) : self->write();
    });
  }

  void sent(error_code ec) {
    shared_->figures->answered(routeOf(path_), response_.result_int());
    if (const std::size_t bytes = std::exchange(answerBytes_, 0)) forget(bytes);
    room_.reset();
    body_.reset();
    serializer_.reset();
    response_ = {};
    if (ec) return close();
    keepAlive_ ? read() : closePolitely();
  }

  void forget(std::size_t bytes) {
    {
      const std::lock_guard lock(shared_->mutex);
      expects(shared_->answerBytes.fetch_sub(bytes) >= bytes, "an answer that is sent was counted");
    }
    shared_->fewer.notify_all();
  }

  // Shuts down writing and discards what the client still sends for a moment: closing with unread bytes would reset the connection and
  // could lose the answer.
  void closePolitely() {
    stream_.expires_after(std::chrono::seconds(1));
    stream_.finish(Channel::Done([self = shared_from_this()](error_code, std::size_t) { self->close(); }));
  }
  void close() { stream_.close(); }

  const access::Address peer_;
  std::string peerName_;  // behind a trusted proxy: its client's name
  Channel stream_;
  bool hasTls_ = false, clear_ = false;  // clear: plain text on a port that speaks TLS
  ConnectionSlot slot_;
  const std::shared_ptr<ServerContext> shared_;
  beast::flat_buffer buffer_;
  std::optional<beast::http::request_parser<beast::http::empty_body>> parser_;
  beast::http::response<beast::http::string_body> response_;
  std::optional<beast::http::response_serializer<beast::http::string_body>> serializer_;
  int answered_ = 0;

  // Of the current request.
  access::Grant grant_;
  std::string who_;  // the client, as Request::client
  std::optional<beast::http::request_parser<beast::http::string_body>> body_;
  std::optional<RequestBodyBudget::Room> room_;  // for it
  std::string path_;                             // for metrics and log, at most 100 bytes
  std::string sessionName_;                      // the session's name as received, for the log
  bool keepAlive_ = false, head_ = false;
  std::string ifNoneMatch_;
  std::chrono::steady_clock::time_point timeoutEnds_;
  // While work is done for it.
  std::stop_source asker_{std::nostopstate};
  asio::steady_timer ticking_;
  std::string word_;  // the progress report being written
  bool working_ = false, watching_ = false, telling_ = false, wantsProgress_ = false;
  std::optional<Answer> made_;
  std::size_t answerBytes_ = 0;  // this answer's share of the common number
};

}  // namespace

void startHttp(tcp::socket&& socket, ConnectionSlot slot, std::shared_ptr<ServerContext> shared) {
  std::make_shared<HttpConnection>(std::move(socket), std::move(slot), std::move(shared))->start();
}

}  // namespace ridgecast::net
