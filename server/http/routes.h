#pragma once
// What the server answers over HTTP: pure functions from a request to an answer, without sockets.
//
//   GET /, /about                   what this is and how to connect, as a page; / is the browser viewer where there is one (site.h)
//   GET /healthz                    "ok"
//   GET /readyz                     "ready", or 503 while the server leaves
//   GET /metrics                    figures for Prometheus
//   GET /version                    {"name": ..., "version": ..., "protocol": ...}
//   GET /v1/stream?session=NAME     upgrades to a WebSocket; &terrain=NAME&seed=N&param=NAME=NUMBER makes the session when there is none
//   GET /v1/sessions                the sessions, their worlds, members and clocks, as JSON
// HEAD is answered where GET is. Everything else is refused in one plain sentence.

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/grant.h"
#include "server/metrics/figures.h"
#include "server/session/session.h"

namespace ridgecast::http {

struct Request {  // the views live while the request is answered, not in work that is done later
  std::string_view method;
  std::string_view target;  // path and query
  std::string_view host;    // the Host header; untrusted
  bool upgrade = false;     // asks for a WebSocket
  std::string_view webSocketVersion;
  std::string_view acceptEncoding;
  std::string_view origin, authorization, subprotocols;  // headers; untrusted, judged by the gate before a route sees them
  access::Rights rights = access::Rights::all();         // of who asks
};

struct Later;

struct Answer {
  unsigned status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
  std::string etag;                             // of a 200, without quotation marks; sends 304 to who has it already
  std::shared_ptr<session::Session> upgradeTo;  // set: answer with the upgrade instead
  std::optional<metrics::Refusal> refusal;      // why it is no good answer, for the figures
  std::shared_ptr<const Later> later;           // set: the answer comes of work, and may be an upgrade; of this one only etag counts
};

// One sentence as text.
Answer plain(unsigned status, std::string sentence);
// The same for what is no good answer: counted in the figures under `why`.
Answer refused(unsigned status, metrics::Refusal why, std::string sentence);

// Work that makes the answer on a thread of its own (jobs.h). `stop` is requested when the asker leaves or the server shuts down: then
// return soon, with whatever, for nobody reads it. Work that may take seconds is `patient`: it gives way to everything else. What makes a
// world takes seconds, too, but not behind snapshots that take a minute: it has a queue of its own.
struct Later {
  bool patient = false, makesWorld = false;
  std::function<Answer(std::stop_token stop)> work;
  // How far it has come, a few words without line breaks. Told about once a second, as HTTP 102 with a header `Progress`, to who asks for it
  // by `Prefer: progress`. Any thread, while the work waits or runs.
  std::function<std::string()> progress;
};

// Answers what other rooms have; nothing when the path is none of its own. Any thread.
using Route = std::function<std::optional<Answer>(const Request& request)>;

// `routes` are asked first, in order.
Answer answer(const Request& request, session::Directory& directory, std::string_view version, const std::vector<Route>& routes = {});

// The value of a query's parameter, percent-decoded; empty when it is absent. Error: an escape that is none.
Outcome<std::string> queryParameter(std::string_view query, std::string_view name);

// Whether an If-None-Match header names this etag.
bool namesEtag(std::string_view ifNoneMatch, std::string_view etag);

}  // namespace ridgecast::http
