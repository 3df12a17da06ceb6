// Draco's streams are decoded by its own WebAssembly module, which the worker holds: common/codec/draco.h over an import.

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "common/codec/draco.h"

namespace {

std::vector<std::uint32_t> decoded;  // three numbers for each point, then for each triangle

}  // namespace

extern "C" {

// The number of points, which lie with the triangles in what dracoRoom() gave; below 0: the stream is damaged.
__attribute__((import_module("page"), import_name("draco"))) std::int32_t pageDraco(const std::uint8_t* bytes, std::size_t count,
                                                                                    std::uint32_t triangles);

__attribute__((export_name("dracoRoom"))) std::uint32_t* dracoRoom(std::size_t numbers) {
  decoded.resize(numbers);
  return decoded.data();
}
}

namespace ridgecast::codec {

std::string decodeDraco(std::span<const std::uint8_t> bytes, std::uint32_t triangles, Soup& out) {
  const std::int32_t points = pageDraco(bytes.data(), bytes.size(), triangles);
  if (points < 0) return "its Draco stream is damaged";
  const auto count = static_cast<std::size_t>(points);
  if (count > 3 * std::size_t{triangles} || decoded.size() != 3 * (count + triangles))
    return "its Draco stream does not have the announced counts";
  out.points.resize(count);
  out.triangles.resize(triangles);
  std::memcpy(out.points.data(), decoded.data(), 12 * count);
  std::memcpy(out.triangles.data(), &decoded[3 * count], 12 * std::size_t{triangles});
  return {};
}

}  // namespace ridgecast::codec
