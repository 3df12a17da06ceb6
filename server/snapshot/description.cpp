#include "server/snapshot/description.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "common/terrain/raster.h"
#include "common/text/text.h"
#include "common/user_terrain/declaration.h"

namespace ridgecast::snapshot {

using Json = nlohmann::json;

namespace {

using lattice::metres;

Json parametersOf(const terrain::Terrain& terrain) {
  Json out = Json::object();
  if (const auto declaration = user_terrain::readDeclaration(terrain.name(), terrain.source()))
    for (const user_terrain::Parameter& p : declaration->parameters) out[p.name] = p.value;
  return out;
}

// Of the file's origin; null: the terrain does not say where it lies.
Json georeference(const terrain::Raster& map, lattice::Point at) {
  const terrain::RasterShape& shape = map.shape();
  const terrain::RasterOrigin origin = map.origin();
  if (!origin.easting || !origin.northing) return {};
  const auto middle = [&](const terrain::RasterAxis& axis, std::uint32_t samples) {
    return metres(axis.origin) + (samples - 1) * (axis.metres() / 2);
  };
  Json out{{"easting", *origin.easting + metres(at.x) - middle(shape.x, shape.width)},
           {"northing", *origin.northing - metres(at.z) + middle(shape.z, shape.height)}};
  if (!origin.crs.empty()) out["crs"] = origin.crs;
  return out;
}

}  // namespace

Json describeBox(lattice::Point low, lattice::Point high) {
  return {{"x0", metres(low.x)}, {"z0", metres(low.z)}, {"x1", metres(high.x)}, {"z1", metres(high.z)}};
}

void describeWorld(const session::Session& session, const session::Ground& ground, lattice::Point origin, Json& extras) {
  const terrain::Terrain& terrain = *ground.terrain;
  extras["session"] = session.name();
  extras["terrain"] = terrain.name();
  extras["seed"] = terrain.seed();
  extras["contentHash"] = text::hexadecimal(session.contentHash());
  if (ground.edit != 0) extras["edit"] = ground.edit;
  if (!session.resources().limits.sendsTerrain) return;
  extras["parameters"] = parametersOf(terrain);
  if (const terrain::Raster* map = terrain.raster())
    if (Json reference = georeference(*map, origin); !reference.is_null()) extras["georeference"] = std::move(reference);
}

}  // namespace ridgecast::snapshot
