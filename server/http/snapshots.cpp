#include "server/http/snapshots.h"

#include <utility>

namespace ridgecast::http {

Route snapshotRoute(std::shared_ptr<session::Directory> directory, Maker maker) {
  return sessionFileRoute(
      std::move(directory), [](std::string_view file) { return file == "snapshot.glb" || file == "snapshot.json"; },
      [maker = std::move(maker)](const Request& request, std::shared_ptr<session::Session> session, std::string_view file) {
        auto question = snapshot::parse(request.query(), maker.snapshots->limits());
        if (!question) return openRefusal(400, question.error().message);
        return fileOf(maker, std::move(session), std::move(*question), file == "snapshot.json");
      });
}

}  // namespace ridgecast::http
