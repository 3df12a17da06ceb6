#pragma once
// A box as 3D Tiles 1.1, for any file server: tileset.json, LEVEL/I/J.glb and LEVEL/I/J.json (server/tileset/tileset.h).
//
// The finest tiles keep the box's error, and each level above twice that of the one below. A finest tile is at least 80 errors wide, as on
// a server, and over a height map at least 64 samples, so that a flat map does not become a million files; but on the globe only so wide
// that its plane stays within 0.4 errors of the Earth: 2 km at an error of 1 m, 8 km at 20 m. Tiles that the box's border crosses end
// there. Where an error is that of a server's level, the other tiles have the server's bytes. Boxes in the tilesets are those of the
// meshes.
//
// The root's axes begin in the middle of the box, at height 0. Its transform lays them on the Earth: by `at`, or by the map's CRS where
// earth::onEarth knows it. asset.extras: of ("tiles"), box, error, origin, georeference as in snapshot.h, and the number of tiles.
//
// Bounds: kMaxTiles, of which a hundred bytes each are held; `threads` tiles are in work.

#include <atomic>
#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>
#include <string_view>

#include "server/session/session.h"
#include "server/snapshot/question.h"
#include "server/snapshot/snapshot.h"

namespace ridgecast::snapshot {

inline constexpr std::uint64_t kMaxTiles = 250'000;

struct TilesProgress {
  std::atomic<std::uint32_t> done{0}, tiles{0};
  std::string text() const;  // "meshing, tile 37 of 512"
};

// Takes a file, by its path in the folder; false: it cannot. tileset.json comes last. Several threads at a time.
using Put = std::function<bool(const std::string& name, std::string_view bytes)>;

// Makes the tiles of a question in the format kTiles on `threads` threads; blocks until all are there. Returns their number. Problems: too
// many tiles, as Snapshots::take, or a file that could not be put.
Result<std::uint32_t> makeTiles(Snapshots& snapshots, const session::Session& session, const Question& question, unsigned threads,
                                const Put& put, std::stop_token stop, TilesProgress* progress = nullptr);

}  // namespace ridgecast::snapshot
