#pragma once
// How much a mesh pops while it refines: the camera stands still, frames come 60 a second, iterations every sixth of them, and each
// frame is compared with the one before, once with every change shown at once and once morphed (client/render/morph.h).

#include <vector>

#include "client/evaluation/results.h"
#include "client/render/morph.h"
#include "client/render/renderer.h"

namespace ridgecast::evaluation {

// `states`: the leaves after each iteration of a standing camera, the first one's included. Draws some 20 frames a state.
Outcome<Popping> measurePopping(render::Renderer& renderer, const render::View& view, const std::vector<render::Morph::Leaves>& states);

}  // namespace ridgecast::evaluation
