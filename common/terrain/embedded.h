#pragma once
// The .glsl files of this folder as text, written into the library at build time (embed.cmake).

#include <string_view>

namespace ridgecast::terrain::embedded {

extern const std::string_view prelude;
extern const std::string_view shading;
extern const std::string_view alpine;

}  // namespace ridgecast::terrain::embedded
