#include "server/http/snapshots.h"

#include <utility>

#include "server/http/any_origin.h"

namespace ridgecast::http {

namespace {

constexpr std::string_view kMetadata = "snapshot.json";

bool isThere(std::string_view file) {
  return file == kMetadata || (file.starts_with("snapshot.") && file.rfind('.') == 8 && snapshot::formatOf(file));
}

}  // namespace

Route snapshotRoute(std::shared_ptr<session::Directory> directory, Maker maker) {
  return sessionFileRoute(
      std::move(directory), isThere,
      [maker = std::move(maker)](const Request& request, std::shared_ptr<session::Session> session, std::string_view file) {
        auto ground = session->ground();
        auto question = snapshot::parse(request.query(), maker.snapshots->limits(), ground.terrain->raster(),
                                        snapshot::formatOf(file).value_or(snapshot::Format::kGlb));
        if (!question) return openRefusal(400, question.error().message);
        return fileOf(maker, std::move(session), std::move(ground), std::move(*question), file == kMetadata);
      });
}

}  // namespace ridgecast::http
