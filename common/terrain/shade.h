#pragma once
// A vertex's appearance: the terrain's normal and colour there, in five bytes. Sent with the mesh of a private terrain, whose text clients
// never receive.

#include <cstddef>
#include <cstdint>

namespace ridgecast::terrain {

// normal: stereographic from below, (nx, nz) / (1 + ny) as signed bytes of 1/127; colour: the square roots of linear red, green, blue in
// 0..1 as bytes of 1/255.
struct Shade {
  std::int8_t normalX = 0, normalZ = 0;
  std::uint8_t red = 0, green = 0, blue = 0;
  friend bool operator==(const Shade&, const Shade&) = default;
};
inline constexpr std::size_t kShadeBytes = 5;  // in this order

}  // namespace ridgecast::terrain
