#include "client/viewer/worlds.h"

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "client/link/download.h"
#include "common/wire/wire.h"

namespace ridgecast::viewer {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxAnswerBytes = 4 << 20;
constexpr std::chrono::seconds kTimeout{10};

std::string wordsOf(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_string() ? found->get<std::string>().substr(0, 200) : std::string();
}

std::uint64_t numberOf(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : 0;
}

// Performs `add` on the objects of a list.
template <class Add>
bool each(std::string_view text, const char* list, const Add& add) {
  const Json json = Json::parse(text, nullptr, false);
  if (!json.is_object() || !json.contains(list) || !json[list].is_array()) return false;
  std::size_t k = 0;
  for (const Json& object : json[list])
    if (object.is_object() && k++ < Worlds::kMax) add(object);
  return true;
}

}  // namespace

Outcome<Worlds> worldsFrom(std::string_view sessions, std::string_view terrains) {
  Worlds out;
  const bool known = each(sessions, "sessions", [&](const Json& object) {
    Worlds::Session session{wordsOf(object, "name"), wordsOf(object, "terrain"), static_cast<std::uint32_t>(numberOf(object, "seed")),
                            numberOf(object, "members")};
    if (wire::sessionNameIsValid(session.name)) out.sessions.push_back(std::move(session));
  });
  const bool offered = each(terrains, "terrains", [&](const Json& object) {
    out.terrains.push_back({wordsOf(object, "name"), wordsOf(object, "summary")});
  });
  if (!known || !offered) return Error{"the server does not list its worlds as it should; it may be another version"};
  return out;
}

WorldsQuestion::WorldsQuestion(const core::Url& url)
    : answer_(std::async(std::launch::async, [url, stop = stop_.get_token()]() -> Outcome<Worlds> {
        const auto sessions = link::fetch(url, "/v1/sessions", kMaxAnswerBytes, kTimeout, stop);
        if (!sessions) return sessions.error();
        const auto terrains = link::fetch(url, "/v1/terrains", kMaxAnswerBytes, kTimeout, stop);
        if (!terrains) return terrains.error();
        return worldsFrom(*sessions, *terrains);
      })) {}

WorldsQuestion::~WorldsQuestion() { stop_.request_stop(); }

std::optional<Outcome<Worlds>> WorldsQuestion::take() {
  if (!answer_.valid() || answer_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return std::nullopt;
  return answer_.get();
}

}  // namespace ridgecast::viewer
