#pragma once
// The camera paths of this folder as text, written into the library at build time.

#include <string_view>

namespace ridgecast::evaluation::paths {

extern const std::string_view alpine;
extern const std::string_view canyon;
extern const std::string_view archipelago;

}  // namespace ridgecast::evaluation::paths
