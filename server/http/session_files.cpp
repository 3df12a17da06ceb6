#include "server/http/session_files.h"

#include <optional>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/access/crypto.h"
#include "server/http/any_origin.h"

namespace ridgecast::http {

namespace {

using snapshot::Problem;
using snapshot::Snapshots;

constexpr std::string_view kFilesPrefix = "/v1/sessions/";

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
  return format == snapshot::Format::kGlb    ? "model/gltf-binary"
         : format == snapshot::Format::kObj  ? "model/obj"
         : format == snapshot::Format::kTiff ? "image/tiff; application=geotiff; profile=cloud-optimized"
                                             : "application/octet-stream";
}

Answer with(Answer a, const Headers& headers) {
  a.headers.insert(a.headers.end(), headers.begin(), headers.end());
  return a;
}

}  // namespace

Reply fileOf(const Maker& maker, std::shared_ptr<session::Session> session, editing::Ground ground, snapshot::Question question,
             bool metadataOnly, const Headers& headers) {
  const std::string etag = Snapshots::etag(*session, ground, question, metadataOnly);
  if (auto known = maker.cache->find(etag)) return with(std::move(*known), headers);
  const auto progress = std::make_shared<snapshot::Progress>();
  DeferredResponse later{.queue = std::holds_alternative<snapshot::OfTile>(question.of) ? Queue::kTiles : Queue::kPatient,
                         .progress = [progress] { return progress->text(); },
                         .unchanged = with(opened({.etag = etag}), headers)};
  later.work = [maker, progress, session = std::move(session), ground = std::move(ground), question = std::move(question), metadataOnly,
                etag, headers](const Turn& turn) {
    if (auto known = maker.cache->find(etag)) return with(std::move(*known), headers);  // made meanwhile
    auto made = maker.snapshots->take(*session, ground, question, metadataOnly, turn.stop, progress.get());
    if (!made) return answerOf(made.error());
    Answer done;
    done.type = metadataOnly ? "application/json" : typeOf(question.format);
    done.body = metadataOnly ? std::move(made->metadata) : std::move(made->file);
    done.etag = etag.empty() ? access::hex(access::sha256(done.body)) : etag;
    if (!metadataOnly) done.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + made->name + "\"");
    done = opened(std::move(done));
    if (!etag.empty()) maker.cache->keep(done);
    return with(std::move(done), headers);
  };
  return later;
}

Route sessionFileRoute(
    std::shared_ptr<directory::Directory> directory, bool (*isThere)(std::string_view file),
    std::function<Reply(const Request& request, std::shared_ptr<session::Session> session, std::string_view file)> answer) {
  expects(directory && isThere && answer, "a route has sessions, files and answers");
  return [directory = std::move(directory), isThere, answer = std::move(answer)](const Request& request) -> std::optional<Reply> {
    std::string_view path = request.path();
    if (!path.starts_with(kFilesPrefix)) return std::nullopt;
    path.remove_prefix(kFilesPrefix.size());
    const auto slash = path.find('/');
    if (slash == std::string_view::npos) return std::nullopt;
    const std::string_view name = path.substr(0, slash), file = path.substr(slash + 1);
    if (!isThere(file)) return std::nullopt;

    if (request.method == "OPTIONS") return preflight();
    if (!request.reads()) return openWrongMethod();
    if (!wire::sessionNameIsValid(std::string(name)))
      return openRefusal(
          400, "A session's name has 1 to " + std::to_string(wire::kMaxSessionBytes) + " letters, digits, dots, underscores or hyphens.");
    auto session = directory->find(name);
    if (!session) return opened(noSession(name, *directory));
    session->use();
    const auto own = std::make_shared<const OwnRequest>(request);
    return onceHas(
        request.edit, session, [=, file = std::string(file)] { return answer(own->request(), session, file); }, opened);
  };
}

}  // namespace ridgecast::http
