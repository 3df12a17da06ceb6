#pragma once
// Web map tiles of a part of the world as one file for any file server, a PMTiles archive (server/map/pmtiles.h): at levels 0 to the
// finest, the tiles that meet the part's longitudes and latitudes and do not lie outside the height map. They are the server's own (README,
// Map tiles), byte for byte.
//
// Bounds: kMaxTiles; memory holds eight tiles a thread, and 48 bytes for every tile.

#include <cstdint>
#include <filesystem>
#include <stop_token>

#include "server/session/session.h"
#include "server/snapshot/question.h"
#include "server/snapshot/snapshot.h"
#include "server/snapshot/tiles.h"

namespace ridgecast::snapshot {

// Makes the tiles on `threads` threads; blocks until all are in the file. Returns their number. Problems: nothing says where the part lies,
// too many tiles, a file that cannot be written.
Result<std::uint64_t> makeArchive(const session::Session& session, const OfMapTiles& of, unsigned threads,
                                  const std::filesystem::path& file, std::stop_token stop, TilesProgress* progress = nullptr);

}  // namespace ridgecast::snapshot
