#include "client/render/local_terrain.h"

#include <string>

#include "client/render/gpu_terrain.h"
#include "client/render/shade_pass.h"

namespace ridgecast::render {

Drawing drawingOf(const wire::World& world, bool remoteShaders) {
  if (auto own = terrain::create(world.terrainName, world.seed); own && terrain::contentHash(**own) == world.contentHash)
    return {{std::string((*own)->source()), world.seed, false}, *own, {}};
  const auto neutral = [&](const std::string& why) {
    return Drawing{{{}, world.seed, true}, nullptr, why + "; drawing the mesh's own shape in neutral colours, without a ray march"};
  };
  if (world.terrainSource.empty()) return neutral("the server keeps its terrain's text to itself");
  if (!remoteShaders) return neutral("the terrain's text came from the server and --no-remote-shaders refuses it");
  const TerrainText text{world.terrainSource, world.seed, false};
  auto terrain = gpuTerrain(world.terrainName, text);
  if (!terrain) return neutral(terrain.error().message);
  if (auto shade = ShadePass::create(text); !shade) return neutral(shade.error().message);
  return {text, *terrain, {}};
}

}  // namespace ridgecast::render
