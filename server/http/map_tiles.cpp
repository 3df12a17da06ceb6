#include "server/http/map_tiles.h"

#include <optional>
#include <string>
#include <utility>

#include "common/text/text.h"
#include "server/access/crypto.h"
#include "server/earth/earth.h"
#include "server/http/any_origin.h"
#include "server/map/mercator.h"
#include "server/map/sheet.h"
#include "server/map/tile.h"

namespace ridgecast::http {

namespace {

constexpr std::string_view kTilesPrefix = "/v1/sessions/";
constexpr int kTileVersion = 3;  // part of the ETag: change it when the same question gives another file
constexpr char kSayAt[] = "Say at=LON,LAT, where the world's origin lies, in degrees: its terrain does not say where on Earth it lies.";

struct Wanted {
  std::string session;
  bool colours = false;
  bool isList = false;                   // tiles.json
  std::optional<map::TileAddress> tile;  // empty: there is no such tile
};

// Empty: the path is not of a tile.
std::optional<Wanted> readPath(std::string_view path) {
  if (!path.starts_with(kTilesPrefix)) return std::nullopt;
  path.remove_prefix(kTilesPrefix.size());
  Wanted out;
  out.session = text::takePart(path, '/');
  const std::string_view kind = text::takePart(path, '/');
  if (kind != "heights" && kind != "colours") return std::nullopt;
  out.colours = kind == "colours";
  out.isList = path == "tiles.json";
  const auto level = text::number<int>(text::takePart(path, '/'));
  const auto x = text::number<std::uint32_t>(text::takePart(path, '/'));
  const std::string_view ending = out.colours ? ".jpg" : ".png";
  if (!path.ends_with(ending)) return out;
  path.remove_suffix(ending.size());
  const auto y = text::number<std::uint32_t>(path);
  if (!level || !x || !y || *level < 0 || *level > map::kFinestTileLevel || (*x >> *level) != 0 || (*y >> *level) != 0) return out;
  out.tile = map::TileAddress{*level, *x, *y};
  return out;
}

// What a question says beside the tile.
struct Placing {
  std::optional<map::Place> at;  // empty: where the map says
  bool emptyBeyond = false;      // beyond=empty
};

Outcome<Placing> readQuery(std::string_view query) {
  const auto at = queryParameter(query, "at"), beyond = queryParameter(query, "beyond");
  if (!at || !beyond) return at ? beyond.error() : at.error();
  if (!beyond->empty() && *beyond != "empty") return Error{"beyond is empty: tiles beside the map are answered by 204, without a picture."};
  Placing out{.at = {}, .emptyBeyond = !beyond->empty()};
  if (at->empty()) return out;
  out.at = map::placeOf(*at);
  if (!out.at) return Error{"Say at=LON,LAT, where the world's origin lies, in degrees: longitude within 180, latitude within 85."};
  return out;
}

Outcome<std::string> handedOn(std::string_view query) {
  std::string out;
  for (const char* name : {"at", "beyond"}) {
    const auto value = queryParameter(query, name);
    if (!value) return value.error();
    if (!value->empty()) out.append(out.empty() ? "?" : "&").append(name).append("=").append(*value);
  }
  return {boost::system::in_place_value, std::move(out)};
}

Answer fileOf(const terrain::Terrain& terrain, const map::Sheet& sheet, bool colours, const std::stop_token& stop) {
  Answer a;
  a.type = colours ? "image/jpeg" : "image/png";
  a.body = colours ? map::colourTile(terrain, sheet, stop) : map::heightTile(terrain, sheet, stop);
  if (stop.stop_requested()) return openRefusal(503, "This tile was not made: its client left.");
  if (a.body.empty()) return openRefusal(422, "This terrain's colours exist in GLSL alone; its heights have tiles.");
  return a;
}

// What a question says, and what the map says of where it lies.
std::string etagOf(std::uint64_t ground, const Wanted& wanted, const Placing& asked, const terrain::Raster* map) {
  std::string text = text::hexadecimal(ground) + (wanted.colours ? " colours" : " heights");
  for (const std::uint64_t v : {std::uint64_t{kTileVersion}, static_cast<std::uint64_t>(wanted.tile->level), std::uint64_t{wanted.tile->x},
                                std::uint64_t{wanted.tile->y}})
    text += " " + std::to_string(v);
  if (asked.at) text += " at " + text::rounded(asked.at->longitude, 17) + " " + text::rounded(asked.at->latitude, 17);
  if (map) {
    text += " " + map->origin().crs;
    if (const auto grid = terrain::onGrid(*map, {}))
      text += " " + text::rounded(grid->easting, 17) + " " + text::rounded(grid->northing, 17);
  }
  return access::hex(access::sha256(text)).substr(0, 32);
}

// Placed by PROJ, which takes tens of milliseconds where it begins.
Answer tileOf(const terrain::Terrain& terrain, const Wanted& wanted, const Placing& asked, const terrain::Raster* map,
              const std::stop_token& stop) {
  if (!asked.at && !earth::Grid::of(*map)) return openRefusal(400, kSayAt);
  const auto sheet = asked.at ? std::optional(map::sheetOf(*wanted.tile, *asked.at, map)) : map::sheetOf(*wanted.tile, *map);
  const terrain::Raster* const samples = terrain.raster();
  if (asked.emptyBeyond && (!sheet || (samples && map::isBeside(*sheet, samples->shape())))) {
    Answer empty;
    empty.status = 204;
    return opened(std::move(empty));
  }
  if (!sheet) return openRefusal(404, "The CRS of this map does not reach this tile: ask for a finer one, or say at=LON,LAT.");
  return fileOf(terrain, *sheet, wanted.colours, stop);
}

// TileJSON 3.0.0, with what MapLibre reads of it beyond. `folder`: of the tiles, an absolute address.
Answer listOf(const std::string& name, bool colours, const Placing& asked, const terrain::Raster* map, const std::string& folder,
              const std::string& query) {
  const auto bounds = map ? map::boundsOf(map->shape().area(), map, asked.at) : std::optional(map::Bounds());
  if (!bounds) return openRefusal(400, kSayAt);
  const auto [west, south, east, north] = *bounds;
  const map::Place middle = asked.at.value_or(map::Place{(west + east) / 2, (south + north) / 2});
  // Colours may be finer than the samples: a picture's.
  const int finest = map && !colours ? map::finestLevelOf(map->shape(), middle.latitude) : map::kFinestTileLevel;
  const auto list = [](std::initializer_list<double> numbers) {
    std::string out;
    for (const double v : numbers) out.append(out.empty() ? "[" : ", ").append(text::rounded(v, 10));
    return out + "]";
  };
  std::string body =
      "{\n  \"tilejson\": \"3.0.0\",\n  \"name\": \"" + name + (colours ? " colours" : " heights") + "\",\n  \"tiles\": [\"" + folder +
      "{z}/{x}/{y}" + (colours ? ".jpg" : ".png") + query + "\"],\n  \"minzoom\": 0,\n  \"maxzoom\": " + std::to_string(finest) +
      ",\n  \"bounds\": " + list({west, south, east, north}) +
      ",\n  \"center\": " + list({middle.longitude, middle.latitude, std::min<double>(finest, 12)}) + ",\n  \"tileSize\": 256";
  if (!colours) body += ",\n  \"encoding\": \"terrarium\"";
  return opened(json(body + "\n}\n"));
}

Reply answerTile(const Request& request, const std::shared_ptr<session::Session>& session, const Wanted& wanted, const Placing& asked) {
  const editing::Ground ground = session->ground();
  const terrain::Raster* const samples = ground.terrain->raster();
  const terrain::Raster* const map =
      session->resources().limits.sendsTerrain ? samples : nullptr;  // a private one does not say where it lies
  if (!asked.at && !(map && terrain::onGrid(*map, {}))) return openRefusal(400, kSayAt);
  if (wanted.isList) {
    if (request.host.empty() || !text::hasOnly(request.host, ".:-[]"))
      return openRefusal(400, "Send a Host header: the tiles' addresses are made of it.");
    const auto query = handedOn(request.query());
    if (!query) return openRefusal(400, query.error().message);
    const std::string folder = std::string(request.isSecure ? "https://" : "http://") + std::string(request.host) +
                               std::string(kTilesPrefix) + wanted.session + (wanted.colours ? "/colours/" : "/heights/");
    return DeferredResponse{.queue = Queue::kTiles,
                            .work = [terrain = ground.terrain, map, name = wanted.session, colours = wanted.colours, asked, folder,
                                     query = *query](const Turn&) { return listOf(name, colours, asked, map, folder, query); }};
  }
  const std::string etag = etagOf(session->hashOf(ground), wanted, asked, map);
  const auto work = [ground, wanted, asked, map, etag](const Turn& turn) {
    Answer made = tileOf(*ground.terrain, wanted, asked, map, turn.stop);
    if (made.status != 200) return made;
    made = opened(std::move(made));
    made.headers.emplace_back(kEditHeader, std::to_string(ground.edit));
    made.etag = etag;
    return made;
  };
  return DeferredResponse{.queue = Queue::kTiles, .work = work, .unchanged = opened({.etag = etag})};
}

std::optional<Reply> answerTile(const Request& request, const directory::Directory& directory) {
  const auto wanted = readPath(request.path());
  if (!wanted) return std::nullopt;
  if (request.method == "OPTIONS") return preflight();
  if (!request.reads()) return openWrongMethod();
  const auto session = directory.find(wanted->session);
  if (!session) return opened(noSession(wanted->session, directory));
  if (!wanted->tile && !wanted->isList)
    return openRefusal(404, "There is no such tile: tiles.json, heights/Z/X/Y.png or colours/Z/X/Y.jpg, Z from 0 to " +
                                std::to_string(map::kFinestTileLevel) + ", X and Y below 2^Z.");
  const auto asked = readQuery(request.query());
  if (!asked) return openRefusal(400, asked.error().message);
  session->use();
  const auto own = std::make_shared<const OwnRequest>(request);
  return onceHas(
      request.edit, session, [=] { return answerTile(own->request(), session, *wanted, *asked); }, opened);
}

}  // namespace

Route mapTileRoute(std::shared_ptr<directory::Directory> directory) {
  return [directory = std::move(directory)](const Request& request) { return answerTile(request, *directory); };
}

}  // namespace ridgecast::http
