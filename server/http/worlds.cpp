#include "server/http/worlds.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "common/text/text.h"
#include "common/user_terrain/catalogue.h"
#include "common/wire/wire.h"

namespace ridgecast::http {

namespace {

using session::WorldSpec;

bool upgrades(const Request& request) { return request.upgrade && request.webSocketVersion == "13"; }

// Of a request that would be upgraded if it asked for it.
Answer upgradeRequired() {
  return plain(426, "This is a WebSocket endpoint (version 13): connect with ws://, for example with ridgecast-client.",
               {{"Upgrade", "websocket"}, {"Connection", "Upgrade"}, {"Sec-WebSocket-Version", "13"}});
}

constexpr const char* kModes[] = {"real-time", "scaled", "stepped"};  // by wire::ClockMode
const char* nameOf(wire::ClockMode mode) { return kModes[static_cast<int>(mode)]; }

// The URL's world. It may omit the terrain only for an existing session.
struct Wish {
  std::string terrain;
  std::optional<std::uint32_t> seed;
  std::vector<std::pair<std::string, double>> parameters;
  std::optional<wire::ClockMode> clock;

  bool isMetBy(const WorldSpec& spec) const {
    if (!terrain.empty() && terrain != spec.terrain) return false;
    if (seed && *seed != spec.seed) return false;
    return parameters.empty() || parameters == spec.parameters;
  }
};

bool nameIsHarmless(std::string_view name) { return !name.empty() && name.size() <= wire::kMaxNameBytes && text::hasOnly(name, "_-"); }

constexpr std::size_t kMaxParameters = 32;

Outcome<Wish> readWish(std::string_view query) {
  Wish wish;
  const auto terrain = queryParameter(query, "terrain");
  if (!terrain) return terrain.error();
  wish.terrain = *terrain;
  if (!wish.terrain.empty() && !nameIsHarmless(wish.terrain))
    return Error{"A terrain's name has letters, digits, underscores or hyphens; ridgecast-server --list-terrains lists the names."};
  const auto seed = queryParameter(query, "seed");
  if (!seed) return seed.error();
  wish.seed = text::number<std::uint32_t>(*seed);
  if (!seed->empty() && !wish.seed) return Error{"A seed is a whole number from 0 to 4294967295."};
  const auto clock = queryParameter(query, "clock");
  if (!clock) return clock.error();
  for (const auto mode : {wire::ClockMode::kRealTime, wire::ClockMode::kStepped})
    if (*clock == nameOf(mode)) wish.clock = mode;
  if (!clock->empty() && !wish.clock) return Error{"A session's clock begins as clock=real-time, the default, or clock=stepped."};
  const auto assignments = queryParameters(query, "param");
  if (!assignments) return assignments.error();
  for (const std::string& assignment : *assignments) {
    std::string_view rest = assignment;
    const std::string name(text::takePart(rest, '='));
    const auto value = text::number<double>(rest);
    if (!nameIsHarmless(name) || !value) return Error{"A parameter is given as param=NAME=NUMBER."};
    if (wish.parameters.size() >= kMaxParameters) return Error{"A world has at most " + std::to_string(kMaxParameters) + " parameters."};
    wish.parameters.emplace_back(name, *value);
  }
  std::sort(wish.parameters.begin(), wish.parameters.end());
  const auto twice =
      std::adjacent_find(wish.parameters.begin(), wish.parameters.end(), [](const auto& a, const auto& b) { return a.first == b.first; });
  if (twice != wish.parameters.end()) return Error{"The parameter '" + twice->first + "' is given twice; give it once."};
  return wish;
}

std::string describe(const WorldSpec& spec) {
  std::string out = "terrain " + spec.terrain + ", seed " + std::to_string(spec.seed);
  for (const auto& [name, value] : spec.parameters) out += ", " + name + "=" + text::rounded(value, 9);
  return out;
}

std::string otherWorld(const std::string& session, const WorldSpec& spec) {
  return "Session '" + session + "' is another world (" + describe(spec) +
         ") and does not change while it lives; leave the terrain out to join it, or choose another name.";
}

// Joins, if the session has the requested world.
Reply join(std::shared_ptr<session::Session> session, const Wish& wish, const Enter& enter) {
  const WorldSpec& spec = session->spec();
  if (wish.clock.value_or(spec.clock) != spec.clock)
    return refused(409, metrics::Refusal::kSession,
                   "Session '" + session->name() + "' began with clock=" + nameOf(spec.clock) + "; leave clock=" + nameOf(*wish.clock) +
                       " out to join it, or choose another name.");
  if (wish.isMetBy(spec)) return enter(std::move(session));
  return refused(409, metrics::Refusal::kSession, otherWorld(session->name(), spec));
}

Answer refusedFor(const directory::Directory::Full& full) {
  return refused(full.isOwn ? 429 : 503, metrics::Refusal::kFull, full.sentence);
}

constexpr std::chrono::milliseconds kNameTaken{10};  // before a name is asked for again

// A turn: not made yet, as long as somebody else has the name. The answer to a client that has left is not read: then nothing is made.
Reply make(const std::string& name, Wish wish, const std::string& client, directory::Directory& directory, const Enter& enter, bool makes,
           const std::stop_token& stop) {
  auto reserved = directory.reserve(name);
  if (!reserved) return refused(503, metrics::Refusal::kSession, reserved.error().message, {{"Retry-After", "1"}});
  if (!*reserved) {  // another request was faster
    if (auto session = directory.find(name)) return join(std::move(session), wish, enter);
    return RetryAt{std::chrono::steady_clock::now() + kNameTaken};
  }
  if (const edit_log::World* const kept = (*reserved)->kept()) {  // nobody is in it, but its edits are kept
    const WorldSpec spec{kept->terrain, kept->seed, kept->parameters, wire::ClockMode::kRealTime};
    if (!wish.isMetBy(spec)) return refused(409, metrics::Refusal::kSession, otherWorld(name, spec));
    wish.terrain = spec.terrain, wish.seed = spec.seed, wish.parameters = spec.parameters;
  }
  if (wish.terrain.empty()) return noSession(name, directory);
  const WorldSpec spec{wish.terrain, wish.seed.value_or(1), wish.parameters, wish.clock.value_or(wire::ClockMode::kRealTime)};
  auto terrain = directory.resources().makeTerrain(spec, stop);
  if (!terrain) return refused(400, metrics::Refusal::kSession, "Session '" + name + "' cannot be created: " + terrain.error().message);
  if (stop.stop_requested()) return refused(503, metrics::Refusal::kSession, "Session '" + name + "' was not created: its client left.");
  if (!makes) return enter(nullptr);
  const auto added = directory.add(std::move(*reserved), std::move(*terrain), spec.parameters, client, spec.clock);
  if (added) return enter(*added);
  const auto full = directory.full(client);
  return full ? refusedFor(*full) : refused(503, metrics::Refusal::kFull, added.error().message);
}

}  // namespace

Reply inSession(const Request& request, directory::Directory& directory, const Enter& enter, bool makes) {
  const auto name = queryParameter(request.query(), "session");
  if (!name) return refused(400, metrics::Refusal::kSession, name.error().message);
  const std::string wanted = name->empty() ? std::string(directory::kDefaultName) : *name;
  if (!wire::sessionNameIsValid(wanted))
    return refused(
        400, metrics::Refusal::kSession,
        "A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens.");
  auto wish = readWish(request.query());
  if (!wish) return refused(400, metrics::Refusal::kSession, wish.error().message);
  if (auto session = directory.find(wanted)) return join(std::move(session), *wish, enter);
  const bool isKept = directory.keeps(wanted);
  if (wanted == directory::kDefaultName || (wish->terrain.empty() && !isKept)) return noSession(wanted, directory);
  if (!request.rights.has(access::Right::kCreate))
    return refused(403, metrics::Refusal::kRight, "There is no session named '" + wanted + "', and the token lacks the right 'create'.");
  if (!directory.resources().makeTerrain)
    return refused(403, metrics::Refusal::kSession, "Sessions cannot be created on this server; 'default' always exists.");
  const std::string client(request.client);
  if (const auto full = directory.full(client)) return refusedFor(*full);
  const auto builtIn = terrain::builtIn();
  const bool atOnce = !isKept && wish->parameters.empty() &&
                      std::any_of(builtIn.begin(), builtIn.end(), [&](const auto& d) { return d.name == wish->terrain; });
  if (atOnce)
    if (Reply made = make(wanted, *wish, client, directory, enter, makes, {}); !std::holds_alternative<RetryAt>(made)) return made;
  return DeferredResponse{
      .queue = Queue::kWorlds,
      .work = [=, wish = *wish, &directory](const Turn& turn) { return make(wanted, wish, client, directory, enter, makes, turn.stop); },
      .progress = [] { return "preparing the terrain"; }};
}

Outcome<earth::Coordinates> coordinatesOf(const session::Session& session, std::string_view crs) {
  const auto terrain = session.ground().terrain;
  return earth::Coordinates::of(session.resources().limits.sendsTerrain ? terrain->raster() : nullptr, crs);
}

Reply streamAnswer(const Request& request, directory::Directory& directory) {
  const bool upgrading = upgrades(request);
  const auto enter = [upgrading](std::shared_ptr<session::Session> session) -> Reply {
    if (upgrading) return Upgrade{std::move(session)};
    return upgradeRequired();
  };
  return inSession(request, directory, enter, upgrading);
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

}  // namespace

Answer sessionsAnswer(const directory::Directory& directory) {
  Json sessions = Json::array();
  for (const auto& session : directory.all()) {
    const session::Presence::State state = session->presence().state();
    const wire::Clock& clock = state.clock;
    Json parameters = Json::object();
    for (const auto& [name, value] : session->spec().parameters) parameters[name] = value;
    sessions.push_back({{"name", session->name()},
                        {"terrain", session->spec().terrain},
                        {"seed", session->spec().seed},
                        {"parameters", parameters},
                        {"content_hash", text::hexadecimal(session->contentHash())},
                        {"step_bits", lattice::kStepBits},
                        {"members", session->members()},
                        {"sensors", std::ranges::count(state.members, wire::Role::kSensor, &wire::Member::role)},
                        {"max_members", directory.resources().limits.maxMembers},
                        {"clock",
                         {{"mode", nameOf(clock.mode)},
                          {"rate", clock.rate},
                          {"seconds", static_cast<double>(clock.time) / 1e6},
                          {"step", clock.step},
                          {"waits_for", clock.waitsFor.size()},
                          {"owner", clock.owner ? Json{{"camera", clock.owner}, {"name", state.ownerName}} : Json()}}}});
    if (const terrain::Raster* map = session->terrain()->raster(); map && directory.resources().limits.sendsTerrain)
      sessions.back()["height_map"] = heightMap(*map);
  }
  const Json all{{"sessions", sessions}, {"max_sessions", directory.resources().limits.maxSessions}};
  return json(all.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
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
