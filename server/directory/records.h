#pragma once
// What servers of one world tell each other of their sessions and of themselves, as text for the bus (JSON; unknown members are ignored, so
// that servers of two versions can work together).

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "server/session/world_spec.h"

namespace ridgecast::directory {

// A session on any server.
struct World {
  std::string id;  // the same on every server that has the session; one that ended and was made again has another
  session::WorldSpec spec;
  std::uint64_t contentHash = 0;  // terrain::contentHash
  std::string maker;              // as http::Request::client; empty: an operator

  bool hasGroundOf(const World& other) const {
    return spec.terrain == other.spec.terrain && spec.seed == other.spec.seed && spec.parameters == other.spec.parameters &&
           contentHash == other.contentHash;
  }
};

std::string describe(const World& world);  // for people
std::string toText(const World& world);
Outcome<World> worldOf(std::string_view text);  // Error: one sentence

// A server, as it says of itself once a second.
struct ServerStatus {
  struct Session {
    World world;
    std::uint64_t epoch = 0;    // of the world's record, as this server knows it
    std::uint32_t members = 0;  // there
    std::string entry;          // JSON object: the session in /v1/sessions
  };
  std::uint32_t number = 0;
  std::string url;
  std::uint32_t cameras = 0;
  std::uint64_t triangles = 0;  // set aside
  double load = 0;              // 0 to 1
  std::map<std::string, Session, std::less<>> sessions;
};

std::string toText(const ServerStatus& status);
Outcome<ServerStatus> statusOf(std::string_view text);

}  // namespace ridgecast::directory
