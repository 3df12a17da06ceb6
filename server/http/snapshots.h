#pragma once
// Snapshots over HTTP.
//
//   GET /v1/sessions/NAME/snapshot.glb?...     the file; parameters: server/snapshot/question.h
//   GET /v1/sessions/NAME/snapshot.ply?...     the same mesh as PLY or, snapshot.obj, as OBJ (server/snapshot/polygon_file.h)
//   GET /v1/sessions/NAME/snapshot.tif?...     heights on a grid, as a GeoTIFF (server/snapshot/geotiff.h)
//   GET /v1/sessions/NAME/snapshot.json?...    only a mesh's metadata
// HEAD returns the same header. Answers carry an ETag (for a live camera only once made), and pages of any origin may read them. Clients
// that send `Prefer: progress` get progress about once a second: HTTP 102 with a header `Progress`.
//   400 invalid   404 no such session or camera   405 other method   422 beyond a limit: says which, and what would fit
//   503 too busy, or not ready in time; with Retry-After

#include <memory>

#include "server/directory/directory.h"
#include "server/http/routes.h"
#include "server/http/session_files.h"

namespace ridgecast::http {

Route snapshotRoute(std::shared_ptr<directory::Directory> directory, Maker maker);

}  // namespace ridgecast::http
