#pragma once
// GLSL that desktop and browser compile from one text: the .glsl files of this folder, each described at its beginning. A side puts its
// own head before it (version line, in the browser precisions) and the #defines that the text names; what draws terrain stands behind
// terrain::prelude(), a terrain file, terrain::shading() and `view`.

#include <string_view>

namespace ridgecast::shaders {

extern const std::string_view view;
extern const std::string_view full_screen;
extern const std::string_view neutral_terrain;
extern const std::string_view march;
extern const std::string_view shade;
extern const std::string_view mesh_vertex;
extern const std::string_view dots_vertex;
extern const std::string_view dots;

}  // namespace ridgecast::shaders
