#pragma once
// A session's ground as 3D Tiles 1.1 (server/tileset).
//
//   GET /v1/sessions/NAME/3dtiles/tileset.json?...        begin here
//   GET /v1/sessions/NAME/3dtiles/LEVEL/I/J.json?...      the tileset of a tile
//   GET /v1/sessions/NAME/3dtiles/LEVEL/I/J.glb?...       a tile's content
// Parameters, for all three (the last two ignore where):
//   at=LON,LAT[,HEIGHT]   degrees and metres on WGS84: the tangent plane there carries the ground; default: the terrain's own axes
//   x, z                  the place of the terrain that lies there, metres; default 0
//   reach                 metres that are covered in all four directions, 100 to 1,000,000; default 200,000
//   compression, normals, colours    as of a snapshot (server/snapshot/question.h)
//   token                 as in request_filter.h; it stands in the URIs inside the tileset, too
//   content               in those URIs: the ground's hash. While it holds, the answer may be kept for a day without asking again
// Refusals, ETag and origins as for snapshots (snapshots.h).

#include <memory>

#include "server/directory/directory.h"
#include "server/http/routes.h"
#include "server/http/session_files.h"

namespace ridgecast::http {

Route tilesetRoute(std::shared_ptr<directory::Directory> directory, Maker maker);

}  // namespace ridgecast::http
