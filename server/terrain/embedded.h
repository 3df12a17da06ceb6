#pragma once
// Texts of this room, written into the library at build time (common/embed.cmake).

#include <string_view>

namespace ridgecast::user_terrain::embedded {

extern const std::string_view glsl_extras;  // what the compilation of a terrain file includes
extern const std::string_view translate;    // translate.cpp: another translation is another compilation

}  // namespace ridgecast::user_terrain::embedded
