#pragma once
// A terrain received as GLSL, evaluated only by the graphics driver: nothing from a network becomes machine code of this program. Heights
// have the same bits as the server's if the driver does not fuse multiplication and addition.

#include <memory>

#include "client/render/view.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"

namespace ridgecast::render {

// Unlike other terrains, callable only on the thread of the context that was current when it was made, while it is current. Error: the
// driver does not compile the terrain; names the line. A height map's text needs `heights`; with `edits` the heights are those of the
// edited ground. The terrain refers to both.
class HeightTexture;
class EditTexture;
Outcome<std::shared_ptr<const terrain::Terrain>> gpuTerrain(std::string name, const TerrainText& text,
                                                            const HeightTexture* heights = nullptr, const EditTexture* edits = nullptr);

}  // namespace ridgecast::render
