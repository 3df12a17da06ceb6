#pragma once
// Pictures as files in memory, from red, green and blue bytes, row after row. Equal pixels give equal bytes. Pure functions; any thread.

#include <cstdint>
#include <span>
#include <string>

namespace ridgecast::map {

// Lossless, packed for speed.
std::string png(std::span<const std::uint8_t> rgb, std::uint32_t columns, std::uint32_t rows);

// quality: 1 to 100.
std::string jpeg(std::span<const std::uint8_t> rgb, std::uint32_t columns, std::uint32_t rows, int quality = 85);

}  // namespace ridgecast::map
