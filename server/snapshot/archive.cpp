#include "server/snapshot/archive.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "common/text/text.h"
#include "server/map/mercator.h"
#include "server/map/pmtiles.h"
#include "server/map/sheet.h"
#include "server/map/tile.h"
#include "server/scheduling/pool.h"
#include "server/snapshot/description.h"

namespace ridgecast::snapshot {

namespace {

struct Numbered {
  std::uint64_t id = 0;
  map::TileAddress tile;
};

// In the order of the archive.
std::vector<Numbered> numbered(const map::Bounds& bounds, int finest) {
  std::vector<Numbered> out;
  for (int level = 0; level <= finest; ++level) {
    const map::TileRange range = map::tilesOf(bounds, level);
    for (std::uint32_t y = range.y0; y <= range.y1; ++y)
      for (std::uint32_t x = range.x0; x <= range.x1; ++x) out.push_back({map::tileId({level, x, y}), {level, x, y}});
  }
  std::ranges::sort(out, {}, &Numbered::id);
  return out;
}

std::string metadataOf(const session::Session& session, const editing::Ground& ground, const OfMapTiles& of, const map::Bounds& b) {
  nlohmann::json out{{"name", std::string(ground.terrain->name()) + (of.colours ? " colours" : " heights")},
                     {"type", of.colours ? "overlay" : "baselayer"},
                     {"bounds", text::rounded(b.west, 9) + "," + text::rounded(b.south, 9) + "," + text::rounded(b.east, 9) + "," +
                                    text::rounded(b.north, 9)}};
  if (!of.colours) out["encoding"] = "terrarium";
  describeWorld(session, ground, {}, out["ridgecast"]);
  return out.dump();
}

}  // namespace

Result<std::uint64_t> makeArchive(const session::Session& session, const OfMapTiles& of, unsigned threads,
                                  const std::filesystem::path& file, std::stop_token stop, TilesProgress* progress) {
  expects(threads > 0, "an archive is made by one thread or more");
  const editing::Ground ground = session.ground();
  const terrain::Raster* const map = ground.terrain->raster();
  const auto bounds = map::boundsOf(of.part, map, of.at);
  if (!bounds)
    return Problem{Problem::Kind::kTooMuch,
                   "This terrain does not say where on Earth it lies: say at=LON,LAT, where the world's origin lies."};
  const int finest = of.finest.value_or(map ? map::finestLevelOf(map->shape(), (bounds->south + bounds->north) / 2) : 0);
  std::uint64_t count = 0;
  for (int level = 0; level <= finest; ++level) {
    count += map::tilesOf(*bounds, level).count();
    if (count > kMaxTiles)
      return Problem{Problem::Kind::kTooMuch, "Levels 0 to " + std::to_string(finest) + " are more than " + std::to_string(kMaxTiles) +
                                                  " tiles, the limit; zoom=" + std::to_string(level - 1) + " fits."};
  }
  const auto tiles = numbered(*bounds, finest);
  if (progress) progress->tiles = static_cast<std::uint32_t>(tiles.size());
  map::Archive archive(file);
  scheduling::Executor executor(threads);
  const auto pool = executor.makePool(threads);
  const std::size_t most = 8 * std::size_t{threads};
  std::uint64_t made = 0;
  for (std::size_t first = 0; first < tiles.size() && !stop.stop_requested(); first += most) {
    std::vector<std::optional<std::string>> files(std::min(most, tiles.size() - first));  // none: it is not there
    pool->forEach(files.size(), 1, [&](std::size_t k) {
      const map::TileAddress& tile = tiles[first + k].tile;
      const auto sheet = of.at ? std::optional(map::sheetOf(tile, *of.at, map)) : map::sheetOf(tile, *map);
      if (sheet && !(map && map::isBeside(*sheet, map->shape())))
        files[k] = of.colours ? map::colourTile(*ground.terrain, *sheet, stop) : map::heightTile(*ground.terrain, *sheet, stop);
      if (progress) ++progress->done;
    });
    for (std::size_t k = 0; k < files.size() && !stop.stop_requested(); ++k) {
      if (!files[k]) continue;
      if (files[k]->empty()) return Problem{Problem::Kind::kTooMuch, "This terrain's colours exist in GLSL alone; its heights have tiles."};
      if (!archive.add(tiles[first + k].id, *files[k])) return Problem{Problem::Kind::kFailed, "Cannot write '" + file.string() + "'."};
      ++made;
    }
  }
  if (stop.stop_requested()) return Problem{Problem::Kind::kStopped, "The tiles were not made: their client left."};
  const map::Archive::About about{of.colours ? map::Archive::Type::kJpeg : map::Archive::Type::kPng, 0, finest, *bounds,
                                  metadataOf(session, ground, of, *bounds)};
  if (!archive.finish(about)) return Problem{Problem::Kind::kFailed, "Cannot write '" + file.string() + "'."};
  return made;
}

}  // namespace ridgecast::snapshot
