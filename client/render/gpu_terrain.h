#pragma once
// A terrain that came as GLSL, evaluated by the graphics driver and by nothing else: nothing that a network sent becomes machine code
// of this program. Heights have the bits of the server's where the driver does not fuse multiplication and addition.

#include <memory>

#include "client/render/view.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"

namespace ridgecast::render {

// Unlike other terrains it may be called on one thread only: that of the context that was current when it was made, while it is
// current. Error: the driver does not compile the terrain; names the line.
// A height map's text needs `heights`, which the terrain refers to.
class HeightTexture;
Outcome<std::shared_ptr<const terrain::Terrain>> gpuTerrain(std::string name, const TerrainText& text,
                                                            const HeightTexture* heights = nullptr);

}  // namespace ridgecast::render
