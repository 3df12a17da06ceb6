#pragma once
// How this client draws a server's world, and its knowledge of the ground.

#include <memory>
#include <string>

#include "client/core/ground/height_window.h"
#include "client/render/view.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::render {

struct Drawing {
  TerrainText text;                                 // for the shaders; neutral: mesh normals and a ramp of heights, no ray march
  std::shared_ptr<const terrain::Terrain> terrain;  // null: not known here; see gpuTerrain for the thread that may call it
  std::shared_ptr<core::HeightWindow> window;       // of a height map: the same terrain, to be fed with tiles; otherwise null
  std::string why;                                  // if neutral: one sentence for people
};

// In this order: a built-in terrain of this client whose content hash is the server's (nothing received is used); the received GLSL,
// through the graphics driver alone, if `remoteShaders` allows it and the driver compiles it; neutral. A height map's text is made here
// from its shape and used if it equals the server's; its heights come as tiles. A private terrain's colours come with the vertices. Needs a
// current context.
Drawing drawingOf(const wire::World& world, bool remoteShaders);
// Whether drawingOf() hands the driver a terrain's text. Compiling that may take seconds, on a software driver a minute.
bool compilesText(const wire::World& world, bool remoteShaders);
// Neutral, until the driver has compiled it; a built-in terrain's ground is known.
Drawing drawingMeanwhile(const wire::World& world);
// The fallback when the driver rejects the text in a later pass: `why` is its message. No ground is known.
Drawing neutralDrawing(const wire::World& world, const std::string& why);

// Returns create(drawing.text). If the driver rejects a terrain's text, returns what draws the mesh without it; `drawing` is then the
// neutral one and says why.
template <class Create>
auto createOrNeutral(const wire::World& world, Drawing& drawing, const Create& create) {
  auto made = create(drawing.text);
  if (made || drawing.text.neutral) return made;
  drawing = neutralDrawing(world, made.error().message);
  return create(drawing.text);
}

}  // namespace ridgecast::render
