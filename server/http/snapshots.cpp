#include "server/http/snapshots.h"

#include <optional>
#include <string>

#include "common/wire/wire.h"
#include "server/access/crypto.h"
#include "server/http/any_origin.h"

namespace ridgecast::http {

namespace {

using snapshot::Problem;
using snapshot::Snapshots;

constexpr std::string_view kPrefix = "/v1/sessions/";

Answer answerOf(const Problem& problem) {
  switch (problem.kind) {
    case Problem::Kind::kNotThere:
      return openRefusal(404, problem.message);
    case Problem::Kind::kTooMuch:
      return openRefusal(422, problem.message);
    case Problem::Kind::kTooSlow:
      return openRefusal(503, problem.message, {{"Retry-After", "30"}});
    case Problem::Kind::kStopped:
      return openRefusal(503, problem.message);
    case Problem::Kind::kFailed:
      break;
  }
  return openRefusal(500, problem.message);
}

std::string typeOf(snapshot::Format format) {
  return format == snapshot::Format::kGlb   ? "model/gltf-binary"
         : format == snapshot::Format::kObj ? "model/obj"
                                            : "application/octet-stream";
}

Answer taken(const std::shared_ptr<Snapshots>& snapshots, std::shared_ptr<session::Session> session, snapshot::Question question,
             bool metadataOnly) {
  const std::string etag = Snapshots::etag(*session, question, metadataOnly);
  const auto progress = std::make_shared<snapshot::Progress>();
  Later later{.patient = true, .progress = [progress] { return progress->text(); }};
  later.work = [snapshots, progress, session = std::move(session), question = std::move(question), metadataOnly,
                etag](std::stop_token stop) {
    auto made = snapshots->take(*session, question, metadataOnly, stop, progress.get());
    if (!made) return answerOf(made.error());
    Answer done;
    open(done);
    done.type = metadataOnly ? "application/json" : typeOf(question.format);
    done.body = metadataOnly ? std::move(made->metadata) : std::move(made->file);
    done.etag = etag.empty() ? access::hex(access::sha256(done.body)) : etag;
    if (!metadataOnly) done.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + made->name + "\"");
    return done;
  };
  Answer a = madeBy(std::move(later));
  open(a);
  a.etag = etag;
  return a;
}

}  // namespace

Route snapshotRoute(std::shared_ptr<session::Directory> directory, std::shared_ptr<Snapshots> snapshots) {
  return [directory = std::move(directory), snapshots = std::move(snapshots)](const Request& request) -> std::optional<Answer> {
    std::string_view path = request.path();
    if (!path.starts_with(kPrefix)) return std::nullopt;
    path.remove_prefix(kPrefix.size());
    const auto slash = path.find('/');
    if (slash == std::string_view::npos) return std::nullopt;
    const std::string_view name = path.substr(0, slash), file = path.substr(slash + 1);
    const bool metadataOnly = file == "snapshot.json";
    const auto format = metadataOnly ? snapshot::Format::kGlb : snapshot::formatOf(file);
    if (!file.starts_with("snapshot.") || file.rfind('.') != 8 || !format) return std::nullopt;

    if (request.method == "OPTIONS") return preflight();
    if (!request.reads()) return openWrongMethod();
    if (!wire::sessionNameIsValid(std::string(name)))
      return openRefusal(
          400, "A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens.");
    auto session = directory->find(name);
    if (!session) return openRefusal(404, "There is no session named '" + std::string(name) + "' here; 'default' always exists.");
    session->use();
    auto question = snapshot::parse(request.query(), snapshots->limits(), session->terrain()->raster(), *format);
    if (!question) return openRefusal(400, question.error().message);

    return taken(snapshots, std::move(session), std::move(*question), metadataOnly);
  };
}

}  // namespace ridgecast::http
