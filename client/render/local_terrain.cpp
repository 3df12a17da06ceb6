#include "client/render/local_terrain.h"

#include <string>

namespace ridgecast::render {

Outcome<std::shared_ptr<const terrain::Terrain>> localTerrain(const wire::World& world) {
  auto made = terrain::create(world.terrainName, world.seed);
  if (!made) return Error{"this client cannot compute the server's terrain: " + made.error().message};
  if (terrain::contentHash(**made) != world.contentHash)
    return Error{"the server's terrain '" + world.terrainName +
                 "' is not the one this client was built with: use a client and a server of one version"};
  return *made;
}

}  // namespace ridgecast::render
