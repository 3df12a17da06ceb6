#include "server/snapshot/description.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "common/glsl/declaration.h"
#include "common/terrain/raster.h"
#include "common/text/text.h"
#include "server/earth/earth.h"

namespace ridgecast::snapshot {

using Json = nlohmann::json;

namespace {

using lattice::metres;

Json parametersOf(const terrain::Terrain& terrain) {
  Json out = Json::object();
  if (const auto declaration = glsl::readDeclaration(terrain.name(), terrain.source()))
    for (const glsl::Parameter& p : declaration->parameters) out[p.name] = p.value;
  return out;
}

}  // namespace

Json describeBox(lattice::Point low, lattice::Point high) {
  return {{"x0", metres(low.x)}, {"z0", metres(low.z)}, {"x1", metres(high.x)}, {"z1", metres(high.z)}};
}

void describeWorld(const session::Session& session, const editing::Ground& ground, lattice::Point origin, Json& extras) {
  const terrain::Terrain& terrain = *ground.terrain;
  extras["session"] = session.name();
  extras["terrain"] = terrain.name();
  extras["seed"] = terrain.seed();
  extras["contentHash"] = text::hexadecimal(session.contentHash());
  if (ground.edit != 0) extras["edit"] = ground.edit;
  if (!session.resources().limits.sendsTerrain) return;
  extras["parameters"] = parametersOf(terrain);
  const terrain::Raster* const map = terrain.raster();
  const auto place = map ? terrain::onGrid(*map, origin) : std::nullopt;
  if (!place) return;
  Json& georeference = extras["georeference"] = {{"easting", place->easting}, {"northing", place->northing}};
  if (const std::string crs = map->origin().crs; !crs.empty()) georeference["crs"] = crs;
  const auto* const grid = earth::Grid::of(*map);
  if (const auto degrees = grid ? grid->degrees(*place) : std::nullopt)
    georeference["longitude"] = (*degrees)[0], georeference["latitude"] = (*degrees)[1];
}

}  // namespace ridgecast::snapshot
