#include "server/net/http.h"

#include <algorithm>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
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
constexpr std::chrono::seconds kFinishTimeout{1};     // for a client that still sends after the last answer
constexpr std::chrono::milliseconds kTellEvery{700};  // interval of progress messages
constexpr std::size_t kSlowest = 65'536;              // bytes a second that a client must read of a long answer, or send of a body
constexpr int kMaxRequests = 1000;                    // of a connection
constexpr std::size_t kMaxLogged = 500;               // bytes of a refusal's sentence, which may quote the request

constexpr auto kTuple = asio::as_tuple(asio::use_awaitable);  // co_await gives (error_code, ...)

// The values of all lines of this name, in order, as one list.
std::string allOf(const beast::http::fields& fields, beast::string_view name) {
  std::string all;
  for (auto [line, end] = fields.equal_range(name); line != end; ++line) all.append(all.empty() ? "" : ",").append(line->value());
  return all;
}

bool isOfHttp(error_code ec) { return ec.category() == beast::http::make_error_code(beast::http::error::bad_method).category(); }

// What a connection keeps from one exchange to the next.
struct Connection {
  Connection(tcp::socket&& socket, const tcp::endpoint& endpoint, ConnectionSlot s, std::shared_ptr<ServerContext> context)
      : peer(addressOf(endpoint)),
        peerName(nameOf(endpoint)),
        stream(std::move(socket)),
        slot(std::move(s)),
        shared(std::move(context)),
        buffer(shared->settings.maxHeaderBytes + 4096) {}

  std::chrono::milliseconds timeout() const {
    const std::chrono::milliseconds usual = shared->settings.timeout;
    return slot.kind() == ConnectionSlot::Kind::kServed ? usual : std::min<std::chrono::milliseconds>(usual, kTurnedTimeout);
  }
  // Starts what ends with Channel::Done.
  template <class Start>
  asio::awaitable<error_code> done(Start start) {
    const auto [ec, bytes] = co_await asio::async_initiate<decltype(kTuple), void(error_code, std::size_t)>(
        [start](auto handler) { start(Channel::Done(std::move(handler))); }, kTuple);
    co_return ec;
  }

  enum class Security { kNone, kTls, kMissing };  // kMissing: plain text on a port that speaks TLS

  const access::Address peer;
  std::string peerName;  // behind a trusted proxy: its client's name
  Channel stream;
  Security security = Security::kNone;
  ConnectionSlot slot;
  const std::shared_ptr<ServerContext> shared;
  beast::flat_buffer buffer;
  int requests = 0;  // that another may follow
};

// A reply that work makes. The work has it, too: it may end after the client has left, and the exchange with it. On the connection's
// strand except `asker`.
struct Awaited {
  explicit Awaited(const asio::any_io_executor& strand) : changed(strand) {}
  bool isOver() const { return reply || asker.stop_requested(); }

  std::stop_source asker;      // stopped when the client leaves
  asio::steady_timer changed;  // cancelled when it is over
  std::optional<Reply> reply;
  std::shared_ptr<const void> unsent;  // its body, counted
};

// A request and its answer. Each reply says what leads to the next, until one is the answer. No reply: the client has left, or has become
// a stream.
//
//   header --> Reply -- Answer ------------> sent
//                ^  |-- Upgrade -----------> becomes a stream
//                |  |-- BodyHandler -------> the body is read
//                |  '-- DeferredResponse --> the work is done, while the client is watched and told
//                '----------------------------'
class Exchange {
 public:
  explicit Exchange(Connection& c) : c_(c), shared_(*c.shared) {}

  enum class End { kNext, kFinish, kClose };  // another may follow; this was the last; nothing is left to say
  asio::awaitable<End> run() {
    parser_.header_limit(shared_.settings.maxHeaderBytes);
    parser_.body_limit(boost::none);  // who reads a body has a limit
    c_.stream.expires_after(c_.timeout());
    const auto [ec, bytes] = co_await beast::http::async_read_header(c_.stream, c_.buffer, parser_, kTuple);
    std::optional<Reply> reply = replyTo(ec);
    while (reply && !std::holds_alternative<Answer>(*reply)) reply = co_await next(std::move(*reply));
    if (!reply) co_return End::kClose;
    co_return co_await send(std::get<Answer>(std::move(*reply)));
  }

 private:
  std::optional<Reply> replyTo(error_code ec) {
    if (ec == beast::http::error::header_limit || ec == beast::http::error::buffer_overflow)
      return refused(431, metrics::Refusal::kHeader,
                     "The request's header has more than " + std::to_string(shared_.settings.maxHeaderBytes) + " bytes, the limit.");
    if (isOfHttp(ec) && ec != beast::http::error::end_of_stream && ec != beast::http::error::partial_message)
      return refused(400, metrics::Refusal::kRequest, "This is not an HTTP request (" + ec.message() + ").");
    if (ec == asio::error::operation_aborted && c_.requests == 0) shared_.figures->refused(metrics::Refusal::kTimeout);
    if (ec) return {};
    if (c_.security == Connection::Security::kMissing)
      return refused(400, metrics::Refusal::kTls, "This port speaks TLS: use https:// or wss://.");
    const ConnectionSlot::Kind kind = c_.slot.kind();
    if (kind == ConnectionSlot::Kind::kAdmin) return adminReply();
    if (kind == ConnectionSlot::Kind::kTooManyOfAddress) return tooManyOfAddress();
    if (kind == ConnectionSlot::Kind::kTooMany)
      return plain(503, "This server has " + std::to_string(shared_.settings.maxConnections) + " connections, its limit; try again later.");
    return clientReply();
  }

  Reply clientReply() {
    const auto& header = parser_.get();
    Request request = requestOf(header);
    access::Address client = c_.peer;
    if (!shared_.settings.trustedProxies.empty()) {
      client = access::clientAddress(c_.peer, allOf(header, "X-Forwarded-For"), shared_.settings.trustedProxies);
      if (client != c_.peer) c_.peerName = access::toText(client);
      if (!c_.slot.belongsTo(client)) {
        shared_.figures->refused(metrics::Refusal::kAddress);
        return tooManyOfAddress();
      }
    }
    request.isSecure = c_.security == Connection::Security::kTls || (client != c_.peer && header["X-Forwarded-Proto"] == "https");
    auto judged = shared_.filter.judge(request);
    const auto* grant = std::get_if<access::Grant>(&judged);
    if (grant) grant_ = *grant;
    who_ = c_.slot.client(grant_);
    request.client = who_;
    if (grant) request.rights = grant->rights;
    Reply reply =
        grant ? answer(request, *shared_.directory, RIDGECAST_VERSION, shared_.routes) : Reply(std::get<Answer>(std::move(judged)));
    const auto session = queryParameter(request.query(), "session");
    sessionName_ = session ? session->substr(0, 100) : std::string();
    if (request.upgrade && hasBody())
      return refused(400, metrics::Refusal::kRequest, "Something follows the request before the upgrade is answered.");
    setAside();
    ifNoneMatch_ = header[beast::http::field::if_none_match];
    wantsProgress_ = header.version() == 11 && header["Prefer"].find("progress") != beast::string_view::npos;
    return reply;
  }

  // The admin port serves those who operate the server, under any name and without tokens.
  Reply adminReply() {
    const Request request = requestOf(parser_.get());
    const std::string_view path = request.path();
    setAside();
    if (path == "/healthz" || path == "/readyz" || path == "/metrics" || path == "/version")
      return answer(request, *shared_.directory, RIDGECAST_VERSION, shared_.routes);
    return plain(404, "The admin port has only /healthz, /readyz, /metrics and /version.");
  }

  bool hasBody() const { return parser_.chunked() || parser_.content_length().value_or(0) > 0; }

  bool mayKeepAlive() const { return parser_.keep_alive() && shared_.ready && c_.requests < kMaxRequests; }

  // What the answer needs of the request.
  void setAside() {
    ++c_.requests;
    keepAlive_ = mayKeepAlive() && !hasBody();
    head_ = parser_.get().method() == beast::http::verb::head;
    path_ = requestOf(parser_.get()).path().substr(0, 100);
  }

  Answer tooManyOfAddress() const {
    return plain(429, "Your address has " + std::to_string(shared_.settings.maxConnectionsPerAddress) +
                          " connections, the most it may have; close one first.");
  }

  asio::awaitable<std::optional<Reply>> next(Reply reply) {
    if (auto* body = std::get_if<BodyHandler>(&reply)) co_return co_await read(std::move(*body));
    if (auto* upgrade = std::get_if<Upgrade>(&reply)) co_return becomeStream(std::move(upgrade->session));
    auto* later = std::get_if<DeferredResponse>(&reply);
    expects(later, "only work takes turns");
    if (namesEtag(ifNoneMatch_, later->unchanged.etag)) co_return std::move(later->unchanged);
    co_return co_await work(std::move(*later));
  }

  asio::awaitable<std::optional<Reply>> read(BodyHandler handler) {
    expects(handler.answer && !room_, "a body is read once, for an answer");
    const std::uint64_t length = parser_.content_length().value_or(parser_.chunked() ? handler.maxBytes : 0);
    if (length > handler.maxBytes) co_return refused(413, metrics::Refusal::kRequest, handler.tooLong);
    room_ = std::make_shared<RequestBodyBudget::Room>(shared_.bodies, who_);
    const bool keepAlive = mayKeepAlive(), waits = parser_.get()[beast::http::field::expect] == "100-continue";
    beast::http::request_parser<beast::http::string_body> body(std::move(parser_));
    body.body_limit(handler.maxBytes);
    body.eager(true);
    c_.stream.expires_after(shared_.settings.timeout + std::chrono::seconds(length / kSlowest));
    error_code ec;
    if (waits && !body.is_done()) {
      static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
      std::tie(ec, std::ignore) = co_await asio::async_write(c_.stream, asio::buffer(kContinue), kTuple);
      if (ec) co_return std::nullopt;
    }
    for (;;) {
      // Takes room for what has come, and for nothing that was only announced.
      if (const auto full = room_->growTo(body.get().body().size())) co_return tooManyBytes(*full);
      if (body.is_done()) break;
      std::tie(ec, std::ignore) = co_await beast::http::async_read_some(c_.stream, c_.buffer, body, kTuple);
      if (ec == beast::http::error::body_limit) co_return refused(413, metrics::Refusal::kRequest, handler.tooLong);
      if (isOfHttp(ec)) co_return refused(400, metrics::Refusal::kRequest, "The body is not whole (" + ec.message() + ").");
      if (ec == asio::error::operation_aborted) shared_.figures->refused(metrics::Refusal::kTimeout);
      if (ec) co_return std::nullopt;
    }
    keepAlive_ = keepAlive;
    // The work's thread reads it: two MiB of JSON would keep a socket's thread from all its other clients.
    co_return DeferredResponse{.work = [text = std::make_shared<std::string>(std::move(body.get().body())),
                                        handler = std::move(handler)](const Turn&) { return handler.answer(std::move(*text)); }};
  }

  Answer tooManyBytes(RequestBodyBudget::Full full) const {
    const bool isOwn = full == RequestBodyBudget::Full::kShare;
    return refused(isOwn ? 429 : 503, metrics::Refusal::kBusy,
                   (isOwn ? "The " + who_ + " is sending" : "This server's clients are sending") +
                       std::string(" as many bytes of requests as may be open; try again when some have been answered."),
                   {{"Retry-After", "1"}});
  }

  std::optional<Reply> becomeStream(std::shared_ptr<session::Session> session) {
    if (!shared_.takesStreams)
      return refused(503, metrics::Refusal::kDraining, "This server is leaving; connect again.", {{"Retry-After", "1"}});
    keepAlive_ = false;
    if (c_.buffer.size() > 0)
      return refused(400, metrics::Refusal::kRequest, "Something follows the request before the upgrade is answered.");
    expects(session != nullptr, "a stream is in a session");
    startStream(std::move(c_.stream), std::move(c_.slot), c_.shared, std::move(session), c_.peerName, std::move(grant_), parser_.release());
    return {};
  }

  // Does the work for a reply, and watches meanwhile whether the client is still there.
  asio::awaitable<std::optional<Reply>> work(DeferredResponse later) {
    expects(static_cast<bool>(later.work), "what is deferred can be done");
    Work& queue = shared_.work(later.queue);
    const bool isLarge = later.queue == Queue::kPatient || later.queue == Queue::kTiles;
    if (isLarge && shared_.unsent->bytes() > shared_.settings.maxAnswerBytes) co_return busy(queue.jobs);
    const auto progress = wantsProgress_ ? later.progress : nullptr;
    const auto awaited = std::make_shared<Awaited>(c_.stream.get_executor());
    if (!queue.jobs.post(awaited->asker, turns(queue, std::move(later), awaited), who_))
      co_return queue.jobs.hasShare(who_) ? hasShare(queue.jobs) : busy(queue.jobs);
    c_.stream.expires_never();
    using asio::experimental::awaitable_operators::operator&&;
    co_await (watch(*awaited) && tell(*awaited, queue.jobs, progress));
    if (awaited->asker.stop_requested()) co_return std::nullopt;
    unsent_ = std::move(awaited->unsent);
    co_return std::move(awaited->reply);
  }

  // The work as its queue runs it, until it has made the reply.
  std::function<std::optional<RetryAt>(std::stop_token)> turns(Work& queue, DeferredResponse later, std::shared_ptr<Awaited> awaited) {
    const auto wake = [shared = std::weak_ptr(c_.shared), &queue, asker = awaited->asker] {
      if (const auto there = shared.lock()) queue.jobs.wake(asker);
    };
    return [shared = c_.shared, &queue, later = std::move(later), awaited = std::move(awaited), wake, room = room_, posted = Clock::now(),
            worked = std::optional<Clock::duration>()](std::stop_token stop) mutable -> std::optional<RetryAt> {
      const Clock::time_point begun = Clock::now();
      if (!worked) queue.figures.wait.Observe(seconds(begun - posted));
      Reply reply;
      try {
        reply = later.work({std::move(stop), wake});
      } catch (const std::exception& e) {
        logging::error(std::string("work for an answer failed: ") + e.what());
        reply = plain(500, "The server failed at this; its log says why.");
      }
      worked = worked.value_or(Clock::duration{}) + (Clock::now() - begun);
      if (const auto* retry = std::get_if<RetryAt>(&reply)) return *retry;
      if (auto* next = std::get_if<DeferredResponse>(&reply);
          next && next->unchanged.etag.empty() && &shared->work(next->queue) == &queue) {  // it goes on in its place
        later = std::move(*next);
        return RetryAt{Clock::now()};
      }
      queue.figures.seconds.Observe(seconds(*worked));
      queue.jobs.answered(awaited->asker);
      const auto* answer = std::get_if<Answer>(&reply);
      auto unsent = shared->unsent->count(answer ? answer->body.size() : 0);
      asio::post(awaited->changed.get_executor(), [awaited, unsent = std::move(unsent), reply = std::move(reply)]() mutable {
        awaited->unsent = std::move(unsent);
        awaited->reply = std::move(reply);
        awaited->changed.cancel();
      });
      return {};
    };
  }

  // Reads the next request early, until the reply is there or the client has left. One read at a time: tell() cancels it then.
  asio::awaitable<void> watch(Awaited& awaited) {
    while (!awaited.isOver()) {
      const std::size_t room = std::min<std::size_t>(4096, c_.buffer.max_size() - c_.buffer.size());
      if (room == 0) co_return;
      const auto [ec, bytes] = co_await c_.stream.async_read_some(c_.buffer.prepare(room), kTuple);
      c_.buffer.commit(bytes);
      if (!ec || awaited.reply) continue;
      awaited.asker.request_stop();
      awaited.changed.cancel();
      c_.stream.close();
    }
  }

  // Waits for the reply and reports progress at intervals. The reports fit into the socket's buffer, so they never wait for the client.
  asio::awaitable<void> tell(Awaited& awaited, const Jobs& jobs, std::function<std::string()> progress) {
    while (!awaited.isOver()) {
      awaited.changed.expires_at(progress ? Clock::now() + kTellEvery : Clock::time_point::max());
      co_await awaited.changed.async_wait(kTuple);
      if (awaited.isOver() || !progress) continue;
      const std::size_t ahead = jobs.ahead(awaited.asker);
      const std::string report =
          "HTTP/1.1 102 Processing\r\nProgress: " + (ahead > 0 ? "number " + std::to_string(ahead) + " in the queue" : progress()) +
          "\r\n\r\n";
      const auto [ec, bytes] = co_await asio::async_write(c_.stream, asio::buffer(report), kTuple);
      shared_.figures->bytesSent.Increment(static_cast<double>(bytes));
      if (ec) progress = nullptr;
    }
    c_.stream.cancel();
  }

  static Answer busy(const Jobs& jobs) {
    const std::string seconds = std::to_string(jobs.secondsToWait());
    return refused(503, metrics::Refusal::kBusy, "This server is busy with other work; try again in " + seconds + " seconds.",
                   {{"Retry-After", seconds}});
  }

  Answer hasShare(const Jobs& jobs) const {
    return refused(429, metrics::Refusal::kBusy,
                   "The " + who_ + " waits for " + std::to_string(jobs.share()) +
                       " answers of this kind, the most one client may; try again when one has come.",
                   {{"Retry-After", std::to_string(jobs.secondsToWait())}});
  }

  // Writes a piece at a time. Closes if the client takes a piece too late, or all of them too slowly.
  asio::awaitable<End> send(Answer a) {
    expects(a.status >= 200 && a.status <= 599, "an answer has a final status of HTTP");
    if (a.refusal) logRefusal(a);
    beast::http::response<beast::http::string_body> response = responseOf(std::move(a));
    beast::http::response_serializer<beast::http::string_body> serializer(response);
    const Settings& settings = shared_.settings;
    const auto end = Clock::now() + settings.timeout + std::chrono::seconds(response.body().size() / kSlowest);
    error_code ec;
    while (!ec && !serializer.is_done()) {
      c_.stream.expires_at(std::min(end, Clock::now() + settings.timeout));
      std::size_t bytes = 0;
      std::tie(ec, bytes) = co_await beast::http::async_write_some(c_.stream, serializer, kTuple);
      shared_.figures->bytesSent.Increment(static_cast<double>(bytes));
    }
    shared_.figures->answered(routeOf(path_), response.result_int());
    co_return ec ? End::kClose : keepAlive_ ? End::kNext : End::kFinish;
  }

  void logRefusal(const Answer& a) const {
    shared_.figures->refused(*a.refusal);
    logging::info({.session = sessionName_,
                   .peer = c_.peerName,
                   .holder = grant_.name.empty() ? a.holder : grant_.name,
                   .event = "refused",
                   .reason = metrics::name(*a.refusal),
                   .path = path_,
                   .status = a.status},
                  "is refused with " + std::to_string(a.status) + ": " + a.body.substr(0, std::min(a.body.find('\n'), kMaxLogged)));
  }

  beast::http::response<beast::http::string_body> responseOf(Answer a) const {
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
    return response;
  }

  Connection& c_;
  ServerContext& shared_;
  beast::http::request_parser<beast::http::empty_body> parser_;
  access::Grant grant_;
  std::string who_;          // the client, as Request::client
  std::string path_;         // for metrics and log, at most 100 bytes
  std::string sessionName_;  // the session's name as received, for the log
  std::string ifNoneMatch_;
  bool keepAlive_ = false, head_ = false, wantsProgress_ = false;
  std::shared_ptr<RequestBodyBudget::Room> room_;  // of the body; shared with the work that has it
  std::shared_ptr<const void> unsent_;             // of the answer
};

// False: the connection ends.
asio::awaitable<bool> secure(Connection& c) {
  auto tls = c.shared->tls();
  if (!tls || c.slot.kind() == ConnectionSlot::Kind::kAdmin) co_return true;
  c.stream.expires_after(c.timeout());
  const error_code ec = co_await c.done([&](Channel::Done done) { c.stream.startTls(std::move(tls), std::move(done)); });
  c.security = ec ? Connection::Security::kMissing : Connection::Security::kTls;
  if (!ec) c.shared->figures->tlsHandshakes.Increment();
  if (!ec || ec == asio::error::no_protocol_option) co_return true;
  c.shared->figures->refused(metrics::Refusal::kTls);
  co_return false;
}

// The connection closes when this returns.
asio::awaitable<void> serve(std::unique_ptr<Connection> c) {
  if (!co_await secure(*c)) co_return;
  Exchange::End end = Exchange::End::kNext;
  while (end == Exchange::End::kNext) {
    Exchange exchange(*c);
    end = co_await exchange.run();
  }
  if (end == Exchange::End::kClose) co_return;
  // Shuts down writing and discards what the client still sends for a moment: closing with unread bytes would reset the connection and
  // could lose the answer.
  c->stream.expires_after(kFinishTimeout);
  co_await c->done([&](Channel::Done done) { c->stream.finish(std::move(done)); });
}

}  // namespace

void startHttp(tcp::socket&& socket, ConnectionSlot slot, std::shared_ptr<ServerContext> shared) {
  error_code ignored;
  socket.set_option(tcp::no_delay(true), ignored);
  const auto strand = socket.get_executor();
  const tcp::endpoint endpoint = socket.remote_endpoint(ignored);
  auto connection = std::make_unique<Connection>(std::move(socket), endpoint, std::move(slot), std::move(shared));
  asio::co_spawn(strand, serve(std::move(connection)), [](const std::exception_ptr& failure) {
    if (failure) std::rethrow_exception(failure);
  });
}

}  // namespace ridgecast::net
