#include "server/config/config.h"

#include <CLI/CLI.hpp>
#include <iostream>
#include <map>
#include <type_traits>

#include "common/settings/settings.h"
#include "common/version/version.h"
#include "common/wire/wire.h"
#include "server/access/host.h"
#include "server/bus/address.h"
#include "server/config/layers.h"
#include "server/config/token_command.h"
#include "server/memory/memory.h"
#include "server/net/fetch.h"
#include "server/presence/presence.h"

namespace ridgecast::config {

namespace {

int refuse(const std::string& sentence) {
  std::cerr << "ridgecast-server: " << sentence << "\n";
  return 2;
}

// Names begin unindented lines and details are indented, readable for people and scripts.
int listTerrains(const std::filesystem::path& folder) {
  const auto entries = user_terrain::list(folder);
  if (!entries) return refuse(entries.error().message);
  for (const user_terrain::Entry& e : *entries) {
    std::cout << e.name << "\n";
    if (!e.summary.empty()) std::cout << "    " << e.summary << "\n";
    if (!e.problem.empty()) std::cout << "    cannot be used: " << e.problem << "\n";
    for (const glsl::Parameter& p : e.parameters) std::cout << "    --param " << glsl::describe(p) << "\n";
  }
  return 0;
}

// Settings as written; finish() turns them into a Config.
struct Written {
  Config config;
  bool isPrivate = false, quiet = false;
  std::vector<std::string> parameters, raster, trustedProxies, allowedHosts, secretFiles, keyFiles;
  double snapshotShare = 10;  // percent
  int jwtLeeway = 60;         // seconds
  std::string logFormat = "text", logLevel = "info";
};

// Help shows the first of several long names; the others are old ones.
class FirstNames final : public CLI::Formatter {
  std::string make_option_name(const CLI::Option* option, bool isPositional) const override {
    const auto& names = option->get_lnames();
    return names.size() > 1 ? "--" + names.front() : Formatter::make_option_name(option, isPositional);
  }
};

void addList(CLI::App& app, const char* flag, std::vector<std::string>& values, const char* type, const char* text) {
  app.add_option(flag, values, text)->type_name(type)->allow_extra_args(false);
}

template <class Number>
void addNumber(CLI::App& app, const char* flag, Number& value, const char* text, std::type_identity_t<Number> least,
               std::type_identity_t<Number> most) {
  app.add_option(flag, value, text)->check(CLI::Range(least, most))->capture_default_str();
}

void addSeconds(CLI::App& app, const char* flag, std::chrono::milliseconds& value, const char* text, int least, int most) {
  app.add_option_function<int>(
         flag, [&value](int seconds) { value = std::chrono::seconds(seconds); }, text)
      ->check(CLI::Range(least, most))
      ->default_str(std::to_string(value / std::chrono::seconds(1)));
}

void addTerrain(CLI::App& app, Written& w) {
  Config& c = w.config;
  app.add_option("--terrain", c.terrain.terrain,
                 "Terrain of the default session: a name, a terrain file NAME.glsl, or a height map, such as NAME.tif, or a folder of them")
      ->capture_default_str();
  app.add_option("--seed", c.terrain.seed, "Seed of that terrain")->capture_default_str();
  addList(app, "--param", w.parameters, "NAME=NUMBER", "Set a parameter of the terrain, NAME=NUMBER; repeatable");
  addList(
      app, "--raster", w.raster, "NAME=VALUE",
      "How to read a height map, NAME=VALUE; repeatable: pitch=METRES, scale=NUMBER, offset=METRES, "
      "edge=clamp|mirror|repeat|METRES, missing=VALUE, nodata=METRES|fill, place=centre|geo, project=local, class=VALUE:NAME; raw files: "
      "size=COLUMNSxROWS, order=little|big, type=unsigned|signed");
  app.add_option("--drape", c.terrain.raster.drape,
                 "Picture on a height map: a GeoTIFF of red, green and blue in the map's CRS, or a .txt of heights and colours")
      ->type_name("FILE");
  app.add_option(
         "--classes", c.terrain.raster.classes,
         "What a height map's ground is made of: a GeoTIFF of whole numbers in the map's CRS, such as land cover, named by --raster "
         "class=VALUE:NAME")
      ->type_name("FILE");
  app.add_option("--terrain-dir", c.terrain.folder, "Folder of terrain files NAME.glsl and height maps, each available as NAME")
      ->type_name("DIR");
  app.add_option("--terrain-cache", c.terrain.build.cache, "Folder for compiled terrains; default: your cache folder")->type_name("DIR");
  app.add_flag("--watch", c.watch, "Reload terrain files when they are saved; a file with errors changes nothing");
  app.add_flag("--private-terrain", w.isPrivate,
               "Never send the terrain's text or samples; send colours and normals with the vertices instead");
}

void addListening(CLI::App& app, Written& w) {
  Config& c = w.config;
  app.add_option("--host", c.net.host, "Address to listen on")->capture_default_str();
  app.add_option("--port", c.net.port, "Port to listen on; 0: any free one")->capture_default_str();
  app.add_option("--admin-port", c.net.adminPort,
                 "Another port, plain and without tokens, for /healthz, /readyz, /metrics and /version; 0: none")
      ->capture_default_str();
  app.add_option("--admin-host", c.net.adminHost, "Address of the admin port; default: that of --host");
  app.add_option("--port-file", c.portFile, "Write the port to this file once the server listens")->type_name("FILE");
  app.add_flag("--end-with-input", c.endsWithInput,
               "End, as on SIGTERM, when the standard input ends: a program that holds the other end of that pipe leaves no server behind");
  app.add_option("--web-dir", c.webFolder, "Folder of the browser viewer; default: the one installed or built with this program")
      ->type_name("DIR");
  addNumber(app, "--threads", c.threads, "Threads for meshes; 0: one for each core", 0, 1024);
}

void addAccess(CLI::App& app, Written& w) {
  net::Settings& n = w.config.net;
  app.add_option("--tls-cert", n.tlsCertificate, "Certificate chain (PEM), for TLS; SIGHUP reloads it")->type_name("FILE");
  app.add_option("--tls-key", n.tlsKey, "Private key of the certificate (PEM)")->type_name("FILE");
  app.add_option("--token-file", n.tokens.tokens, "Tokens and their rights, see 'ridgecast-server token --help'; SIGHUP reloads it")
      ->type_name("FILE");
  addList(app, "--jwt-secret-file", w.secretFiles, "FILE",
          "Secret of JSON Web Tokens (HS256), at least 32 bytes; repeatable, all are valid; SIGHUP reloads it");
  addList(app, "--jwt-key-file", w.keyFiles, "FILE",
          "Public keys of JSON Web Tokens (RS256, ES256), PEM or a JSON Web Key Set; repeatable; SIGHUP reloads it");
  app.add_option("--jwt-key-url", n.tokens.keyUrl,
                 "URL (https) of a JSON Web Key Set; fetched at the start, on SIGHUP, and when a token names another key, once a minute")
      ->type_name("URL");
  app.add_option("--jwt-key-ca", n.tokens.keyAuthorities, "Authorities (PEM) for the certificate of --jwt-key-url; default: the system's")
      ->type_name("FILE");
  app.add_option("--jwt-audience", n.tokens.jwt.audience, "Audience (aud) that JSON Web Tokens must have; default: any")->type_name("TEXT");
  app.add_option("--jwt-issuer", n.tokens.jwt.issuer, "Issuer (iss) that JSON Web Tokens must have; default: any")->type_name("TEXT");
  addNumber(app, "--jwt-leeway", w.jwtLeeway, "Seconds by which the clocks of issuers may differ", 0, 3600);
  addList(app, "--allow-origin", n.allowedOrigins, "ORIGIN", "Another origin whose pages may connect, such as https://example.org; *: any");
  addList(app, "--allowed-host", w.allowedHosts, "NAME",
          "Another host name that a server without tokens answers to, besides its addresses and localhost; *: any");
  addList(app, "--trusted-proxy", w.trustedProxies, "CIDR", "Networks whose X-Forwarded-For is trusted, such as 10.0.0.0/8");
  app.add_flag("--allow-insecure", n.allowInsecure, "Permit addresses other than loopback without TLS or without tokens");
}

void addLimits(CLI::App& app, Written& w) {
  Config& c = w.config;
  addNumber(app, "--max-cameras", c.limits.maxCameras, "Cameras at a time, in all sessions", 1, 65535);
  addNumber(app, "--max-members", c.limits.maxMembers, "Cameras at a time in one session", 1, presence::kMaxMembers);
  addNumber(app, "--max-sessions", c.limits.maxSessions, "Sessions at a time, including the default one; 1: clients cannot create any", 1,
            65535);
  addNumber(app, "--max-sessions-per-client", c.limits.maxSessionsPerClient,
            "Sessions at a time made by one token's holder or, without tokens, one address; 0: unlimited", 0, 65535);
  addSeconds(app, "--session-idle", c.limits.sessionIdle,
             "Seconds after which a session without members ends, at most 5 if nobody has said hello; the default session never ends", 1,
             31'536'000);
  addNumber(app, "--max-connections", c.net.maxConnections, "Connections at a time", 1, 65535);
  addNumber(app, "--max-connections-per-address", c.net.maxConnectionsPerAddress,
            "Connections at a time from one client address; 0: unlimited", 0, 65535);
  addNumber(app, "--max-header-bytes", c.net.maxHeaderBytes, "Longest header of an HTTP request", 1024, 65536);
  addNumber(app, "--max-message-bytes", c.net.maxMessageBytes, "Longest message of a client", 1024, wire::kMaxClientMessageBytes);
  app.add_option("--max-messages-per-second", c.net.maxMessagesPerSecond,
                 "Messages of one connection that are read in a second; 0: unlimited")
      ->capture_default_str();
  addNumber(app, "--max-heights-per-second", c.limits.maxHeightsPerSecond,
            "Heights of the terrain in a second for one client's answers, a ray some ten; 0: unlimited", 0, 1'000'000'000'000);
  addNumber(app, "--max-triangles", c.limits.mesh.maxBudget, "Largest triangle budget a client is granted", 10'000, 50'000'000);
  addNumber(app, "--max-total-triangles", c.limits.maxTotalTriangles,
            "Triangle budgets of all cameras together; 0: half of the memory that the process may use", 0, 1'000'000'000'000);
  addNumber(app, "--max-snapshot-triangles", c.snapshots.triangles, "Largest snapshot, in triangles", 10'000, 20'000'000);
  addNumber(app, "--max-snapshot-seconds", c.snapshots.seconds, "Time limit of a snapshot, in seconds", 1, 600);
  addNumber(app, "--snapshot-share", w.snapshotShare, "Percent of all cores that snapshots get while cameras work", 1, 100);
  addNumber(app, "--cache-memory", c.cacheMemory, "MiB of snapshots and tiles kept for repeated requests", 0, 65536);
  addNumber(app, "--window", c.limits.window, "Iterations that a client may leave unacknowledged", 1, wire::kMaxWindow);
  app.add_option("--max-bytes-per-second", c.limits.maxBytesPerSecond, "Bytes a second of one client's iterations; 0: unlimited")
      ->capture_default_str();
  addSeconds(app, "--timeout,--patience", c.net.timeout, "Timeout in seconds of each of: TLS handshake, request, hello", 1, 600);
  addSeconds(app, "--idle", c.net.idle, "Seconds of silence after which a stream is closed; a ping is sent after half of them", 2, 86400);
}

void addOperation(CLI::App& app, Written& w) {
  app.add_option("--state", w.config.state, "Folder in which the edits of sessions are kept; without it they end with their session");
  app.add_option("--record", w.config.record, "Folder in which every session is recorded, for 'ridgecast-server replay'")->type_name("DIR");
  addNumber(app, "--record-bytes", w.config.recordBytes,
            "Largest total of the recordings in that folder, in bytes; the oldest parts are deleted", 1'048'576, std::uint64_t{1} << 50);
  app.add_option(
         "--shared", w.config.shared.url,
         "Redis that this server shares its worlds with others by, redis://[USER:PASSWORD@]HOST[:PORT][/DATABASE], under TLS rediss://")
      ->type_name("URL");
  app.add_option("--shared-password-file", w.config.shared.passwordFile, "Password of that Redis, instead of one in the URL")
      ->type_name("FILE");
  app.add_option("--shared-ca", w.config.shared.ca, "Certificate authorities (PEM) to trust for rediss:// instead of the system's")
      ->type_name("FILE");
  addSeconds(app, "--drain-delay", w.config.net.drainDelay,
             "Seconds after SIGTERM during which the server serves as before while /readyz says 503, because balancers lag", 0, 3600);
  addSeconds(app, "--drain", w.config.net.drain, "Seconds to wait for clients to leave after SIGTERM", 0, 3600);
  app.add_option("--url", w.config.net.url, "URL of this server alone, for people and other servers; default: that of its port")
      ->type_name("URL");
  app.add_option("--reconnect-url", w.config.net.reconnectUrl,
                 "URL for clients to reconnect to when this server leaves; default: the same address")
      ->type_name("URL");
  app.add_option("--log-format", w.logFormat, "text, or json: one object a line")
      ->check(CLI::IsMember({"text", "json"}))
      ->capture_default_str();
  app.add_option("--log-level", w.logLevel, "debug, info, warning or error")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
      ->capture_default_str();
  app.add_flag("--quiet", w.quiet, "Same as --log-level warning");
}

template <class T>
std::optional<Error> parseAll(const std::vector<std::string>& texts, Outcome<T> (*parse)(std::string_view), std::vector<T>& out) {
  for (const std::string& text : texts) {
    auto value = parse(text);
    if (!value) return value.error();
    out.push_back(std::move(*value));
  }
  return std::nullopt;
}

// Error: one sentence.
Outcome<Config> finish(Written&& w) {
  Config& c = w.config;
  c.limits.sendsTerrain = !w.isPrivate;
  c.terrain.build.colours = w.isPrivate;
  c.terrain.build.prober = "/proc/self/exe";  // main() calls asProbe
  // Absolute, so that what clients are told can leave the folders out (text::withoutFolders).
  if (std::filesystem::path(c.terrain.terrain).has_parent_path()) c.terrain.terrain = std::filesystem::absolute(c.terrain.terrain);
  for (std::filesystem::path* path : {&c.terrain.folder, &c.terrain.raster.drape, &c.terrain.raster.classes})
    if (!path->empty()) *path = std::filesystem::absolute(*path);
  if (const auto error = parseAll(w.parameters, glsl::parseAssignment, c.terrain.parameters)) return *error;
  if (const auto error = parseAll(w.trustedProxies, access::Network::parse, c.net.trustedProxies)) return *error;
  if (const auto error = parseAll(w.allowedHosts, access::parseHostName, c.net.allowedHosts)) return *error;
  c.net.tokens.jwt.leeway = std::chrono::seconds(w.jwtLeeway);
  if (!c.net.tokens.keyUrl.empty())
    if (const auto url = net::HttpsUrl::parse(c.net.tokens.keyUrl); !url) return url.error();
  c.net.tokens.secrets.assign(w.secretFiles.begin(), w.secretFiles.end());
  c.net.tokens.keys.assign(w.keyFiles.begin(), w.keyFiles.end());
  for (const std::string& option : w.raster)
    if (auto added = raster::addRasterOption(option, c.terrain.raster); !added) return added.error();
  c.limits.mesh.defaultBudget = std::min(c.limits.mesh.defaultBudget, c.limits.mesh.maxBudget);
  if (c.limits.maxTotalTriangles == 0) c.limits.maxTotalTriangles = memory::available() / 2 / session::kBytesPerTriangle;
  if (c.limits.maxTotalTriangles != 0)
    c.limits.maxTotalTriangles = std::max<std::uint64_t>(c.limits.maxTotalTriangles, settings::kMinBudget);
  c.snapshots.share = w.snapshotShare / 100;
  if (!c.state.empty() && c.watch) return Error{"--watch changes the ground under edits that --state keeps; leave one of them out."};
  if (!c.shared.url.empty())
    if (const auto address = bus::parseAddress(c.shared.url); !address) return address.error();
  c.limits.maxMembers = std::min(c.limits.maxMembers, c.limits.maxCameras);
  if (w.logFormat == "json") c.logFormat = logging::Format::kJson;
  const std::map<std::string, logging::Level> levels{{"debug", logging::Level::kDebug},
                                                     {"info", logging::Level::kInfo},
                                                     {"warning", logging::Level::kWarning},
                                                     {"error", logging::Level::kError}};
  c.logLevel = levels.at(w.logLevel);
  if (w.quiet) c.logLevel = std::max(c.logLevel, logging::Level::kWarning);
  return Outcome<Config>(boost::system::in_place_value, std::move(c));
}

}  // namespace

Parsed parse(int argc, const char* const* argv, const char* const* environment) {
  if (argc > 1 && std::string_view(argv[1]) == "token") return {std::nullopt, runTokenCommand(argc - 1, argv + 1)};
  Written w;
  bool list = false, print = false;
  std::filesystem::path file;
  CLI::App app(
      "Streams endless terrain, triangulated for each camera. 'ridgecast-server token' issues tokens;\n"
      "'ridgecast-server healthy' checks a running server with the same settings;\n"
      "'ridgecast-server check FILE' tries a terrain file or a height map, and says what it is;\n"
      "'ridgecast-server snapshot FILE|FOLDER/ QUERY' makes a snapshot, or tiles, of the terrain without serving it;\n"
      "'ridgecast-server edits list|export|import|compact|verify|backup FILE' manages a session's log of edits;\n"
      "'ridgecast-server replay FILE|DIR' repeats recordings (--record) and compares every mesh.\n"
      "--help after token, check, snapshot, edits or replay says more.\n"
      "A flag overrides its environment variable (--max-cameras: RIDGECAST_MAX_CAMERAS), which overrides the settings file.",
      "ridgecast-server");
  app.formatter(std::make_shared<FirstNames>());
  app.get_formatter()->column_width(34);
  app.get_help_ptr()->configurable(false);
  app.set_version_flag("--version", version::describe("ridgecast-server", wire::kProtocolVersion))->configurable(false);
  app.add_option("--config", file, "Settings file (TOML): flags without hyphens in front, such as max-cameras = 64")
      ->type_name("FILE")
      ->configurable(false);
  app.add_flag("--print-config", print, "Print every setting and where it comes from")->configurable(false);
  app.add_flag("--list-terrains", list, "List the available terrains and their parameters")->configurable(false);
  addListening(app, w);
  addTerrain(app, w);
  addAccess(app, w);
  addLimits(app, w);
  addOperation(app, w);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& e) {  // --help, --version
    return {std::nullopt, app.exit(e)};
  } catch (const CLI::ParseError& e) {
    return {std::nullopt, refuse(std::string(e.what()) + "; see --help.")};
  }
  const std::string variable = variableOf("config") + "=";
  for (const char* const* entry = environment; file.empty() && *entry; ++entry)
    if (std::string_view(*entry).starts_with(variable)) file = *entry + variable.size();
  auto layers = addLayers(app, file, environment);
  if (!layers) return {std::nullopt, refuse(layers.error().message)};
  if (print) {
    std::cout << describe(app, *layers);
    return {std::nullopt, 0};
  }
  if (list) return {std::nullopt, listTerrains(w.config.terrain.folder)};
  auto config = finish(std::move(w));
  if (!config) return {std::nullopt, refuse(config.error().message)};
  config->ignoredVariables = std::move(layers->ignored);
  return {std::move(*config), 0};
}

}  // namespace ridgecast::config
