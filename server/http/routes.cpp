#include "server/http/routes.h"

#include <deque>

#include "common/text/text.h"
#include "common/version/version.h"
#include "common/wire/wire.h"
#include "server/http/lists.h"
#include "server/http/worlds.h"

namespace ridgecast::http {

Answer plain(unsigned status, std::string sentence, Headers headers) {
  Answer a;
  a.status = status;
  a.body = std::move(sentence) + "\n";
  a.headers = std::move(headers);
  return a;
}

Answer refused(unsigned status, metrics::Refusal why, std::string sentence, Headers headers) {
  Answer a = plain(status, std::move(sentence), std::move(headers));
  a.refusal = why;
  return a;
}

Answer json(std::string body) {
  Answer a;
  a.type = "application/json";
  a.body = std::move(body);
  return a;
}

Answer wrongMethod(const std::string& allowed) {
  return refused(405, metrics::Refusal::kRequest, "Methods allowed here: " + allowed + ".", {{"Allow", allowed}});
}

namespace {

// Whether the text needs no escaping in HTML and JSON. Nothing else is shown there.
bool hostIsHarmless(std::string_view host) { return !host.empty() && host.size() <= 255 && text::hasOnly(host, ".:-[]"); }

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '"' ? "&quot;" : std::string(1, c);
  return out;
}

constexpr std::string_view kPageHead = R"(<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Ridgecast</title>
<style>
:root { color-scheme: light dark; }
body { font: 16px/1.55 system-ui, sans-serif; max-width: 40rem; margin: 12vh auto 4rem; padding: 0 1.25rem; }
h1 { font-size: 2rem; margin: 0 0 .25rem; letter-spacing: -.01em; }
.lead { margin-top: 0; opacity: .75; }
pre { padding: .8rem 1rem; border-radius: .5rem; background: rgba(127, 127, 127, .14); overflow-x: auto; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .3rem 1.2rem; }
dt { opacity: .65; } dd { margin: 0; }
</style>
</head>
<body>
<h1>Ridgecast</h1>
<p class="lead">Endless terrain, triangulated for each camera and streamed.</p>
)";

std::string page(const Request& request, const directory::Directory& directory, std::string_view version, bool hasViewer) {
  const std::string host = hostIsHarmless(request.host) ? std::string(request.host) : "HOST:PORT";
  const auto session = directory.find(directory::kDefaultName);
  std::string out(kPageHead);
  out += hasViewer ? "<p>Fly over it <a href=\"/\">in this browser</a> or from a terminal:</p>\n"
                   : "<p>The viewer for browsers is not here: it is built with npm (<code>./run build</code> does that) and lies beside "
                     "the server's "
                     "program, or where <code>--web-dir</code> says. Fly over the terrain from a terminal:</p>\n";
  out += "<pre>ridgecast-client view ws://" + host + "</pre>\n";
  out += "<p>or, without a window, along a path into a folder of pictures and figures:</p>\n<pre>ridgecast-client fly ws://" + host +
         " --path PATH.json --out DIR</pre>\n";
  out += "<p>Any other program speaks binary WebSocket messages (protobuf, <code>proto/PROTOCOL.md</code>) at</p>\n<pre>ws://" + host +
         "/v1/stream?session=default</pre>\n<dl>\n";
  if (session && request.rights.has(access::Right::kView)) {
    out +=
        "<dt>terrain</dt><dd>" + escaped(session->terrain()->name()) + ", seed " + std::to_string(session->terrain()->seed()) + "</dd>\n";
    out += "<dt>cameras</dt><dd>" + std::to_string(directory.cameras()) + " of at most " +
           std::to_string(directory.resources().limits.maxCameras) + "</dd>\n";
  }
  out += "<dt>version</dt><dd>" + std::string(version) + ", protocol " + std::to_string(wire::kProtocolVersion) + "</dd>\n";
  out += "</dl>\n</body>\n</html>\n";
  return out;
}

}  // namespace

Answer noSession(std::string_view name, const directory::Directory& directory) {
  const std::string valid = wire::sessionNameIsValid(std::string(name)) ? std::string(name) : "";
  const std::string which = valid.empty() ? "of that name" : "named '" + valid + "'";
  if (valid == directory::kDefaultName || (!valid.empty() && directory.isElsewhere(valid)))
    return refused(503, metrics::Refusal::kSession, "Another server has the session '" + valid + "'; ask again in a moment.",
                   {{"Retry-After", "1"}});
  return refused(404, metrics::Refusal::kSession,
                 "There is no session " + which + " here; 'default' always exists, and &terrain=NAME of /v1/stream creates one.");
}

OwnRequest::OwnRequest(const Request& request) : request_(request) {
  for (std::string_view Request::*const text :
       {&Request::method, &Request::target, &Request::host, &Request::webSocketVersion, &Request::acceptEncoding, &Request::contentType,
        &Request::idempotencyKey, &Request::edit, &Request::origin, &Request::fetchSite, &Request::authorization, &Request::subprotocols,
        &Request::client})
    request_.*text = texts_.emplace_back(request_.*text);
}

Reply onceHas(std::string_view edit, const std::shared_ptr<session::Session>& session, std::function<Reply()> go,
              Answer (*refusesSo)(Answer)) {
  const auto refuses = [refusesSo](Answer&& answer) -> Reply { return refusesSo ? refusesSo(std::move(answer)) : std::move(answer); };
  const auto wanted = edit.empty() ? 0 : text::number<std::uint64_t>(edit);
  if (!wanted)
    return refuses(refused(400, metrics::Refusal::kRequest, std::string(kEditHeader) + " is the number of an edit, such as 17."));
  const std::uint64_t last = session->ground().edit;
  if (session->isCurrent() && *wanted <= last) return go();
  if (session->resources().bus->server() == 0)
    return refuses(refused(409, metrics::Refusal::kSession,
                           "Edit " + std::to_string(*wanted) + " has not been made in session '" + session->name() +
                               "'; its last edit is " + std::to_string(last) + "."));
  const scheduling::Timer& timer = *session->resources().timer;
  const auto until = timer.now() + kAwaitEdit;
  return DeferredResponse{.work = [session, wanted = *wanted, &timer, until, go = std::move(go), refuses](const Turn&) -> Reply {
    const std::uint64_t made = session->ground().edit;
    if (session->isCurrent() && wanted <= made) return go();
    constexpr std::chrono::milliseconds kPause{5};
    if (const auto now = timer.now(); now < until) return RetryAt{now + kPause};
    return refuses(refused(503, metrics::Refusal::kSession,
                           (wanted > made ? "Edit " + std::to_string(wanted) : std::string("What other servers have made of the ground")) +
                               " has not reached this server; ask again in a moment.",
                           {{"Retry-After", "1"}}));
  }};
}

std::string routeOf(std::string_view path) {
  for (const std::string_view known : {"/", "/healthz", "/readyz", "/metrics", "/version", "/v1/stream", "/v1/sessions", "/v1/heights",
                                       "/v1/normals", "/v1/materials", "/v1/rays"})
    if (path == known) return std::string(known);
  constexpr std::string_view sessions = "/v1/sessions/";
  for (const auto& [ending, tile] :
       {std::pair{"/tileset.json", "/tileset.json"}, {".json", "/{level}/{i}/{j}.json"}, {".glb", "/{level}/{i}/{j}.glb"}})
    if (path.starts_with(sessions) && path.find("/3dtiles/") != std::string_view::npos && path.ends_with(ending))
      return std::string(sessions) + "{session}/3dtiles" + tile;
  if (path.starts_with(sessions) && path.ends_with("/backup")) return std::string(sessions) + "{session}/backup";
  if (path.starts_with(sessions) && (path.ends_with("/edits") || path.find("/edits/") != std::string_view::npos))
    return std::string(sessions) + "{session}/edits";
  for (const std::string_view snapshot : {"/snapshot.glb", "/snapshot.json", "/snapshot.ply", "/snapshot.obj", "/snapshot.tif"})
    if (path.starts_with(sessions) && path.ends_with(snapshot)) return std::string(sessions) + "{session}" + std::string(snapshot);
  if (path.starts_with(sessions)) {  // tiles (map_tiles.h)
    path.remove_prefix(sessions.size());
    text::takePart(path, '/');
    for (const std::string_view tiles : {"heights/", "colours/"})
      if (path.starts_with(tiles) && path.substr(tiles.size()) == "tiles.json")
        return std::string(sessions) + "{session}/" + std::string(path);
      else if (path.starts_with(tiles))
        return std::string(sessions) + "{session}/" + std::string(tiles) + "{z}/{x}/{y}";
  }
  return "other";
}

Outcome<std::vector<std::string>> queryParameters(std::string_view query, std::string_view name) {
  std::vector<std::string> values;
  while (!query.empty()) {
    std::string_view part = text::takePart(query, '&');
    if (text::takePart(part, '=') != name) continue;
    auto value = text::percentDecoded(part);
    if (!value) return Error{"The query has a % without two hexadecimal digits after it."};
    values.push_back(std::move(*value));
  }
  return values;
}

Outcome<std::string> queryParameter(std::string_view query, std::string_view name) {
  auto values = queryParameters(query, name);
  if (!values) return values.error();
  return Outcome<std::string>(boost::system::in_place_value, values->empty() ? std::string() : std::move(values->front()));
}

bool namesEtag(std::string_view ifNoneMatch, std::string_view etag) {
  if (etag.empty()) return false;
  while (!ifNoneMatch.empty()) {
    std::string_view one = text::trimmed(text::takePart(ifNoneMatch, ','));
    if (one == "*") return true;
    if (one.starts_with("W/")) one.remove_prefix(2);
    if (one == '"' + std::string(etag) + '"') return true;
  }
  return false;
}

namespace {

// A copy for later work.
std::shared_ptr<const Request> keptCopy(const Request& request) {
  struct Copy {
    Request request;
    std::deque<std::string> texts;
  };
  auto copy = std::make_shared<Copy>(Copy{request, {}});
  for (std::string_view Request::*const text :
       {&Request::method, &Request::target, &Request::host, &Request::webSocketVersion, &Request::acceptEncoding, &Request::contentType,
        &Request::idempotencyKey, &Request::edit, &Request::origin, &Request::fetchSite, &Request::authorization, &Request::subprotocols,
        &Request::client})
    copy->request.*text = copy->texts.emplace_back(request.*text);
  return {copy, &copy->request};
}

}  // namespace

Reply answer(const Request& request, directory::Directory& directory, std::string_view version, const std::vector<Route>& routes) {
  if (const auto missing = missingHere(request, directory))
    return fromElsewhere(*missing, request, directory, [&directory, version, routes, own = keptCopy(request)](const auto&) {
      return answer(*own, directory, version, routes);
    });
  for (const Route& route : routes)
    if (auto reply = route(request)) return std::move(*reply);
  const std::string_view path = request.path();
  const bool isPage = path == "/" || path == "/about", isStream = path == "/v1/stream";
  if (!isPage && !isStream && path != "/healthz" && path != "/version" && path != "/v1/sessions")
    return refused(404, metrics::Refusal::kRequest, "There is nothing here; see / for what this server offers.");
  if (isStream && request.method != "GET") return wrongMethod("GET");
  if (!request.reads()) return wrongMethod();
  if (isStream) return streamAnswer(request, directory);
  if (path == "/v1/sessions") return sessionsAnswer(directory);
  if (path == "/healthz") return plain(200, "ok");
  if (path == "/version")
    return json(R"({"name": "ridgecast-server", "version": ")" + std::string(version) + R"(", "protocol": )" +
                std::to_string(wire::kProtocolVersion) + R"(, "commit": ")" + std::string(version::commit()) + "\"}\n");
  Answer a;
  a.type = "text/html; charset=utf-8";
  a.body = page(request, directory, version, path == "/about");
  return a;
}

}  // namespace ridgecast::http
