#include "server/net/operations.h"

#include <algorithm>

#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "common/version/version.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"
#include "server/memory/memory.h"

namespace ridgecast::net {

double saturation(ServerContext& s) {
  const session::Limits& limits = s.directory->resources().limits;
  const auto share = [](double used, double limit) { return limit > 0 ? used / limit : 0; };
  return std::min(1.0, std::max({share(s.directory->cameras(), limits.maxCameras), share(s.connections->served, s.settings.maxConnections),
                                 share(static_cast<double>(s.directory->all().size()), limits.maxSessions),
                                 share(s.figures->triangles.Value(), static_cast<double>(limits.maxTotalTriangles)),
                                 s.directory->resources().executor->usage()}));
}

namespace {

std::optional<Reply> operations(const std::shared_ptr<ServerContext>& server, const Request& request) {
  const std::string_view path = request.path();
  if (path != "/readyz" && path != "/metrics") return std::nullopt;
  if (!request.reads()) return http::wrongMethod();
  if (path == "/readyz") {
    const http::Headers load{{"Ridgecast-Load", text::rounded(server ? saturation(*server) : 1, 2)}};
    if (!server || !server->ready) return http::plain(503, "This server is leaving.", load);
    if (server->takesUp) return http::plain(503, "This server reads what the others have made.", load);
    // Still 200: meshes and queries go on, and no other server would be better off.
    return http::plain(200, server->directory->resources().bus->isAway() ? "ready; the engine of --shared is away" : "ready", load);
  }
  Answer a;
  a.type = "text/plain; version=0.0.4; charset=utf-8";
  if (server) a.body = server->figures->registry.text();
  return a;
}

// DELETE /v1/sessions/NAME and /v1/sessions/NAME/members/ID
std::optional<Reply> removal(const std::shared_ptr<ServerContext>& server, const Request& request) {
  constexpr std::string_view prefix = "/v1/sessions/";
  std::string_view rest = request.path();
  if (request.method != "DELETE" || !server || !rest.starts_with(prefix)) return std::nullopt;
  rest.remove_prefix(prefix.size());
  const std::string name(text::takePart(rest, '/'));
  if (rest.starts_with("edits")) return std::nullopt;  // http/edits.h
  directory::Directory& directory = *server->directory;
  std::shared_ptr<session::Session> session = directory.find(name);
  const auto others = directory.others();
  const bool isElsewhere = directory::Directory::find(*others, name) != nullptr;
  if (!session && !isElsewhere) return http::noSession(name, directory);
  if (isElsewhere && directory.resources().bus->isAway())
    return http::plain(503, "The other servers cannot be told now; try again in a moment.", {{"Retry-After", "1"}});
  std::optional<std::uint64_t> camera;
  if (!rest.empty()) {
    if (text::takePart(rest, '/') == "members") camera = text::number<std::uint64_t>(rest);
    if (!camera) return http::plain(404, "Only /v1/sessions/NAME and /v1/sessions/NAME/members/ID can be ended.");
    if (!session || !session->live().find(*camera)) {
      if (directory.removeElsewhere(name, *camera)) return http::plain(202, "The member's server is told to send it away.");
      return http::plain(404, "No member of session '" + name + "' has this number.");
    }
  } else if (name == directory::kDefaultName) {
    return http::plain(409, "The session '" + name + "' never ends; its members can be sent away one by one.");
  } else if (session) {
    session = directory.remove(name);
    if (!session) return http::noSession(name, directory);  // it has ended meanwhile
  } else {
    directory.removeElsewhere(name);
  }
  for (const auto& stream : server->streams.all())
    if (&stream->session() == session.get()) stream->postRemove(camera);
  logging::info({.session = name, .camera = camera.value_or(0), .event = "removed"},
                (camera ? "this member was sent away by " : "the session was ended by ") + std::string(request.client));
  if (camera) return http::plain(200, "The member is sent away.");
  return isElsewhere ? http::plain(202, "The session ends on all servers; its members are sent away.")
                     : http::plain(200, "The session has ended; its members are sent away.");
}

}  // namespace

void addOperations(const std::shared_ptr<ServerContext>& shared) {
  expects(shared->connections->served == 0, "routes are complete before the first connection");
  // Weak: the metrics may be shared and outlive this server.
  const auto of = [weak = std::weak_ptr(shared)](double (*value)(ServerContext&)) {
    return [weak, value]() -> double {
      const auto now = weak.lock();
      return now ? value(*now) : 0;
    };
  };
  metrics::Registry& registry = shared->figures->registry;
  const auto gauge = [&](const char* name, const char* help, double (*value)(ServerContext&)) { registry.compute(name, help, of(value)); };
  gauge("ridgecast_cameras", "Cameras of all sessions.", [](ServerContext& s) -> double { return s.directory->cameras(); });
  gauge("ridgecast_open_connections", "Connections that are open.", [](ServerContext& s) -> double { return s.connections->served; });
  gauge("ridgecast_sessions", "Sessions.", [](ServerContext& s) { return static_cast<double>(s.directory->all().size()); });
  gauge("ridgecast_granted_triangles", "Triangles set aside for the cameras.",
        [](ServerContext& s) { return static_cast<double>(s.directory->triangles()); });
  const session::Limits& limits = shared->directory->resources().limits;
  for (const auto& [name, limit] : {std::pair<const char*, double>{"cameras", limits.maxCameras},
                                    {"connections", shared->settings.maxConnections},
                                    {"sessions", limits.maxSessions},
                                    {"triangles", static_cast<double>(limits.maxTotalTriangles)},
                                    {"edit_bytes", static_cast<double>(shared->directory->resources().editSpace->limits.server)}})
    registry.compute("ridgecast_limit", "The limit of each; 0: unlimited.", [value = limit] { return value; }, {{"of", name}});
  gauge("ridgecast_saturation",
        "How full the server is, 0 to 1: the fullest of cameras, connections, sessions, live triangles and processor.", saturation);
  gauge("ridgecast_processor_usage", "Share of the threads for meshes that were at work in the last seconds, 0 to 1.",
        [](ServerContext& s) { return s.directory->resources().executor->usage(); });
  gauge("ridgecast_certificate_expiry_seconds", "When the certificate expires, seconds since 1970; 0: no TLS.",
        [](ServerContext& s) -> double {
          const auto tls = s.tls();
          return tls ? static_cast<double>(transport::expiryOf(*tls).time_since_epoch().count()) : 0;
        });
  gauge("ridgecast_last_reload_successful", "1 if the last reload of certificate and tokens succeeded, or there was none.",
        [](ServerContext& s) -> double { return s.reloaded ? 1 : 0; });
  registry.compute("ridgecast_queued_bytes", "Bytes that wait to be sent to clients.", of([](ServerContext& s) {
                     std::size_t bytes = 0;
                     for (const auto& stream : s.streams.all()) bytes += stream->waitingBytes();
                     return static_cast<double>(bytes);
                   }));
  const std::pair<const char*, double (*)(ServerContext&)> queues[] = {
      {"iterations", [](ServerContext& s) -> double { return s.directory->resources().executor->queued(); }},
      {"answers", [](ServerContext& s) -> double { return s.work(Queue::kPrompt).jobs.waiting(); }},
      {"tiles", [](ServerContext& s) -> double { return s.work(Queue::kTiles).jobs.waiting(); }},
      {"snapshots", [](ServerContext& s) -> double { return s.work(Queue::kPatient).jobs.waiting(); }},
      {"worlds", [](ServerContext& s) -> double { return s.work(Queue::kWorlds).jobs.waiting(); }}};
  for (const auto& [name, depth] : queues)
    registry.compute("ridgecast_queue_depth",
                     "Pieces of work that wait for a thread: cameras' iterations, HTTP answers, tiles, snapshots, worlds to compile.",
                     of(depth), {{"queue", name}});
  registry.compute("ridgecast_memory_limit_bytes", "What this process may use; 0: unknown.",
                   [limit = static_cast<double>(memory::available())] { return limit; });
  gauge("ridgecast_edit_bytes", "The edits of the sessions that live.",
        [](ServerContext& s) { return static_cast<double>(s.directory->resources().editSpace->kept.used()); });
  gauge("ridgecast_edits_behind", "Edits that other servers made and this one has not applied yet, of the session with the most.",
        [](ServerContext& s) {
          std::uint64_t most = 0;
          for (const auto& session : s.directory->all()) most = std::max(most, session->edits().behind());
          return static_cast<double>(most);
        });
  if (const auto& state = shared->directory->resources().state; !state.empty()) shared->figures->watchDisk("state", state);
  gauge("ridgecast_ready", "1 if new streams are accepted.", [](ServerContext& s) -> double { return s.ready && !s.takesUp ? 1 : 0; });
  registry.compute(
      "ridgecast_build_info", "Always 1; its labels say what runs.", [] { return 1.0; },
      {{"version", RIDGECAST_VERSION}, {"protocol", std::to_string(wire::kProtocolVersion)}, {"commit", std::string(version::commit())}});

  shared->routes.insert(shared->routes.begin(),
                        [weak = std::weak_ptr(shared)](const Request& request) { return removal(weak.lock(), request); });
  shared->routes.push_back([weak = std::weak_ptr(shared)](const Request& request) { return operations(weak.lock(), request); });
}

}  // namespace ridgecast::net
