#pragma once
// Texts of this room, written into the library at build time (common/embed.cmake).

#include <string_view>

namespace ridgecast::user_terrain::embedded {

extern const std::string_view glsl_extras;  // included by the compilation of a terrain file
extern const std::string_view translate;    // translate.cpp, part of the cache key

}  // namespace ridgecast::user_terrain::embedded
