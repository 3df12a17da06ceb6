// ridgecast-server: reads its settings, puts the rooms together, serves until SIGINT or SIGTERM, of which a second one does not wait for
// clients. SIGHUP reads certificate and tokens again, SIGUSR1 drains (not ready, clients are told to connect again), SIGUSR2 makes it ready
// again.
// ridgecast-server healthy checks a running one, ridgecast-server check a terrain; ridgecast-server snapshot makes a file and serves
// nothing; ridgecast-server edits manages logs of edits; ridgecast-server replay repeats recordings.
// Exit status: 0 after a signal, 1 when something failed while running, 2 when the settings cannot be met.

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <fstream>
#include <future>
#include <iostream>
#include <mutex>
#include <optional>
#include <sstream>
#include <stop_token>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include "common/glsl/probe.h"
#include "common/raster/raster_terrain.h"
#include "common/text/text.h"
#include "server/bus/redis.h"
#include "server/check_command.h"
#include "server/config/config.h"
#include "server/directory/directory.h"
#include "server/edits_command.h"
#include "server/http/edits.h"
#include "server/http/lists.h"
#include "server/http/map_tiles.h"
#include "server/http/queries.h"
#include "server/http/site.h"
#include "server/http/snapshots.h"
#include "server/http/tilesets.h"
#include "server/logging/logging.h"
#include "server/metrics/metrics.h"
#include "server/net/health.h"
#include "server/net/server.h"
#include "server/recording/recorder.h"
#include "server/replay_command.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "server/snapshot_command.h"
#include "server/watch.h"

namespace {

using namespace ridgecast;

int refuse(const std::string& message) {
  std::cerr << "ridgecast-server: " << message << "\n";
  return 2;
}

// Whole or not at all: whoever waits for the file must not read half a number.
bool writePortFile(const std::filesystem::path& file, std::uint16_t port) {
  const std::filesystem::path unfinished = file.string() + ".new";
  {
    std::ofstream out(unfinished);
    out << port << "\n";
    if (!out.flush()) return false;
  }
  std::error_code ec;
  std::filesystem::rename(unfinished, file, ec);
  return !ec;
}

// Tells systemd how the server is: one datagram to the socket that NOTIFY_SOCKET names (sd_notify(3)): "READY=1", "STOPPING=1",
// "STATUS=...", lines of them. Does nothing without that variable.
void notify(std::string_view state) {
  const char* path = std::getenv("NOTIFY_SOCKET");
  sockaddr_un address{};
  const std::string_view name = path ? path : "";
  if ((!name.starts_with('/') && !name.starts_with('@')) || name.size() < 2 || name.size() >= sizeof address.sun_path) return;
  address.sun_family = AF_UNIX;
  std::copy(name.begin(), name.end(), address.sun_path);
  if (name.front() == '@') address.sun_path[0] = '\0';  // Linux's abstract names
  std::string message(state);
  if (state.starts_with("RELOADING=1")) {  // systemd compares it with its own clock
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    message += "\nMONOTONIC_USEC=" + std::to_string(static_cast<long long>(now.tv_sec) * 1'000'000 + now.tv_nsec / 1000);
  }
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return;
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
  (void)sendto(socket, message.data(), message.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&address), length);
  close(socket);
}

// The browser viewer's files; null where there are none and none were requested.
Outcome<std::shared_ptr<const http::Site>> loadSite(std::filesystem::path folder) {
  if (folder.empty()) folder = http::Site::defaultFolder().value_or("");
  if (folder.empty()) return std::shared_ptr<const http::Site>();
  return http::Site::load(folder);
}

// A complaint may have several lines. Clients cause them by the worlds that they ask for.
void warn(const std::string& complaint) {
  std::istringstream lines(complaint);
  for (std::string line; std::getline(lines, line);) logging::warning({.reason = "world"}, line);
}

// The figures of recordings. The recorder outlives them.
void addFigures(metrics::Metrics& figures, const recording::Recorder& recorder, const config::Config& config) {
  metrics::Registry& registry = figures.registry;
  registry.compute("ridgecast_recordings_bytes", "What recordings take on the disk.",
                   [&] { return static_cast<double>(recorder.usage().keptBytes); });
  registry.compute("ridgecast_limit", "", [most = static_cast<double>(config.recordBytes)] { return most; }, {{"of", "recording_bytes"}});
  registry.compute(
      "ridgecast_recordings_failed_total", "Recordings that ended early; the log says why.",
      [&] { return static_cast<double>(recorder.usage().failed); }, {}, true);
  figures.watchDisk("recordings", config.record);
}

// Returns after SIGINT or SIGTERM.
void untilEnded(net::Server& server, const sigset_t& signals) {
  for (;;) {
    const timespec patience{60, 0};
    const int signal = sigtimedwait(&signals, nullptr, &patience);
    if (signal < 0) {
      logging::sayLeftOut();
    } else if (signal == SIGHUP) {
      notify("RELOADING=1");
      if (const auto error = server.reload())
        logging::error("not reloaded: " + error->message);
      else
        logging::info("reloaded: certificate and tokens");
      notify("READY=1");
    } else if (signal == SIGUSR1) {
      logging::info("draining: clients are told to connect again; SIGUSR2 ends it");
      server.drain();
      notify("STATUS=Draining");
    } else if (signal == SIGUSR2) {
      logging::info("ready again");
      server.undrain();
      notify("STATUS=Serving at " + server.url());
    } else {
      return logging::info(signal == SIGINT ? "interrupted: shutting down" : "terminated: shutting down");
    }
  }
}

void endWithInput() {
  std::thread([] {
    char read[256];
    while (::read(STDIN_FILENO, read, sizeof read) > 0) continue;
    ::kill(::getpid(), SIGTERM);
  }).detach();
}

// Ends the process, with a sentence in the log, if it still lives after this time. Edits that were acknowledged are on the disk by then.
class Deadline {
 public:
  explicit Deadline(std::chrono::milliseconds time)
      : thread_([this, time](const std::stop_token& stop) {
          std::unique_lock lock(mutex_);
          if (wake_.wait_for(lock, stop, time, [] { return false; }) || stop.stop_requested()) return;
          logging::error("ends at once: " + std::to_string(net::kAfterDrain.count()) +
                         " s after the drain, a disk or an answer still keeps it");
          std::_Exit(1);
        }) {}

 private:
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::jthread thread_;  // last: it uses the others
};

// From now on SIGINT and SIGTERM end the process at once.
void letSignalsEndIt() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM}) {
    std::signal(signal, SIG_DFL);
    sigaddset(&signals, signal);
  }
  pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
}

void report(const std::vector<std::string>& ignoredVariables) {
  std::string names;
  for (const std::string& name : ignoredVariables) names += (names.empty() ? "" : ", ") + name;
  if (!names.empty()) logging::info("ignores variables that Kubernetes sets for Services: " + names);
}

// Waits until the default session is the same world on all servers that share it. Error: one sentence; it is not, or the engine is silent.
Outcome<void> claimDefault(const session::Resources& resources, const terrain::Terrain& terrain, const config::Config& config) {
  constexpr std::chrono::seconds kTimeout{10};
  const auto claimed = std::make_shared<std::promise<Outcome<void>>>();
  auto answer = claimed->get_future();
  directory::Directory::claimDefault(resources, terrain, config.terrain.parameters,
                                     [claimed](Outcome<void> answered) { claimed->set_value(std::move(answered)); });
  if (answer.wait_for(kTimeout) == std::future_status::ready) return answer.get();
  return Error{"The engine between the servers has not answered for 10 seconds; start it, and this server again."};
}

// `begin` may be empty.
int serve(const config::Config& config, const sigset_t& signals, const BeginServing& begin) {
  std::optional<Deadline> deadline;  // of all that follows
  report(config.ignoredVariables);
  auto terrain = user_terrain::load(config.terrain, warn);  // before any thread begins
  if (!terrain) return refuse(terrain.error().message);

  auto site = loadSite(config.webFolder);
  if (!site) return refuse(site.error().message);
  std::vector<http::Route> routes;
  if (*site)
    routes.push_back(http::pageRoute(std::move(*site), config.net.reconnectUrl));
  else
    logging::info("the browser viewer is not beside this program; / says how to connect otherwise");

  std::unique_ptr<recording::Recorder> recorder;  // outlives those who are recorded
  if (!config.record.empty()) {
    auto opened = recording::Recorder::open(config.record, config.recordBytes);
    if (!opened) return refuse(opened.error().message);
    recorder = std::move(*opened);
  }
  std::unique_ptr<net::Server> server;  // before the executor, so that it is destroyed after it: tasks send through it
  scheduling::Executor disk(1), edits(1), executor(config.threads);
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->edits = &edits;
  resources->disk = &disk;
  resources->makeMesh = session::pipelineMeshes();
  resources->serverName = "ridgecast-server " RIDGECAST_VERSION;
  resources->limits = config.limits;
  resources->budgets = std::make_shared<session::BudgetsByClient>(config.limits.maxHeightsPerSecond);
  resources->state = config.state;
  if (recorder)
    resources->record = [r = recorder.get()](recording::World world, std::vector<recording::Edited> past, scheduling::Timer::Time now) {
      return r->begin(std::move(world), std::move(past), now);
    };
  struct Shared {
    std::shared_ptr<bus::Redis> bus;
    ~Shared() {
      if (bus) bus->end();
    }
  } shared;  // ends before the executor, which its handlers use
  if (!config.shared.url.empty()) {
    auto connected = bus::Redis::connect(config.shared, resources->figures);
    if (!connected) return refuse(connected.error().message);
    resources->bus = shared.bus = std::move(*connected);
    logging::info("shares its worlds by " + shared.bus->where() + " as server " + std::to_string(shared.bus->server()));
  }
  const auto requestOf = [request = config.terrain, own = std::string((*terrain)->name())](const session::WorldSpec& spec) {
    user_terrain::Request made = request;
    if (spec.terrain != own) {
      made.terrain = spec.terrain;  // a name: paths are refused before
      made.raster = {};
    }
    made.seed = spec.seed;
    made.parameters = spec.parameters;
    return made;
  };
  const auto makeTerrain = [requestOf, tellsText = config.limits.sendsTerrain](const session::WorldSpec& spec,
                                                                               const std::stop_token& stop) {
    auto made = user_terrain::load(requestOf(spec), warn, stop);
    if (made) {
      if (const terrain::Raster* map = (*made)->raster())
        logging::info({.reason = "world"}, "height map " + spec.terrain + ": " + raster::describe(*map));
      return made;
    }
    const std::string& full = made.error().message;
    const bool quotes = full.find('\n') != std::string::npos;  // the file
    std::string told = quotes && !tellsText ? "the terrain file has errors; the server's log shows them" : text::withoutFolders(full);
    if (told != full) warn(full);
    made = Error{std::move(told)};
    return made;
  };
  if (config.limits.maxSessions > 1) resources->makeTerrain = makeTerrain;
  if (resources->bus->server() != 0) {
    if (config.watch)
      return refuse("Sessions cannot follow their terrain files (--watch) where servers share them (--shared): leave one out.");
    if (auto claimed = claimDefault(*resources, **terrain, config); !claimed) return refuse(claimed.error().message);
  }
  std::shared_ptr<directory::Directory> directory;
  try {
    directory = std::make_shared<directory::Directory>(resources, *terrain, config.terrain.parameters);
  } catch (const std::runtime_error& e) {  // the edits that are kept of its ground
    return refuse(e.what());
  }
  directory->awaitDefault();
  StartServing start;
  if (begin) {
    auto begun = begin(*directory);
    if (!begun) return refuse(begun.error().message);
    start = std::move(*begun);
  }
  const http::Maker maker{std::make_shared<snapshot::Snapshots>(config.snapshots, 0, &executor),
                          std::make_shared<http::AnswerCache>(std::size_t{config.cacheMemory} << 20)};
  routes.insert(routes.begin(), {http::snapshotRoute(directory, maker), http::tilesetRoute(directory, maker)});
  routes.push_back(http::queryRoute(directory));
  if (config.limits.takesEdits) routes.push_back(http::editsRoute(directory));
  routes.push_back(http::mapTileRoute(directory));
  routes.push_back(http::terrainsRoute(resources->makeTerrain ? std::optional(config.terrain.folder) : std::nullopt));
  auto listening = net::Server::listen(config.net, directory, std::move(routes));
  if (!listening) return refuse(listening.error().message);
  server = std::move(*listening);
  if (!config.portFile.empty() && !writePortFile(config.portFile, server->port()))
    return refuse("Cannot write the port file '" + config.portFile.string() + "'; name a file in a folder that can be written.");
  if (recorder) addFigures(*resources->figures, *recorder, config);
  if (!server->adminUrl().empty()) logging::info("admin port at " + server->adminUrl());
  if (const terrain::Raster* map = (*terrain)->raster()) logging::info("height map: " + raster::describe(*map));
  logging::info("listening on " + server->url() + " with " + std::to_string(executor.threads()) + " threads, terrain " +
                std::string((*terrain)->name()) + ", seed " + std::to_string((*terrain)->seed()));

  const auto sendAway = [&](const session::Session& session) { server->sendAway(session); };
  std::optional<Watch> watch;
  if (config.watch)
    watch.emplace(
        directory, [requestOf](const session::WorldSpec& spec) { return user_terrain::filesOf(requestOf(spec)); }, makeTerrain, sendAway);

  if (start) start(sendAway);
  notify("READY=1\nSTATUS=Serving at " + server->url());
  untilEnded(*server, signals);
  letSignalsEndIt();
  deadline.emplace(config.net.drainDelay + config.net.drain + net::kAfterDrain);
  watch.reset();
  start = nullptr;
  notify("STOPPING=1\nSTATUS=Waiting for clients to leave");
  server->shutdown();
  logging::sayLeftOut(true);
  if (!config.portFile.empty()) {
    std::error_code ignored;
    std::filesystem::remove(config.portFile, ignored);
  }
  return 0;
}

// With signals and log set up; the exit status.
int serveBySettings(const config::Config& config, const BeginServing& begin) {
  logging::setUp(config.logFormat, config.logLevel);
  // Blocked before any thread begins, so that only untilEnded sees them.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  for (const int signal : {SIGTERM, SIGHUP, SIGUSR1, SIGUSR2}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  if (config.endsWithInput) endWithInput();
  try {
    return serve(config, signals, begin);
  } catch (const std::exception& e) {
    std::cerr << "ridgecast-server: " << e.what() << "\n";
    return 1;
  }
}

// ridgecast-server healthy, with the server's settings: for containers' checks.
int healthy(int argc, char** argv) {
  const config::Parsed parsed = config::parse(argc, argv, environ);
  if (!parsed.config) return parsed.status;
  const auto error = net::checkHealth(parsed.config->net);
  if (error) std::cerr << "ridgecast-server: " << error->message << "\n";
  return error ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "healthy") return healthy(argc - 1, argv + 1);
  if (const auto status = glsl::asProbe(argc, argv)) return *status;
  if (argc > 1 && std::string_view(argv[1]) == "check") return runCheckCommand(argc - 1, argv + 1, environ);
  if (argc > 1 && std::string_view(argv[1]) == "snapshot") return runSnapshotCommand(argc - 1, argv + 1, environ);
  if (argc > 1 && std::string_view(argv[1]) == "edits") return runEditsCommand(argc - 1, argv + 1, environ);
  if (argc > 1 && std::string_view(argv[1]) == "replay") return runReplayCommand(argc - 1, argv + 1, environ, serveBySettings);
  const config::Parsed parsed = config::parse(argc, argv, environ);
  if (!parsed.config) return parsed.status;
  return serveBySettings(*parsed.config, {});
}
