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
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/rights.h"
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

struct DeferredResponse;
struct BodyHandler;

using Headers = std::vector<std::pair<std::string, std::string>>;

// In requests as Request::edit; in answers about the ground the last edit that they include, 0: none.
inline constexpr char kEditHeader[] = "Ridgecast-Edit";

struct Answer {
  unsigned status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::string body;
  Headers headers;
  std::string etag;                               // of a 200, without quotation marks; a client that has it gets 304
  std::shared_ptr<session::Session> upgradeTo;    // set: answer with the upgrade instead
  std::optional<metrics::Refusal> refusal;        // why this is a refusal, for the metrics
  std::string holder;                             // of a good token that is refused all the same, for the log
  std::shared_ptr<const DeferredResponse> later;  // set: work makes the answer, perhaps an upgrade; of this one only etag counts
  std::shared_ptr<const BodyHandler> ofBody;      // set: the request's body makes the answer, once it has been read
  std::optional<std::chrono::steady_clock::time_point> again;  // of work: this was one of its turns; the next is not before then
  // Of work: this was one of its turns; the next is due when `wake` is called. Called at once; `wake` may be called by any thread, even
  // before this call returns.
  std::function<void(std::function<void()> wake)> whenWoken;
};

// One sentence as text.
Answer plain(unsigned status, std::string sentence, Headers headers = {});
// The same for a refusal, counted in the metrics under `why`.
Answer refused(unsigned status, metrics::Refusal why, std::string sentence, Headers headers = {});
// For a session that the directory does not find: 404, or 503 while another server has it, which is always so for the default one.
Answer noSession(std::string_view name, const session::Directory& directory);
Answer json(std::string body);  // a 200
// Of a method that a path does not have.
Answer wrongMethod(const std::string& allowed = "GET, HEAD");

// Work that makes the answer on its own thread (jobs.h). `stop` is requested when the client leaves or the server shuts down: return soon;
// the result is not read. `patient` work may take seconds and yields to everything else. Making a world also takes seconds, but must not
// wait behind snapshots that take a minute, so it has its own queue. So have 3D and map tiles, of which viewers request many at a time.
// Work may run in turns (Answer::again, whenWoken), between which other work of its queue runs.
struct DeferredResponse {
  bool patient = false, makesWorld = false, isTile = false;
  std::function<Answer(std::stop_token stop)> work{};
  // Progress in a few words without line breaks. Sent about once a second, as HTTP 102 with a header `Progress`, to clients that request it
  // by `Prefer: progress`. Any thread, while the work waits or runs.
  std::function<std::string()> progress{};
};

Answer madeBy(DeferredResponse later);  // an answer whose status and body the work makes

struct BodyHandler {
  std::size_t most = 0;   // bytes; of more nothing is read
  std::string tooLong{};  // one sentence
  std::function<Answer(std::string body)> answer{};
};

Answer madeOfBody(BodyHandler ofBody);

// Answers what other rooms provide; empty if the path is not its own. Any thread.
using Route = std::function<std::optional<Answer>(const Request& request)>;

// `routes` are tried first, in order.
Answer answer(const Request& request, session::Directory& directory, std::string_view version, const std::vector<Route>& routes = {});

// A refusal, if the session has not made the edit that the answer must include (Request::edit).
std::optional<Answer> lacksEdit(std::string_view edit, const session::Session& session);

// The route of a path, of a fixed set, for the metrics: such as /v1/heights, /v1/sessions/{session}/snapshot.glb or other.
std::string routeOf(std::string_view path);

// The values of a query parameter, percent-decoded. Error: an invalid escape.
Outcome<std::vector<std::string>> queryParameters(std::string_view query, std::string_view name);
// The first; empty if absent.
Outcome<std::string> queryParameter(std::string_view query, std::string_view name);

// Whether an If-None-Match header names this etag.
bool namesEtag(std::string_view ifNoneMatch, std::string_view etag);

}  // namespace ridgecast::http
