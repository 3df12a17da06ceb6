#pragma once
// The .glsl files of this folder, and what they are compiled with, as text, written into the library at build time (common/embed.cmake).

#include <string_view>

namespace ridgecast::terrain::embedded {

extern const std::string_view prelude;
extern const std::string_view shading;
extern const std::string_view alpine;
extern const std::string_view canyon;
extern const std::string_view archipelago;
extern const std::string_view raster_cubic;
extern const std::string_view raster;
extern const std::string_view raster_color;
extern const std::string_view glsl_as_cpp;
extern const std::string_view batch;

}  // namespace ridgecast::terrain::embedded
