#include "server/http/lists.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "common/text/text.h"
#include "common/user_terrain/catalogue.h"

namespace ridgecast::http {

const char* nameOf(wire::ClockMode mode) {
  constexpr const char* kModes[] = {"real-time", "scaled", "stepped"};
  return kModes[static_cast<int>(mode)];
}

namespace {

using Json = nlohmann::ordered_json;

Json heightMap(const terrain::Raster& map) {
  const terrain::RasterShape& shape = map.shape();
  const terrain::RasterOrigin origin = map.origin();
  const auto metres = [](double steps) { return steps * lattice::kMetresPerStep; };
  Json out{{"columns", shape.width},
           {"rows", shape.height},
           {"pitch", shape.x.metres()},
           {"pitch_z", shape.z.metres()},
           {"x", metres(static_cast<double>(shape.x.origin))},
           {"z", metres(static_cast<double>(shape.z.origin))},
           {"lowest", metres(shape.lowest)},
           {"highest", metres(shape.highest)},
           {"edge", origin.edge}};
  if (!origin.crs.empty()) out["crs"] = origin.crs;
  if (origin.easting) out["centre"] = {{"easting", *origin.easting}, {"northing", *origin.northing}};
  return out;
}

std::string dumped(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Json serverEntry(const directory::ServerStatus& server) {
  return {{"number", server.number},
          {"url", server.url},
          {"cameras", server.cameras},
          {"triangles", server.triangles},
          {"load", std::round(server.load * 100) / 100}};
}

}  // namespace

std::string sessionEntry(const session::Session& session) {
  const presence::Presence::State state = session.presence().state();
  const wire::Clock& clock = state.clock;
  const session::Limits& limits = session.resources().limits;
  const std::uint32_t server = session.resources().bus->server();  // the others tell of theirs
  const auto isOwnSensor = [server](const wire::Member& member) {
    return member.role == wire::Role::kSensor && (server == 0 || member.camera >> 32 == server);
  };
  Json parameters = Json::object();
  for (const auto& [name, value] : session.spec().parameters) parameters[name] = value;
  Json entry{{"name", session.name()},
             {"terrain", session.spec().terrain},
             {"seed", session.spec().seed},
             {"parameters", parameters},
             {"content_hash", text::hexadecimal(session.contentHash())},
             {"step_bits", lattice::kStepBits},
             {"members", session.members()},
             {"sensors", std::ranges::count_if(state.members, isOwnSensor)},
             {"max_members", limits.maxMembers},
             {"clock",
              {{"mode", nameOf(clock.mode)},
               {"rate", clock.rate},
               {"seconds", static_cast<double>(clock.time) / 1e6},
               {"step", clock.step},
               {"waits_for", clock.waitsFor.size()},
               {"owner", clock.owner ? Json{{"camera", clock.owner}, {"name", state.ownerName}} : Json()}}}};
  if (const terrain::Raster* map = session.terrain()->raster(); map && limits.sendsTerrain) entry["height_map"] = heightMap(*map);
  if (const auto own = session.terrain()->ownMaterials(); !own.empty()) entry["materials"] = own;
  return dumped(entry);
}

Answer sessionsAnswer(const directory::Directory& directory) {
  std::map<std::string, Json> sessions;
  Json servers = Json::array();
  const auto others = directory.others();
  const auto add = [&](const std::string& name, std::string_view entry, std::uint32_t server) {
    Json its = Json::parse(entry, nullptr, false);
    const auto [known, isNew] = sessions.try_emplace(name, its);
    if (!isNew)
      for (const char* count : {"members", "sensors"}) known->second[count] = known->second[count].get<int>() + its.value(count, 0);
    if (directory.isShared()) known->second["servers"].push_back(server);
  };
  for (const auto& session : directory.all()) add(session->name(), sessionEntry(*session), directory.resources().bus->server());
  for (const auto& server : *others)
    for (const auto& [name, session] : server.sessions) add(name, session.entry, server.number);
  Json all{{"sessions", Json::array()}, {"max_sessions", directory.resources().limits.maxSessions}};
  for (auto& [name, entry] : sessions) all["sessions"].push_back(std::move(entry));
  if (directory.isShared()) {
    for (const auto& server : *others) servers.push_back(serverEntry(server));
    servers.push_back(serverEntry(directory.self()));
    all["servers"] = std::move(servers);
  }
  return json(dumped(all) + "\n");
}

Route terrainsRoute(std::optional<std::filesystem::path> folder) {
  const auto answer = [folder = std::move(folder)](const Turn&) {
    Json terrains = Json::array();
    const auto entries = folder ? user_terrain::list(*folder) : std::vector<user_terrain::Entry>();
    if (!entries) return refused(503, metrics::Refusal::kRequest, text::withoutFolders(entries.error().message));
    for (const user_terrain::Entry& entry : *entries) {
      if (!entry.problem.empty()) continue;
      Json parameters = Json::array();
      for (const glsl::Parameter& p : entry.parameters)
        parameters.push_back(
            {{"name", p.name}, {"default", p.value}, {"least", p.least}, {"most", p.most}, {"unit", p.unit}, {"summary", p.summary}});
      terrains.push_back({{"name", entry.name}, {"summary", entry.summary}, {"parameters", parameters}});
    }
    return json(Json{{"terrains", terrains}}.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
  };
  return [answer](const Request& request) -> std::optional<Reply> {
    if (request.path() != "/v1/terrains") return {};
    if (!request.reads()) return wrongMethod();
    return DeferredResponse{.work = answer};
  };
}

}  // namespace ridgecast::http
