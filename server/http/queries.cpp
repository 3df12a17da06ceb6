#include "server/http/queries.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <span>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/terrain/materials.h"
#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/earth/earth.h"
#include "server/http/query_body.h"
#include "server/http/worlds.h"
#include "server/query/query.h"

namespace ridgecast::http {

namespace {

using Clock = std::chrono::steady_clock;
using wire::QueryKind;

constexpr std::chrono::milliseconds kTurn{2};
constexpr std::size_t kAtATime = 256;  // entries of an answer between two looks at the clock

std::string number(double value) { return text::rounded(value, 17); }
std::string number(float value) { return text::rounded(static_cast<double>(value), 9); }

// One question on its way to its answer, a turn at a time. One thread at a time.
class QueryTask {
 public:
  QueryTask(const QueryForm& form, std::shared_ptr<session::Session> session, const std::string& client)
      : form_(form), session_(std::move(session)), budgets_(session_->budgetsOf(client)) {
    session_->use();
  }

  void ask(wire::Query query) {
    editing::Ground ground = session_->ground();
    answering_.emplace(std::move(ground.terrain), std::move(query), ground.edit);
  }
  void ask(std::string body, BodyType type, std::optional<double> option, const std::string& crs) {
    body_.emplace(form_, type, std::move(body), option, toWorldOf(crs));
    type_ = type;
  }
  void ask(std::vector<double> numbers, std::optional<double> option, const std::string& crs) {
    body_.emplace(form_, std::move(numbers), option, toWorldOf(crs));
  }

  Reply turn(const std::stop_token& stop) {
    expects(body_ || answering_, "a query's turn comes when it was asked, and not after its answer");
    if (wrong_) return refused(400, metrics::Refusal::kRequest, wrong_->message);
    for (const auto until = Clock::now() + kTurn; Clock::now() < until && !stop.stop_requested();) {
      if (!answering_) {
        auto query = body_->read();
        if (!query) continue;
        if (wrong_ || !*query) return refused(400, metrics::Refusal::kRequest, (wrong_ ? *wrong_ : query->error()).message);
        body_.reset();
        ask(std::move(**query));
      } else if (!answering_->isDone()) {
        const auto now = session_->resources().timer->now(), free = budgets_->queries.free();
        if (free > now) return RetryAt{free};
        budgets_->queries.spend(now, answering_->work());
      } else {
        if (written_ == 0) made_ = answering_->take();
        if (write()) return whole();
      }
    }
    return RetryAt{Clock::now()};
  }

 private:
  // Begins with the work: PROJ takes its time.
  ToWorld toWorldOf(const std::string& crs) {
    if (crs.empty()) return {};
    return [this, crs](std::span<double> one) {
      if (!coordinates_) {
        auto made = coordinatesOf(*session_, crs);
        if (!made) return wrong_ = made.error(), false;
        coordinates_ = std::move(*made);
      }
      const auto world = coordinates_->world(one[0], one[1]);
      if (!world) return false;
      if (one.size() == 2) return std::ranges::copy(*world, one.begin()), true;
      const auto north = coordinates_->north(one[0], one[1]);
      if (!north) return false;
      const auto [x, z] = *north;
      const double ray[] = {(*world)[0], one[2], (*world)[1], one[4] * x - one[3] * z, one[5], one[4] * z + one[3] * x};
      return std::ranges::copy(ray, one.begin()), true;
    };
  }

  std::size_t size() const { return form_.kind == QueryKind::kRays ? made_.distances.size() : answering_->query().x.size(); }

  // The next entries; true: those were the last.
  bool write() {
    if (type_ == BodyType::kDoubles) {
      const auto raw = [&](const auto& list) { text_.append(reinterpret_cast<const char*>(list.data()), list.size() * sizeof(list[0])); };
      form_.kind == QueryKind::kHeights     ? raw(made_.heights)
      : form_.kind == QueryKind::kNormals   ? raw(made_.normals)
      : form_.kind == QueryKind::kMaterials ? raw(made_.materials)
                                            : raw(made_.distances);
      return true;
    }
    if (written_ == 0) text_ = "{\"" + std::string(form_.path.substr(std::string_view("/v1/").size())) + "\": [";
    for (const std::size_t end = std::min(size(), written_ + kAtATime); written_ < end; ++written_)
      text_ += (written_ > 0 ? ", " : "") + entry(written_);
    return written_ == size();
  }

  std::string entry(std::size_t k) const {
    if (form_.kind == QueryKind::kHeights) return number(made_.heights[k]);
    if (form_.kind == QueryKind::kNormals) {
      const auto n = std::span(made_.normals).subspan(3 * k, 3);
      return "[" + number(n[0]) + ", " + number(n[1]) + ", " + number(n[2]) + "]";
    }
    if (form_.kind == QueryKind::kMaterials) {
      const std::string_view name = terrain::materialName(made_.materials[k], answering_->terrain().ownMaterials());
      return name.empty() ? "null" : '"' + std::string(name) + '"';
    }
    if (made_.distances[k] < 0) return "null";
    const wire::Ray& ray = answering_->query().rays[k];
    const double t = made_.distances[k] / std::hypot(ray.directionX, ray.directionY, ray.directionZ);
    std::array at{lattice::metres(ray.x) + t * ray.directionX, ray.y + t * ray.directionY, lattice::metres(ray.z) + t * ray.directionZ};
    if (coordinates_) {
      const auto theirs = coordinates_->fromWorld(at[0], at[2]);
      if (!theirs) return "{\"distance\": " + number(made_.distances[k]) + ", \"at\": null}";
      at = {(*theirs)[0], (*theirs)[1], at[1]};
    }
    return "{\"distance\": " + number(made_.distances[k]) + ", \"at\": [" + number(at[0]) + ", " + number(at[1]) + ", " + number(at[2]) +
           "]}";
  }

  Answer whole() {
    Answer a;
    if (type_ == BodyType::kJson) {
      a = json(std::move(text_) + "]}\n");
    } else {
      a.type = "application/octet-stream";
      a.body = std::move(text_);
    }
    a.headers.emplace_back(kEditHeader, std::to_string(made_.edit));
    if (form_.kind == QueryKind::kRays)
      a.headers.emplace_back("Ridgecast-Known",
                             std::string(terrain::kKnownNames[static_cast<std::size_t>(answering_->terrain().relief().known)]));
    return a;
  }

  const QueryForm& form_;
  const std::shared_ptr<session::Session> session_;
  const std::shared_ptr<session::Budgets> budgets_;
  std::optional<BodyReader> body_;
  std::optional<earth::Coordinates> coordinates_;
  std::optional<Error> wrong_;  // with them
  BodyType type_ = BodyType::kJson;
  std::optional<query::Answering> answering_;
  wire::Answer made_;
  std::string text_;
  std::size_t written_ = 0;
};

Reply inTurns(std::shared_ptr<QueryTask> task) {
  return DeferredResponse{.work = [task = std::move(task)](const Turn& turn) { return task->turn(turn.stop); }};
}

// The body of a request, to be read in its session.
Outcome<Enter> posted(const QueryForm& form, BodyType type, std::string_view query, const std::string& client) {
  const auto option = optionOf(form, query);
  if (!option) return option.error();
  const auto crs = queryParameter(query, "crs");
  if (!crs) return crs.error();
  const std::size_t most = mostBytes(form, type);
  std::string tooLong = "The body has more than " + std::to_string(most) + " bytes; ask for at most " + std::to_string(kMaxPosted) +
                        (form.kind == QueryKind::kRays ? " rays" : " places") + " at a time.";
  return Enter([=, &form, option = *option, crs = *crs](std::shared_ptr<session::Session> session) {
    auto task = std::make_shared<QueryTask>(form, std::move(session), client);
    return BodyHandler{most, tooLong, [=](std::string body) {
                         task->ask(std::move(body), type, option, crs);
                         return inTurns(task);
                       }};
  });
}

Outcome<Enter> inUrl(const QueryForm& form, std::string_view query, const std::string& client) {
  auto numbers = numbersOfUrl(form, query);
  if (!numbers) return numbers.error();
  const auto option = optionOf(form, query);
  if (!option) return option.error();
  const auto crs = queryParameter(query, "crs");
  if (!crs) return crs.error();
  auto asked = queryOf(form, crs->empty() ? std::span<const double>(*numbers) : std::span<const double>(), *option);
  if (!asked) return asked.error();
  return Enter([&form, client, asked = std::move(*asked), numbers = std::move(*numbers), option = *option,
                crs = *crs](std::shared_ptr<session::Session> session) {
    auto task = std::make_shared<QueryTask>(form, std::move(session), client);
    crs.empty() ? task->ask(asked) : task->ask(numbers, option, crs);
    return inTurns(std::move(task));
  });
}

std::optional<Reply> answerQuery(const Request& request, directory::Directory& directory) {
  const QueryForm* form = queryFormOf(request.path());
  if (!form) return std::nullopt;
  const bool posts = request.method == "POST";
  if (!request.reads() && !posts) return wrongMethod("GET, HEAD, POST");
  const auto type = posts ? bodyTypeOf(request.contentType) : std::nullopt;
  if (posts && !type)
    return refused(415, metrics::Refusal::kRequest, "A query's Content-Type is application/json or application/octet-stream.",
                   {{"Accept", "application/json, application/octet-stream"}});
  const std::string client(request.client);
  const auto enter = posts ? posted(*form, *type, request.query(), client) : inUrl(*form, request.query(), client);
  if (!enter) return refused(400, metrics::Refusal::kRequest, enter.error().message);
  return inSession(request, directory, *enter);
}

}  // namespace

Route queryRoute(std::shared_ptr<directory::Directory> directory) {
  return [directory = std::move(directory)](const Request& request) { return answerQuery(request, *directory); };
}

}  // namespace ridgecast::http
