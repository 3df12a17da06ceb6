#include "server/config.h"

#include <CLI/CLI.hpp>
#include <iostream>

#include "common/wire/wire.h"

namespace ridgecast::config {

namespace {

// Names begin unindented lines, details are indented: easy to read for people and for scripts.
int listTerrains(const std::filesystem::path& folder) {
  const auto entries = user_terrain::list(folder);
  if (!entries) {
    std::cerr << "ridgecast-server: " << entries.error().message << "\n";
    return 2;
  }
  for (const user_terrain::Entry& e : *entries) {
    std::cout << e.name << "\n";
    if (!e.summary.empty()) std::cout << "    " << e.summary << "\n";
    if (!e.problem.empty()) std::cout << "    cannot be used: " << e.problem << "\n";
    for (const user_terrain::Parameter& p : e.parameters) std::cout << "    --param " << user_terrain::describe(p) << "\n";
  }
  return 0;
}

}  // namespace

Parsed parse(int argc, const char* const* argv) {
  Config c;
  bool list = false, isPrivate = false;
  std::vector<std::string> parameters;
  long long patience = c.net.patience.count() / 1000;
  CLI::App app("Streams endless terrain, triangulated for each camera.", "ridgecast-server");
  app.get_formatter()->column_width(34);
  app.set_version_flag("--version", "ridgecast-server " RIDGECAST_VERSION ", protocol " + std::to_string(wire::kProtocolVersion));
  app.add_option("--host", c.net.host, "Address to listen on")->capture_default_str();
  app.add_option("--port", c.net.port, "Port to listen on; 0: any free one")->capture_default_str();
  app.add_option("--port-file", c.portFile, "Write the port to this file once the server listens");
  app.add_flag("--allow-insecure", c.net.allowInsecure, "Listen on other than loopback addresses, without encryption or access control");
  app.add_option("--terrain", c.terrain.terrain, "Terrain of the default session: a name, or a file of your own, NAME.glsl")->capture_default_str();
  app.add_option("--seed", c.terrain.seed, "Its seed")->capture_default_str();
  app.add_option("--param", parameters, "Set a parameter of the terrain, NAME=NUMBER; may be given several times")
      ->type_name("NAME=NUMBER")
      ->allow_extra_args(false);
  app.add_option("--terrain-dir", c.terrain.folder, "A folder of terrain files, to be had by name")->type_name("DIR");
  app.add_option("--terrain-cache", c.terrain.cache, "Where compiled terrains are kept; left out: in your own cache folder")->type_name("DIR");
  app.add_flag("--private-terrain", isPrivate, "Never send the terrain's text; clients that do not have it draw neutrally");
  app.add_flag("--list-terrains", list, "List the terrains there are and their parameters");
  app.add_option("--threads", c.threads, "Threads that work on meshes; 0: as many as the machine has")
      ->check(CLI::Range(0u, 1024u))
      ->capture_default_str();
  app.add_option("--max-cameras", c.limits.maxCameras, "Cameras at a time, of all sessions")
      ->check(CLI::Range(1u, 65535u))
      ->capture_default_str();
  app.add_option("--max-members", c.limits.maxMembers, "Cameras at a time in one session")
      ->check(CLI::Range(1u, 65535u))
      ->capture_default_str();
  app.add_option("--max-connections", c.net.maxConnections, "Connections at a time")->check(CLI::Range(1u, 65535u))->capture_default_str();
  app.add_option("--max-triangles", c.limits.mesh.maxBudget, "Largest triangle budget a client is granted")
      ->check(CLI::Range(10'000u, 50'000'000u))
      ->capture_default_str();
  app.add_option("--window", c.limits.window, "Iterations that a client may leave unacknowledged")
      ->check(CLI::Range(1u, wire::kMaxWindow))
      ->capture_default_str();
  app.add_option("--max-bytes-per-second", c.limits.maxBytesPerSecond, "Most that the iterations of one client may take; 0: no limit")
      ->capture_default_str();
  app.add_option("--patience", patience, "Seconds to wait for a request or a hello")->check(CLI::Range(1ll, 600ll))->capture_default_str();
  app.add_flag("--quiet", c.quiet, "Log warnings and errors only");
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& e) {  // --help, --version
    return {std::nullopt, app.exit(e)};
  } catch (const CLI::ParseError& e) {
    std::cerr << "ridgecast-server: " << e.what() << "; --help lists what there is.\n";
    return {std::nullopt, 2};
  }
  if (list) return {std::nullopt, listTerrains(c.terrain.folder)};
  c.limits.sendsTerrain = !isPrivate;
  for (const std::string& p : parameters) {
    auto assignment = user_terrain::parseAssignment(p);
    if (!assignment) {
      std::cerr << "ridgecast-server: " << assignment.error().message << "\n";
      return {std::nullopt, 2};
    }
    c.terrain.parameters.push_back(std::move(*assignment));
  }
  c.net.patience = std::chrono::seconds(patience);
  c.limits.mesh.defaultBudget = std::min(c.limits.mesh.defaultBudget, c.limits.mesh.maxBudget);
  c.limits.maxMembers = std::min(c.limits.maxMembers, c.limits.maxCameras);
  return {std::move(c), 0};
}

}  // namespace ridgecast::config
