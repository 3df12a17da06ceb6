#pragma once
// HTTP answers as pure functions of requests, without sockets.
//
//   GET /, /about                   a page about the server and how to connect; / is the browser viewer, if installed (site.h)
//   GET /healthz                    "ok"
//   GET /readyz                     "ready", or 503 while the server drains
//   GET /metrics                    metrics for Prometheus
//   GET /version                    {"name": ..., "version": ..., "protocol": ...}
//   GET /v1/stream?session=NAME     upgrades to a WebSocket; &terrain=NAME&seed=N&param=NAME=NUMBER&clock=stepped creates a missing session
//   GET /v1/sessions                the sessions, their worlds, members and clocks, as JSON
//   GET /v1/terrains                the terrains that sessions can be created of, with their parameters, as JSON (worlds.h)
// Files with headers of their own: snapshots.h, queries.h (also by POST), map_tiles.h, edits.h.
// HEAD is answered wherever GET is. Everything else is refused in one sentence.

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/rights.h"
#include "server/directory/directory.h"
#include "server/http/jobs.h"
#include "server/metrics/metrics.h"
#include "server/session/session.h"

namespace ridgecast::http {

struct Request {  // the views live while the request is answered, not in later work
  std::string_view method;
  std::string_view target;  // path and query
  std::string_view host;    // the Host header; untrusted
  bool isSecure = false;    // by TLS, to this server or to a trusted proxy
  bool upgrade = false;     // asks for a WebSocket
  std::string_view webSocketVersion;
  std::string_view acceptEncoding;
  std::string_view contentType;
  std::string_view idempotencyKey;
  std::string_view edit;                                            // Ridgecast-Edit: the number of an edit that the answer must include
  std::string_view origin, fetchSite, authorization, subprotocols;  // headers; untrusted, checked by the filter before a route sees them
  access::Rights rights = access::Rights::all();                    // of the client
  std::string_view client = {};  // "token of NAME" or "address ADDRESS": whose share limited things come from

  std::string_view path() const { return target.substr(0, target.find('?')); }
  std::string_view query() const { return target.substr(std::min(path().size() + 1, target.size())); }
  bool reads() const { return method == "GET" || method == "HEAD"; }
};

using Headers = std::vector<std::pair<std::string, std::string>>;

// In requests as Request::edit; in answers about the ground the last edit that they include, 0: none.
inline constexpr char kEditHeader[] = "Ridgecast-Edit";

struct Answer {
  unsigned status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::string body{};
  Headers headers{};
  std::string etag{};                         // of a 200, without quotation marks; a client that has it gets 304
  std::optional<metrics::Refusal> refusal{};  // why this is a refusal, for the metrics
  std::string holder{};                       // of a good token that is refused all the same, for the log
};

struct Reply;

// 101: the connection becomes a stream of this session.
struct Upgrade {
  std::shared_ptr<session::Session> session;
};

// One turn of work, between which other work of its queue runs.
struct Turn {
  std::stop_token stop{};        // requested when the client leaves or the server shuts down: return soon; the result is not read
  std::function<void()> wake{};  // makes the next turn due now. Any thread, also during this turn or after the work
};

// Each has its own threads (jobs.h): what takes milliseconds, 3D and map tiles, of which viewers request many at a time, what may take
// seconds and yields to everything else, and making worlds, which must not wait behind snapshots that take a minute.
enum class Queue { kPrompt, kTiles, kPatient, kWorlds };

// Work that makes the reply on a thread of its queue.
struct DeferredResponse {
  Queue queue = Queue::kPrompt;
  std::function<Reply(const Turn& turn)> work{};  // RetryAt: takes another turn
  // Progress in a few words without line breaks. Sent about once a second, as HTTP 102 with a header `Progress`, to clients that request it
  // by `Prefer: progress`. Any thread, while the work waits or runs.
  std::function<std::string()> progress{};
  Answer unchanged{};  // to a client that has its etag, instead of the work
};

// Makes the reply from the request's body, once that has been read.
struct BodyHandler {
  std::size_t maxBytes = 0;  // of more nothing is read
  std::string tooLong{};     // one sentence
  std::function<Reply(std::string body)> answer{};
};

// An answer, or what to do for one; RetryAt only from work.
struct Reply : std::variant<Answer, Upgrade, DeferredResponse, BodyHandler, RetryAt> {
  using variant::variant;
};

// One sentence as text.
Answer plain(unsigned status, std::string sentence, Headers headers = {});
// The same for a refusal, counted in the metrics under `why`.
Answer refused(unsigned status, metrics::Refusal why, std::string sentence, Headers headers = {});
// For a session that the directory does not find: 404, or 503 while another server has it, which is always so for the default one.
Answer noSession(std::string_view name, const directory::Directory& directory);
Answer json(std::string body);  // a 200
// Of a method that a path does not have.
Answer wrongMethod(const std::string& allowed = "GET, HEAD");

// Answers what other rooms provide; empty if the path is not its own. Any thread.
using Route = std::function<std::optional<Reply>(const Request& request)>;

// `routes` are tried first, in order.
Reply answer(const Request& request, directory::Directory& directory, std::string_view version, const std::vector<Route>& routes = {});

// A request whose views live as long as this does.
class OwnRequest {
 public:
  explicit OwnRequest(const Request& request);
  OwnRequest(const OwnRequest&) = delete;
  OwnRequest& operator=(const OwnRequest&) = delete;
  const Request& request() const { return request_; }

 private:
  Request request_;
  std::deque<std::string> texts_;
};

// The reply of `go`, if the session has made the edit that the answer must include (Request::edit), which may be empty. On several servers
// it is made by work, once this server's ground has that edit and all that the others had made when it began; a server that still lacks
// them after kAwaitEdit refuses. `refuses`, if given, is for these refusals.
Reply onceHas(std::string_view edit, const std::shared_ptr<session::Session>& session, std::function<Reply()> go,
              Answer (*refuses)(Answer) = nullptr);
inline constexpr std::chrono::milliseconds kAwaitEdit{1000};

// The route of a path, of a fixed set, for the metrics: such as /v1/heights, /v1/sessions/{session}/snapshot.glb or other.
std::string routeOf(std::string_view path);

// The values of a query parameter, percent-decoded. Error: an invalid escape.
Outcome<std::vector<std::string>> queryParameters(std::string_view query, std::string_view name);
// The first; empty if absent.
Outcome<std::string> queryParameter(std::string_view query, std::string_view name);

// Whether an If-None-Match header names this etag.
bool namesEtag(std::string_view ifNoneMatch, std::string_view etag);

}  // namespace ridgecast::http
