#pragma once
// Snapshots over HTTP.
//
//   GET /v1/sessions/NAME/snapshot.glb?...     the file; the questions are those of server/snapshot/question.h
//   GET /v1/sessions/NAME/snapshot.json?...    its metadata alone
// HEAD gives the same header. Answers carry an ETag (for a live camera only once they are made) and may be read by pages of any origin.
// Who asks with `Prefer: progress` is told about once a second how far it has come: HTTP 102 with a header `Progress`.
//   400 nonsense   404 no such session or camera   405 another method   422 beyond a limit: says which, and what would fit
//   503 too busy, or not ready in time; with Retry-After

#include <memory>

#include "server/http/routes.h"
#include "server/session/session.h"
#include "server/snapshot/snapshot.h"

namespace ridgecast::http {

Route snapshotRoute(std::shared_ptr<session::Directory> directory, std::shared_ptr<snapshot::Snapshots> snapshots);

}  // namespace ridgecast::http
