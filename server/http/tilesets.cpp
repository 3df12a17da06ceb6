#include "server/http/tilesets.h"

#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "common/gltf/glb.h"
#include "common/lattice/lattice.h"
#include "common/text/text.h"
#include "server/access/crypto.h"
#include "server/http/any_origin.h"
#include "server/snapshot/parameters.h"
#include "server/tileset/tile.h"
#include "server/tileset/tileset.h"

namespace ridgecast::http {

namespace {

constexpr std::string_view kFolder = "3dtiles/", kRoot = "3dtiles/tileset.json";
constexpr double kMaxMetres = 4e12;
constexpr int kVersion = 4;  // part of the ETag: change it when the same question gives another tileset

bool isThere(std::string_view file) { return file.starts_with(kFolder) && (file.ends_with(".json") || file.ends_with(".glb")); }

struct Asked {
  tileset::Question where;
  snapshot::Question form;
  std::string token, content;
};

Outcome<Asked> parse(std::string_view query) {
  snapshot::Parameters p;
  if (auto read = p.read(query); !read) return read.error();
  Asked out;
  out.where.where = snapshot::readWhere(p);
  for (const auto& [name, step] : {std::pair{"x", &out.where.middle.x}, {"z", &out.where.middle.z}})
    *step = static_cast<lattice::Step>(std::floor(p.number(name, -kMaxMetres, kMaxMetres, " m", 0) * lattice::kStepsPerMetre));
  out.where.reach = p.number("reach", tileset::kMinReach, tileset::kMaxReach, " m", tileset::kUsualReach);
  snapshot::readForm(p, out.form);
  out.token = p.take("token").value_or("");
  out.content = p.take("content").value_or("");
  if (!text::hasOnly(out.token, "-_.")) p.refuse("'token' has other characters than a token has.");
  // What viewers and gateways hand on to every tile.
  for (const char* name : {"v", "key", "access_token", "session", "_"}) p.take(name);
  if (auto error = p.finish("A tileset has at, heights, x, z, reach, compression, normals, colours, materials and token.")) return *error;
  return out;
}

// LEVEL/I/J, as a tileset spells it.
std::optional<lattice::LeafAddress> squareOf(std::string_view path) {
  const std::string_view whole = path;
  const auto level = text::number<std::int32_t>(text::takePart(path, '/'));
  const auto i = text::number<std::int64_t>(text::takePart(path, '/')), j = text::number<std::int64_t>(path);
  if (!level || !i || !j) return std::nullopt;
  const lattice::LeafAddress square{*level, *i, *j};
  if (!tileset::isTile(square) || std::to_string(*level) + "/" + std::to_string(*i) + "/" + std::to_string(*j) != whole)
    return std::nullopt;
  return square;
}

// What each URI inside a tileset ends with, but for the token: a cached tileset has none.
std::string handedOn(const Asked& asked, const std::string& content) {
  std::string out = "content=" + content;
  if (asked.form.compression == gltf::Compression::kDraco) out += "&compression=draco";
  if (!asked.form.attributes.normals) out += "&normals=0";
  if (!asked.form.attributes.colours) out += "&colours=0";
  if (asked.form.attributes.materials) out += "&materials=1";
  out += asked.where.where.heights == earth::Heights::kSea ? "&heights=sea" : "&heights=ellipsoid";
  if (asked.where.where.at) {
    const auto [x, z] = asked.where.middle;
    constexpr double kDegrees = 180 / std::numbers::pi;
    out += "&at=" + text::rounded(asked.where.where.at->longitude * kDegrees, 17) + "," +
           text::rounded(asked.where.where.at->latitude * kDegrees, 17) + "," + text::rounded(asked.where.where.at->height, 17) +
           "&x=" + text::rounded(lattice::metres(x), 17) + "&z=" + text::rounded(lattice::metres(z), 17);
  }
  return out;
}

Answer withToken(Answer a, const std::string& token) {
  if (token.empty()) return a;
  const std::string before = "?content=", after = "?token=" + token + "&content=";
  std::string body;
  std::size_t from = 0;
  for (std::size_t at; (at = a.body.find(before, from)) != std::string::npos; from = at + before.size())
    body.append(a.body, from, at - from).append(after);
  a.body = body.append(a.body, from);
  return a;
}

Reply tilesetAnswer(const Maker& maker, const editing::Ground& ground, const Asked& asked, std::optional<lattice::LeafAddress> square,
                    const std::string& content, const Headers& headers) {
  const std::string query = handedOn(asked, content);
  std::string key = "tileset " + std::to_string(kVersion) + " " + query;
  if (square)
    key += " " + std::to_string(square->level) + " " + std::to_string(square->i) + " " + std::to_string(square->j);
  else
    key += " root " + std::to_string(asked.where.middle.x) + " " + std::to_string(asked.where.middle.z) + " " +
           text::rounded(asked.where.reach, 17);
  if (const terrain::Raster* const map = ground.terrain->raster(); map && !asked.where.isPrivate)
    if (const auto grid = terrain::onGrid(*map, asked.where.middle))
      key += " " + map->origin().crs + " " + text::rounded(grid->easting, 17) + " " + text::rounded(grid->northing, 17);
  if (!square && asked.where.where.at)
    for (const double v : {asked.where.where.at->longitude, asked.where.where.at->latitude, asked.where.where.at->height})
      key += " " + text::rounded(v, 17);
  const std::string etag = access::hex(access::sha256(key)).substr(0, 32);
  const auto finished = [headers, token = asked.token](Answer a) {
    a.headers.insert(a.headers.end(), headers.begin(), headers.end());
    return withToken(std::move(a), token);
  };
  if (auto known = maker.cache->find(etag)) return finished(std::move(*known));
  const auto work = [=, where = asked.where, terrain = ground.terrain, cache = maker.cache](const Turn&) {
    Answer made = opened(json(square ? tileset::tilesetOf(*terrain, where, *square, query) : tileset::rootTileset(*terrain, where, query)));
    made.etag = etag;
    cache->keep(made);
    return finished(std::move(made));
  };
  return DeferredResponse{.work = work, .unchanged = finished(opened({.etag = etag}))};
}

Reply respond(const Maker& maker, const Request& request, std::shared_ptr<session::Session> session, std::string_view file) {
  auto asked = parse(request.query());
  if (!asked) return openRefusal(400, asked.error().message);
  const bool isRoot = file == kRoot, isTileset = file.ends_with(".json");
  const auto square = squareOf(file.substr(kFolder.size(), file.rfind('.') - kFolder.size()));
  if (!isRoot && !square)
    return openRefusal(404, "There is no such tile: tiles are LEVEL/I/J with LEVEL 0 to " + std::to_string(tileset::kCoarsest) +
                                "; tileset.json names those there are.");
  asked->where.isPrivate = !session->resources().limits.sendsTerrain;
  auto ground = session->ground();
  // A map that lies elsewhere (place=geo) begins in its middle, unless another place is asked for.
  lattice::Point& middle = asked->where.middle;
  if (const terrain::Raster* const map = ground.terrain->raster(); map && middle == lattice::Point{} && !map->shape().area().holds(middle))
    middle = map->shape().middle();
  const std::string content = text::hexadecimal(session->hashOf(ground));
  Headers headers;
  if (!isRoot && asked->content == content) headers.emplace_back("Cache-Control", "private, max-age=86400, immutable");
  if (isTileset) return tilesetAnswer(maker, ground, *asked, isRoot ? std::nullopt : square, content, headers);
  asked->form.of = tileset::whole(*square);
  return fileOf(maker, std::move(session), std::move(ground), std::move(asked->form), false, headers);
}

}  // namespace

Route tilesetRoute(std::shared_ptr<directory::Directory> directory, Maker maker) {
  return sessionFileRoute(std::move(directory), isThere,
                          [maker = std::move(maker)](const Request& request, std::shared_ptr<session::Session> session,
                                                     std::string_view file) { return respond(maker, request, std::move(session), file); });
}

}  // namespace ridgecast::http
