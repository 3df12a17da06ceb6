#include "server/http/edits.h"

#include <array>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/edits/author.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/earth/earth.h"
#include "server/http/query_body.h"
#include "server/http/worlds.h"

namespace ridgecast::http {

namespace {

// What a task has to say, once it has. The answer is made of it by the work's own thread.
class Said {
 public:
  explicit Said(std::function<void()> wake) : wake_(std::move(wake)) {}
  void set(std::function<Answer()> answer) {
    {
      const std::lock_guard lock(mutex_);
      expects(answer && !std::exchange(isSaid_, true), "a task says one thing");
      answer_ = std::move(answer);
    }
    wake_();
  }
  std::function<Answer()> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(answer_, nullptr);
  }

 private:
  const std::function<void()> wake_;
  std::mutex mutex_;
  std::function<Answer()> answer_;
  bool isSaid_ = false;
};

// Asks when the answer has its place, so that whoever is told that there is none has asked for nothing. No thread waits.
Reply whenSaid(std::function<void(const std::shared_ptr<Said>& said)> ask) {
  return DeferredResponse{.work = [said = std::shared_ptr<Said>(), ask = std::move(ask)](const Turn& turn) mutable -> Reply {
    if (const auto first = std::exchange(ask, nullptr)) first(said = std::make_shared<Said>(turn.wake));
    if (const auto answer = said->take()) return answer();
    return RetryAt{RetryAt::kWhenWoken};
  }};
}

Answer invalid(const Error& e) { return refused(422, metrics::Refusal::kRequest, e.message); }

Answer answerOf(const editing::Edits::Answer& number) {
  if (number) {
    Answer made = json("{\"number\": " + std::to_string(*number) + "}\n");
    made.status = 201;
    return made;
  }
  const std::string& sentence = number.error().message;
  switch (number.why) {
    case editing::Edits::Answer::Why::kEarly:
      return refused(429, metrics::Refusal::kBusy, sentence, {{"Retry-After", "1"}});
    case editing::Edits::Answer::Why::kFull:
      return refused(507, metrics::Refusal::kLimit, sentence);
    case editing::Edits::Answer::Why::kOver:
      return refused(404, metrics::Refusal::kSession, sentence);
    case editing::Edits::Answer::Why::kWrong:
      break;
  }
  return invalid(number.error());
}

Reply make(std::shared_ptr<session::Session> session, edits::Operation operation, std::string key, const std::string& client) {
  auto edit = std::make_shared<editing::Edit>(editing::Edit{std::move(key), edits::toText({client, {}}), std::move(operation)});
  return whenSaid([session = std::move(session), edit = std::move(edit), client](const std::shared_ptr<Said>& said) {
    session->edit(std::move(*edit), session->budgetsOf(client),
                  [said](const editing::Edits::Answer& number) { said->set([number] { return answerOf(number); }); });
  });
}

std::string quoted(const std::string& text) { return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace); }

// As many as fit, at least one.
Answer listed(std::uint64_t last, const std::vector<editing::Applied>& edits, std::size_t limit) {
  std::string out = "{\"last\": " + std::to_string(last) + ", \"edits\": [";
  for (const editing::Applied& made : edits) {
    const auto operation = edits::unpack(made.operation);
    if (!operation) return refused(500, metrics::Refusal::kInternal, operation.error().message);
    const std::string text = edits::toJson(*operation);
    if (limit-- == 0 || (out.back() == '}' && out.size() + text.size() > kMaxListedBytes)) break;
    const edits::Author author = edits::authorOf(made.author);
    out += std::string(out.back() == '}' ? ",\n" : "\n") + "{\"number\": " + std::to_string(made.number) +
           ", \"author\": " + quoted(author.client) + ", \"name\": " + quoted(author.name) + ", \"edit\": " + text + "}";
  }
  return json(out + "\n]}\n");
}

Reply list(const Request& request, const std::shared_ptr<session::Session>& session) {
  std::uint64_t since = 0, limit = kUsuallyListed;
  for (const auto& [name, value] : {std::pair("since", &since), std::pair("limit", &limit)}) {
    const auto given = queryParameter(request.query(), name);
    if (!given) return refused(400, metrics::Refusal::kRequest, given.error().message);
    if (given->empty()) continue;
    const auto number = text::number<std::uint64_t>(*given);
    if (!number) return refused(400, metrics::Refusal::kRequest, std::string(name) + " is a whole number, such as " + name + "=17.");
    *value = *number;
  }
  if (limit > kMaxListed) return refused(400, metrics::Refusal::kRequest, "limit is at most " + std::to_string(kMaxListed) + ".");
  return whenSaid([since, limit, session](const std::shared_ptr<Said>& said) {
    const std::uint64_t last = session->ground().edit;
    session->edits().read(since, kMaxListedBytes, [said, last, limit](Outcome<std::vector<editing::Applied>> edits) {
      said->set([edits = std::move(edits), last, limit] {
        return edits ? listed(last, *edits, limit) : refused(500, metrics::Refusal::kInternal, edits.error().message);
      });
    });
  });
}

Reply backUp(const std::shared_ptr<session::Session>& session) {
  auto reply = whenSaid([session](const std::shared_ptr<Said>& said) {
    session->edits().copy(kMaxBackupBytes, [said, name = session->name()](Outcome<std::string> file) {
      said->set([file = std::make_shared<Outcome<std::string>>(std::move(file)), name] {
        if (!*file) return refused(409, metrics::Refusal::kSession, file->error().message);
        Answer a;
        a.type = "application/vnd.sqlite3";
        a.headers = {{"Content-Disposition", "attachment; filename=\"" + name + ".edits\""}};
        a.body = std::move(**file);
        return a;
      });
    });
  });
  std::get<DeferredResponse>(reply).queue = Queue::kPatient;
  return reply;
}

// While the session lives.
edits::ToWorld placedIn(const session::Session& session) {
  return [&session, coordinates = std::optional<earth::Coordinates>()](const std::string& crs, double first,
                                                                       double second) mutable -> Outcome<std::array<double, 2>> {
    if (!coordinates) {
      auto made = coordinatesOf(session, crs);
      if (!made) return made.error();
      coordinates = std::move(*made);
    }
    const auto world = coordinates->world(first, second);
    if (!world) return Error{"The CRS of the map does not reach one of the edit's places."};
    return *world;
  };
}

Reply post(const Request& request, std::shared_ptr<session::Session> session) {
  if (bodyTypeOf(request.contentType) != BodyType::kJson)
    return refused(415, metrics::Refusal::kRequest, "An edit's Content-Type is application/json.", {{"Accept", "application/json"}});
  if (request.idempotencyKey.size() > wire::kMaxEditKeyBytes)
    return refused(400, metrics::Refusal::kRequest, "An Idempotency-Key has at most " + std::to_string(wire::kMaxEditKeyBytes) + " bytes.");
  return BodyHandler{kMaxEditBytes, "An edit has at most " + std::to_string(kMaxEditBytes) + " bytes.",
                     [session = std::move(session), key = std::string(request.idempotencyKey),
                      client = std::string(request.client)](const std::string& body) -> Reply {
                       auto operation = edits::fromJson(body, placedIn(*session));
                       if (!operation) return invalid(operation.error());
                       return make(session, std::move(*operation), key, client);
                     }};
}

// `which`: the number in the path, if that names an edit.
Reply respond(const Request& request, std::shared_ptr<session::Session> session, const std::optional<std::string>& which) {
  if (request.reads()) return list(request, session);
  if (!which) return post(request, std::move(session));
  const auto number = text::number<std::uint64_t>(*which);
  if (!number) return refused(400, metrics::Refusal::kRequest, "The path names the number of an edit, such as edits/17.");
  edits::Operation undo{edits::Undo{*number}, 0};
  if (auto checked = edits::check(undo); !checked) return invalid(checked.error());
  return make(session, std::move(undo), {}, std::string(request.client));
}

std::optional<Reply> respond(const Request& request, const directory::Directory& directory) {
  std::string_view path = request.path();
  constexpr std::string_view kPrefix = "/v1/sessions/", kEdits = "edits";
  if (!path.starts_with(kPrefix)) return std::nullopt;
  path.remove_prefix(kPrefix.size());
  const std::string_view name = text::takePart(path, '/'), rest = path;
  const bool isBackup = rest == "backup";
  if (!isBackup && rest != kEdits && !rest.starts_with("edits/")) return std::nullopt;
  if (isBackup && request.method != "GET") return wrongMethod("GET");
  const bool isOne = rest != kEdits;
  if (isBackup) {
    const auto of = directory.find(name);
    return of ? backUp(of) : noSession(name, directory);
  }
  if (isOne ? request.method != "DELETE" : !request.reads() && request.method != "POST")
    return wrongMethod(isOne ? "DELETE" : "GET, HEAD, POST");
  const auto session = directory.find(name);
  if (!session) return noSession(name, directory);
  session->use();
  const auto own = std::make_shared<const OwnRequest>(request);
  std::optional<std::string> which;
  if (isOne) which = rest.substr(kEdits.size() + 1);
  return onceHas(request.edit, session, [own, session, which = std::move(which)] { return respond(own->request(), session, which); });
}

}  // namespace

Route editsRoute(std::shared_ptr<directory::Directory> directory) {
  return [directory = std::move(directory)](const Request& request) { return respond(request, *directory); };
}

}  // namespace ridgecast::http
