#pragma once
// What the files of a session have in common: /v1/sessions/NAME/FILE. GET and HEAD; pages of any origin may read them. Answers carry an
// ETag, and those that took long to make are cached.

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "server/directory/directory.h"
#include "server/http/answer_cache.h"
#include "server/http/routes.h"
#include "server/session/session.h"
#include "server/snapshot/snapshot.h"

namespace ridgecast::http {

// Answers GET and HEAD for the session files that `isThere` accepts, and refuses other methods and unknown sessions. Counts as use of the
// session. `isThere` gets what follows the session's name and a slash.
Route sessionFileRoute(
    std::shared_ptr<directory::Directory> directory, bool (*isThere)(std::string_view file),
    std::function<Reply(const Request& request, std::shared_ptr<session::Session> session, std::string_view file)> answer);

// Makes files, or has made them.
struct Maker {
  std::shared_ptr<snapshot::Snapshots> snapshots;
  std::shared_ptr<AnswerCache> cache;
};
// From this ground of the session, even if it is made later. `headers` are added to the file's.
Reply fileOf(const Maker& maker, std::shared_ptr<session::Session> session, editing::Ground ground, snapshot::Question question,
             bool metadataOnly, const Headers& headers = {});

}  // namespace ridgecast::http
