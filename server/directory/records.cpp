#include "server/directory/records.h"

#include <charconv>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/text/text.h"

namespace ridgecast::directory {

namespace {

using Json = nlohmann::ordered_json;

std::string dumped(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Json jsonOf(const World& world) {
  Json parameters = Json::object();
  for (const auto& [name, value] : world.spec.parameters) parameters[name] = value;
  return {{"id", world.id},
          {"terrain", world.spec.terrain},
          {"seed", world.spec.seed},
          {"parameters", std::move(parameters)},
          {"stepped", world.spec.clock == wire::ClockMode::kStepped},
          {"content_hash", text::hexadecimal(world.contentHash)},
          {"maker", world.maker}};
}

// Throws Json::exception, as all that reads JSON here.
World readWorld(const Json& json) {
  World world;
  json.at("id").get_to(world.id);
  json.at("terrain").get_to(world.spec.terrain);
  json.at("seed").get_to(world.spec.seed);
  for (const auto& [name, value] : json.at("parameters").items()) world.spec.parameters.emplace_back(name, value.get<double>());
  world.spec.clock = json.at("stepped").get<bool>() ? wire::ClockMode::kStepped : wire::ClockMode::kRealTime;
  const auto hash = json.at("content_hash").get<std::string>();
  std::from_chars(hash.data(), hash.data() + hash.size(), world.contentHash, 16);
  json.at("maker").get_to(world.maker);
  return world;
}

template <class Read>
auto readJson(std::string_view text, const char* what, Read read) -> Outcome<decltype(read(Json()))> {
  try {
    return read(Json::parse(text));
  } catch (const Json::exception&) {
    return Error{std::string("A record of a ") + what +
                 " was not written by this program or one like it: " + std::string(text.substr(0, 80))};
  }
}

}  // namespace

std::string describe(const World& world) {
  std::string out = "terrain " + world.spec.terrain + ", seed " + std::to_string(world.spec.seed);
  for (const auto& [name, value] : world.spec.parameters) out += ", " + name + "=" + text::rounded(value, 9);
  return out + ", content hash " + text::hexadecimal(world.contentHash);
}

std::string toText(const World& world) { return dumped(jsonOf(world)); }

Outcome<World> worldOf(std::string_view text) {
  return readJson(text, "session", [](const Json& json) { return readWorld(json); });
}

std::string toText(const ServerStatus& status) {
  Json sessions = Json::object();
  for (const auto& [name, s] : status.sessions)
    sessions[name] = {
        {"world", jsonOf(s.world)}, {"epoch", s.epoch}, {"members", s.members}, {"entry", Json::parse(s.entry, nullptr, false)}};
  return dumped({{"number", status.number},
                 {"url", status.url},
                 {"cameras", status.cameras},
                 {"triangles", status.triangles},
                 {"load", status.load},
                 {"sessions", std::move(sessions)}});
}

Outcome<ServerStatus> statusOf(std::string_view text) {
  return readJson(text, "server", [](const Json& json) {
    ServerStatus status;
    json.at("number").get_to(status.number);
    json.at("url").get_to(status.url);
    json.at("cameras").get_to(status.cameras);
    json.at("triangles").get_to(status.triangles);
    json.at("load").get_to(status.load);
    for (const auto& [name, s] : json.at("sessions").items())
      status.sessions[name] = {readWorld(s.at("world")), s.at("epoch").get<std::uint64_t>(), s.at("members").get<std::uint32_t>(),
                               dumped(s.at("entry"))};
    return status;
  });
}

}  // namespace ridgecast::directory
