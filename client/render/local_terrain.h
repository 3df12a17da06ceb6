#pragma once
// How this client draws a server's world, and what it knows of the ground.

#include <memory>
#include <string>

#include "client/render/view.h"
#include "client/scene/height_window.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::render {

struct Drawing {
  TerrainText text;                                 // for the shaders; neutral: mesh normals and a ramp of heights, no ray march
  std::shared_ptr<const terrain::Terrain> terrain;  // null when neutral; else see gpuTerrain for the thread that may call it
  std::shared_ptr<scene::HeightWindow> window;      // of a height map: the same terrain, to be fed with tiles; else null
  std::string why;                                  // when neutral: one sentence for a person
};

// A built-in terrain of this client's own, when the content hash says that it is the server's: nothing received is used. Else the GLSL
// received, through the graphics driver alone, if `remoteShaders` allows it, the server has sent it and the driver compiles it.
// A height map's text is made here from its shape, and used when it is what the server has sent; its heights come as tiles. A private
// terrain's colours come with the vertices. Otherwise neutral. Needs a current context.
Drawing drawingOf(const wire::World& world, bool remoteShaders);
// What is left where the driver rejects the text after all, in another pass: `why` is its complaint.
Drawing neutralDrawing(const wire::World& world, const std::string& why);

// create(drawing.text); where the driver rejects a terrain's text, what draws the mesh without, for the mesh itself needs none: `drawing` is then
// the neutral one and says why.
template <class Create>
auto createOrNeutral(const wire::World& world, Drawing& drawing, const Create& create) {
  auto made = create(drawing.text);
  if (made || drawing.text.neutral) return made;
  drawing = neutralDrawing(world, made.error().message);
  return create(drawing.text);
}

}  // namespace ridgecast::render
