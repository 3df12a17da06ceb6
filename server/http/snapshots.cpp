#include "server/http/snapshots.h"

#include <utility>

#include "server/http/any_origin.h"

namespace ridgecast::http {

namespace {

constexpr std::string_view kMetadata = "snapshot.json";

bool isThere(std::string_view file) {
  const auto format = snapshot::formatOf(file);
  return file == kMetadata || (file.starts_with("snapshot.") && file.rfind('.') == 8 && format && format != snapshot::Format::kArchive);
}

}  // namespace

Route snapshotRoute(std::shared_ptr<directory::Directory> directory, Maker maker) {
  return sessionFileRoute(
      directory, isThere,
      [maker = std::move(maker), directory](const Request& request, std::shared_ptr<session::Session> session,
                                            std::string_view file) -> Reply {
        const auto crs = queryParameter(request.query(), "crs");
        auto ask = [maker, directory, session = std::move(session), query = std::string(request.query()), file = std::string(file),
                    isPlaced = crs && !crs->empty()](const Turn&) -> Reply {
          auto ground = session->ground();
          const bool isPrivate = isPlaced && !session->resources().limits.sendsTerrain;
          auto question = snapshot::parse(query, maker.snapshots->limits(), isPrivate ? nullptr : ground.terrain->raster(),
                                          snapshot::formatOf(file).value_or(snapshot::Format::kGlb));
          if (!question) return openRefusal(400, question.error().message);
          if (const auto* of = std::get_if<snapshot::OfCamera>(&question->of))
            if (const auto server = directory->serverOf(session->name(), of->id))
              return openRefusal(421, "Camera " + std::to_string(of->id) + " is on another server; ask " + server->url + ".");
          return fileOf(maker, session, std::move(ground), std::move(*question), file == kMetadata);
        };
        if (crs && !crs->empty()) return DeferredResponse{.work = std::move(ask)};  // PROJ takes its time
        return ask({});
      });
}

}  // namespace ridgecast::http
