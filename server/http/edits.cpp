#include "server/http/edits.h"

#include <chrono>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "common/edits/json.h"
#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/http/query_body.h"

namespace ridgecast::http {

namespace {

using Clock = std::chrono::steady_clock;

// What the editing task has to say, once it has.
struct Said {
  std::mutex mutex;
  std::optional<Answer> answer;
  void set(Answer a) {
    const std::lock_guard lock(mutex);
    answer = std::move(a);
  }
};

// Looks every 2 ms, so that no thread waits.
Answer whenSaid(std::shared_ptr<Said> said) {
  return madeBy({.work = [said = std::move(said)](const std::stop_token&) {
    const std::lock_guard lock(said->mutex);
    if (said->answer) return *said->answer;
    Answer later;
    later.again = Clock::now() + std::chrono::milliseconds(2);
    return later;
  }});
}

Answer invalid(const Error& e) { return refused(422, metrics::Refusal::kRequest, e.message); }

Answer make(const std::shared_ptr<session::Session>& session, edits::Operation operation, std::string key, const std::string& client) {
  auto said = std::make_shared<Said>();
  const auto say = [said](const Outcome<std::uint64_t>& number) {
    if (!number) return said->set(invalid(number.error()));
    Answer made = json("{\"number\": " + std::to_string(*number) + "}\n");
    made.status = 201;
    said->set(std::move(made));
  };
  if (auto early = session->edit({std::move(key), client, std::move(operation)}, session->budgetsOf(client), say); !early)
    return refused(429, metrics::Refusal::kBusy, early.error().message, {{"Retry-After", "1"}});
  return whenSaid(std::move(said));
}

Answer list(const Request& request, const std::shared_ptr<session::Session>& session) {
  std::uint64_t since = 0, limit = kUsuallyListed;
  for (const auto& [name, value] : {std::pair("since", &since), std::pair("limit", &limit)}) {
    const auto given = queryParameter(request.query(), name);
    if (!given) return refused(400, metrics::Refusal::kRequest, given.error().message);
    if (given->empty()) continue;
    const auto number = text::number<std::uint64_t>(*given);
    if (!number) return refused(400, metrics::Refusal::kRequest, std::string(name) + " is a whole number, such as " + name + "=17.");
    *value = *number;
  }
  if (limit > kMostListed) return refused(400, metrics::Refusal::kRequest, "limit is at most " + std::to_string(kMostListed) + ".");
  auto said = std::make_shared<Said>();
  const std::uint64_t last = session->ground().edit;
  session->edits().read(since, limit, [said, last](const Outcome<std::vector<session::MadeEdit>>& made) {
    if (!made) return said->set(refused(500, metrics::Refusal::kInternal, made.error().message));
    std::string out = "{\"last\": " + std::to_string(last) + ", \"edits\": [";
    for (std::size_t k = 0; k < made->size(); ++k) {
      const session::MadeEdit& m = (*made)[k];
      out += std::string(k > 0 ? ",\n" : "\n") + "{\"number\": " + std::to_string(m.number) +
             ", \"author\": " + nlohmann::json(m.edit.author).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) +
             ", \"edit\": " + edits::toJson(m.edit.operation) + "}";
    }
    said->set(json(out + "\n]}\n"));
  });
  return whenSaid(std::move(said));
}

Answer post(const Request& request, std::shared_ptr<session::Session> session) {
  if (bodyTypeOf(request.contentType) != BodyType::kJson)
    return refused(415, metrics::Refusal::kRequest, "An edit's Content-Type is application/json.", {{"Accept", "application/json"}});
  if (request.idempotencyKey.size() > wire::kMaxEditKeyBytes)
    return refused(400, metrics::Refusal::kRequest, "An Idempotency-Key has at most " + std::to_string(wire::kMaxEditKeyBytes) + " bytes.");
  return madeOfBody({kMostEditBytes, "An edit has at most " + std::to_string(kMostEditBytes) + " bytes.",
                     [session = std::move(session), key = std::string(request.idempotencyKey),
                      client = std::string(request.client)](const std::string& body) {
                       auto operation = edits::fromJson(body);
                       return operation ? make(session, std::move(*operation), key, client) : invalid(operation.error());
                     }});
}

std::optional<Answer> respond(const Request& request, const session::Directory& directory) {
  std::string_view path = request.path();
  constexpr std::string_view kPrefix = "/v1/sessions/", kEdits = "edits";
  if (!path.starts_with(kPrefix)) return std::nullopt;
  path.remove_prefix(kPrefix.size());
  const std::string_view name = text::takePart(path, '/'), rest = path;
  if (rest != kEdits && !rest.starts_with("edits/")) return std::nullopt;
  const bool isOne = rest != kEdits;
  if (isOne ? request.method != "DELETE" : !request.reads() && request.method != "POST")
    return wrongMethod(isOne ? "DELETE" : "GET, HEAD, POST");
  auto session = directory.find(name);
  if (!session) return refused(404, metrics::Refusal::kSession, "There is no session of that name here; /v1/sessions lists the sessions.");
  session->use();
  if (request.reads()) return list(request, session);
  if (!isOne) return post(request, std::move(session));
  const auto number = text::number<std::uint64_t>(rest.substr(kEdits.size() + 1));
  if (!number) return refused(400, metrics::Refusal::kRequest, "The path names the number of an edit, such as edits/17.");
  edits::Operation undo{edits::Undo{*number}, 0};
  if (auto checked = edits::check(undo); !checked) return invalid(checked.error());
  return make(session, std::move(undo), {}, std::string(request.client));
}

}  // namespace

Route editsRoute(std::shared_ptr<session::Directory> directory) {
  return [directory = std::move(directory)](const Request& request) { return respond(request, *directory); };
}

}  // namespace ridgecast::http
