#include "server/http/worlds.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "common/wire/wire.h"

namespace ridgecast::http {

namespace {

using session::WorldSpec;

Answer upgrade(std::shared_ptr<session::Session> session) {
  Answer a;
  a.status = 101;
  a.upgradeTo = std::move(session);
  return a;
}

// The URL's world. It may omit the terrain only for an existing session.
struct Wish {
  std::string terrain;
  std::optional<std::uint32_t> seed;
  std::vector<std::pair<std::string, double>> parameters;

  bool isMetBy(const WorldSpec& spec) const {
    if (!terrain.empty() && terrain != spec.terrain) return false;
    if (seed && *seed != spec.seed) return false;
    return parameters.empty() || parameters == spec.parameters;
  }
};

bool nameIsHarmless(std::string_view name) {
  return !name.empty() && name.size() <= wire::kMaxNameBytes && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

template <class Number>
bool parse(std::string_view text, Number& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

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
  if (!seed->empty() && !parse(*seed, wish.seed.emplace())) return Error{"A seed is a whole number from 0 to 4294967295."};
  const auto assignments = queryParameters(query, "param");
  if (!assignments) return assignments.error();
  for (const std::string& assignment : *assignments) {
    const auto equals = assignment.find('=');
    double value = 0;
    const std::string name = assignment.substr(0, equals);
    if (equals == std::string::npos || !nameIsHarmless(name) || !parse(std::string_view(assignment).substr(equals + 1), value) ||
        !std::isfinite(value))
      return Error{"A parameter is given as param=NAME=NUMBER."};
    if (wish.parameters.size() >= kMaxParameters) return Error{"A world has at most " + std::to_string(kMaxParameters) + " parameters."};
    wish.parameters.emplace_back(name, value);
  }
  std::sort(wish.parameters.begin(), wish.parameters.end());
  const auto twice =
      std::adjacent_find(wish.parameters.begin(), wish.parameters.end(), [](const auto& a, const auto& b) { return a.first == b.first; });
  if (twice != wish.parameters.end()) return Error{"The parameter '" + twice->first + "' is given twice; give it once."};
  return wish;
}

std::string describe(const WorldSpec& spec) {
  std::string out = "terrain " + spec.terrain + ", seed " + std::to_string(spec.seed);
  for (const auto& [name, value] : spec.parameters) {
    char text[40];
    std::snprintf(text, sizeof text, "=%.9g", value);
    out += ", " + name + text;
  }
  return out;
}

// Joins, if the session has the requested world.
Answer join(std::shared_ptr<session::Session> session, const Wish& wish) {
  if (wish.isMetBy(session->spec())) return upgrade(std::move(session));
  return refused(409, metrics::Refusal::kSession,
                 "Session '" + session->name() + "' is another world (" + describe(session->spec()) +
                     ") and does not change while it lives; leave the terrain out to join it, or choose another name.");
}

Answer make(const std::string& name, const Wish& wish, session::Directory& directory) {
  const WorldSpec spec{wish.terrain, wish.seed.value_or(1), wish.parameters};
  auto terrain = directory.resources().makeTerrain(spec);
  if (!terrain) return refused(400, metrics::Refusal::kSession, "Session '" + name + "' cannot be created: " + terrain.error().message);
  const auto added = directory.add(name, std::move(*terrain), spec.parameters);
  if (added) return upgrade(*added);
  // Another request may have been faster.
  if (auto session = directory.find(name)) return join(std::move(session), wish);
  return refused(503, metrics::Refusal::kFull, added.error().message);
}

void appendText(std::string& out, std::string_view text) {
  out += '"';
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) >= 0x7f) {
      // A client's bytes need not be UTF-8: each becomes the character with that number.
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(static_cast<unsigned char>(c)));
      out += escape;
    } else {
      out += c;
    }
  }
  out += '"';
}

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

}  // namespace

Answer streamAnswer(const Request& request, session::Directory& directory) {
  const auto name = queryParameter(request.query(), "session");
  if (!name) return refused(400, metrics::Refusal::kSession, name.error().message);
  const std::string wanted = name->empty() ? std::string(session::kDefaultName) : *name;
  if (!wire::sessionNameIsValid(wanted))
    return refused(
        400, metrics::Refusal::kSession,
        "A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens.");
  const auto wish = readWish(request.query());
  if (!wish) return refused(400, metrics::Refusal::kSession, wish.error().message);
  if (!request.upgrade || request.webSocketVersion != "13") {
    Answer a = plain(426, "This is a WebSocket endpoint (version 13): connect with ws://, for example with ridgecast-client.");
    a.headers = {{"Upgrade", "websocket"}, {"Connection", "Upgrade"}, {"Sec-WebSocket-Version", "13"}};
    return a;
  }
  if (auto session = directory.find(wanted)) return join(std::move(session), *wish);
  if (wish->terrain.empty())
    return refused(404, metrics::Refusal::kSession,
                   "There is no session named '" + wanted + "' here; 'default' always exists, and &terrain=NAME creates one.");
  if (!request.rights.has(access::Right::kCreate))
    return refused(403, metrics::Refusal::kRight, "There is no session named '" + wanted + "', and the token lacks the right 'create'.");
  if (!directory.resources().makeTerrain)
    return refused(403, metrics::Refusal::kSession, "Sessions cannot be created on this server; 'default' always exists.");
  if (directory.full())
    return refused(
        503, metrics::Refusal::kFull,
        "This server has " + std::to_string(directory.resources().limits.maxSessions) + " sessions, its limit; try again later.");
  const auto builtIn = terrain::builtIn();
  const bool atOnce =
      wish->parameters.empty() && std::any_of(builtIn.begin(), builtIn.end(), [&](const auto& d) { return d.name == wish->terrain; });
  if (atOnce) return make(wanted, *wish, directory);
  auto later = std::make_shared<Later>();
  later->makesWorld = true;
  later->progress = [] { return "preparing the terrain"; };
  later->work = [wanted, wish = *wish, &directory](std::stop_token) { return make(wanted, wish, directory); };
  Answer a;
  a.later = std::move(later);
  return a;
}

Answer sessionsAnswer(const session::Directory& directory) {
  Answer a;
  a.type = "application/json";
  std::string& out = a.body;
  out = "{\"sessions\": [";
  bool first = true;
  for (const auto& session : directory.all()) {
    const auto seen = session->presence().look();
    std::size_t sensors = 0;
    for (const wire::Member& m : seen.members) sensors += m.role == wire::Role::kSensor;
    char hash[24];
    std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(session->contentHash()));
    out += first ? "\n  {\"name\": " : ",\n  {\"name\": ";
    first = false;
    appendText(out, session->name());
    out += ", \"terrain\": ";
    appendText(out, session->spec().terrain);
    out += ", \"seed\": " + std::to_string(session->spec().seed) + ", \"parameters\": {";
    for (std::size_t k = 0; k < session->spec().parameters.size(); ++k) {
      if (k > 0) out += ", ";
      appendText(out, session->spec().parameters[k].first);
      out += ": " + number(session->spec().parameters[k].second);
    }
    out += std::string("}, \"content_hash\": \"") + hash + "\", \"step_bits\": " + std::to_string(lattice::kStepBits) +
           ", \"members\": " + std::to_string(session->members()) + ", \"sensors\": " + std::to_string(sensors) +
           ", \"max_members\": " + std::to_string(directory.resources().limits.maxMembers);
    static constexpr const char* kModes[] = {"real-time", "scaled", "stepped"};
    out += std::string(", \"clock\": {\"mode\": \"") + kModes[static_cast<int>(seen.clock.mode)] +
           "\", \"rate\": " + number(seen.clock.rate) + ", \"seconds\": " + number(static_cast<double>(seen.clock.time) / 1e6) +
           ", \"step\": " + std::to_string(seen.clock.step) + ", \"waits_for\": " + std::to_string(seen.clock.waitsFor.size()) +
           ", \"owner\": ";
    if (seen.clock.owner == 0) {
      out += "null";
    } else {
      out += "{\"camera\": " + std::to_string(seen.clock.owner) + ", \"name\": ";
      appendText(out, seen.ownerName);
      out += "}";
    }
    out += "}}";
  }
  out += "\n], \"max_sessions\": " + std::to_string(directory.resources().limits.maxSessions) + "}\n";
  return a;
}

}  // namespace ridgecast::http
