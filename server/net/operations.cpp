#include "server/net/operations.h"

#include "common/wire/wire.h"

namespace ridgecast::net {

namespace {

std::optional<Answer> operations(const std::shared_ptr<Shared>& server, const Request& request) {
  const std::string_view path = request.path();
  if (path != "/readyz" && path != "/metrics") return std::nullopt;
  if (!request.reads()) return http::wrongMethod();
  if (path == "/readyz") return server && server->ready ? http::plain(200, "ready") : http::plain(503, "This server is leaving.");
  Answer a;
  a.type = "text/plain; version=0.0.4; charset=utf-8";
  if (server) a.body = server->figures->registry.text();
  return a;
}

}  // namespace

void addOperations(const std::shared_ptr<Shared>& shared) {
  // Weak: the metrics may be shared and outlive this server.
  const auto of = [weak = std::weak_ptr(shared)](double (*value)(Shared&)) {
    return [weak, value]() -> double {
      const auto now = weak.lock();
      return now ? value(*now) : 0;
    };
  };
  metrics::Registry& registry = shared->figures->registry;
  registry.compute("ridgecast_cameras", "Cameras of all sessions.", of([](Shared& s) -> double { return s.directory->cameras(); }));
  registry.compute("ridgecast_open_connections", "Connections that are open.", of([](Shared& s) -> double { return s.connections; }));
  registry.compute("ridgecast_queued_bytes", "Bytes that wait in the way out to clients.", of([](Shared& s) {
                     const std::lock_guard lock(s.mutex);
                     std::size_t bytes = 0;
                     for (const auto& [stream, weak] : s.streams) bytes += stream->waitingBytes();
                     return static_cast<double>(bytes);
                   }));
  const std::pair<const char*, double (*)(Shared&)> queues[] = {
      {"iterations", [](Shared& s) -> double { return s.directory->resources().executor->queued(); }},
      {"answers", [](Shared& s) -> double { return s.promptJobs.waiting(); }},
      {"snapshots", [](Shared& s) -> double { return s.patientJobs.waiting(); }},
      {"worlds", [](Shared& s) -> double { return s.worldJobs.waiting(); }}};
  for (const auto& [name, depth] : queues)
    registry.compute("ridgecast_queue_depth",
                     "Pieces of work that wait for a thread: cameras' iterations, HTTP answers, snapshots, worlds that are made.",
                     of(depth), {{"queue", name}});
  registry.compute("ridgecast_ready", "1 where new streams are taken.", of([](Shared& s) -> double { return s.ready ? 1 : 0; }));
  registry.compute("ridgecast_build_info", "Always 1; its labels say what runs.", [] { return 1.0; },
                   {{"version", RIDGECAST_VERSION}, {"protocol", std::to_string(wire::kProtocolVersion)}});

  shared->routes.push_back([weak = std::weak_ptr(shared)](const Request& request) { return operations(weak.lock(), request); });
}

}  // namespace ridgecast::net
