#include "client/render/local_terrain.h"

#include <string>

#include "client/render/gpu_terrain.h"
#include "client/render/march_pass.h"
#include "client/render/shade_pass.h"

namespace ridgecast::render {

Drawing neutralDrawing(const wire::World& world, const std::string& why) {
  return {{{}, world.seed, true}, nullptr, nullptr, why + "; drawing the mesh's own shape in neutral colours, without a ray march"};
}

namespace {

// This client's own terrain, if it is the server's; otherwise null.
std::shared_ptr<const terrain::Terrain> builtInOf(const wire::World& world) {
  auto own = terrain::create(world.terrainName, world.seed);
  return own && terrain::contentHash(**own) == world.contentHash ? *own : nullptr;
}

// Whether the text is one that this client makes of a height map's shape.
bool isRasterText(const wire::World& world) { return world.heightMap && world.terrainSource == terrain::rasterSource(*world.heightMap); }

}  // namespace

bool compilesText(const wire::World& world, bool remoteShaders) {
  if (builtInOf(world)) return true;
  return !world.terrainSource.empty() && !world.shadedVertices && (remoteShaders || isRasterText(world));
}

Drawing drawingMeanwhile(const wire::World& world) {
  Drawing out = neutralDrawing(world, "the graphics driver compiles " + world.terrainName);
  out.terrain = builtInOf(world);
  return out;
}

Drawing drawingOf(const wire::World& world, bool remoteShaders) {
  if (auto own = builtInOf(world)) return {{std::string(own->source()), world.seed, false}, own, nullptr, {}};
  const auto neutral = [&](const std::string& why) { return neutralDrawing(world, why); };
  if (world.shadedVertices)
    return {{{}, world.seed, true, true},
            nullptr,
            nullptr,
            "the server keeps its terrain's text to itself; drawing the colours and normals that come with the mesh, without a ray march"};
  if (world.terrainSource.empty()) return neutral("the server keeps its terrain's text to itself");
  if (!isRasterText(world) && !remoteShaders) return neutral("the terrain's text came from the server and --no-remote-shaders refuses it");
  const TerrainText text{
      world.terrainSource, world.seed, false, false, world.heightMap.has_value(), world.heightMap && world.heightMap->draped};
  if (world.heightMap) {
    if (auto shade = ShadePass::create(text); !shade) return neutral(shade.error().message);
    if (auto march = MarchPass::create(text); !march) return neutral(march.error().message);
    auto window = std::make_shared<core::HeightWindow>(world.terrainName, world.terrainSource, world.seed, *world.heightMap, world.horizon);
    return {text, window, window, {}};
  }
  auto terrain = gpuTerrain(world.terrainName, text);
  if (!terrain) return neutral(terrain.error().message);
  if (auto shade = ShadePass::create(text); !shade) return neutral(shade.error().message);
  return {text, *terrain, nullptr, {}};
}

}  // namespace ridgecast::render
