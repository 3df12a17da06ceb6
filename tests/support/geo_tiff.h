#pragma once
// GeoTIFFs, byte by byte: they share nothing with who reads them.

#include <array>
#include <cstdint>
#include <fstream>
#include <functional>
#include <string>

namespace ridgecast::testing_support {

// In UTM zone 32, easting 680,000, northing 5,240,000, in one strip: samples of 16 bits, or a picture's pixels of 8.
template <class Value, std::size_t kBands>
void writeGeoTiff(const std::string& file, std::uint16_t width, std::uint16_t height, double pitch,
                  const std::function<std::array<Value, kBands>(int x, int z)>& sample) {
  std::string tags, after;
  const auto put = [](std::string& to, auto value) { to.append(reinterpret_cast<const char*>(&value), sizeof value); };
  const std::uint32_t count = 11, behind = 8 + 2 + count * 12 + 4, doubles = behind, keys = doubles + 9 * 8, strip = keys + 8 * 2;
  const auto tag = [&](std::uint16_t code, std::uint16_t type, std::uint32_t n, std::uint32_t value) {
    put(tags, code), put(tags, type), put(tags, n), put(tags, value);
  };
  constexpr std::uint16_t kShort = 3, kLong = 4, kDouble = 12;
  tag(256, kShort, 1, width);
  tag(257, kShort, 1, height);
  tag(258, kShort, 1, 8 * sizeof(Value));    // of every band
  tag(259, kShort, 1, 1);                    // not compressed
  tag(262, kShort, 1, kBands == 3 ? 2 : 1);  // red, green, blue, or grey
  tag(273, kLong, 1, strip);
  tag(277, kShort, 1, kBands);
  tag(279, kLong, 1, std::uint32_t{sizeof(Value) * kBands} * width * height);
  tag(33550, kDouble, 3, doubles);          // pixels' size
  tag(33922, kDouble, 6, doubles + 3 * 8);  // the first one's place
  tag(34735, kShort, 8, keys);
  for (const double v : {pitch, pitch, 0.0, 0.0, 0.0, 0.0, 680'000.0, 5'240'000.0, 0.0}) put(after, v);
  for (const std::uint16_t v : {1, 1, 0, 1, 3072, 0, 1, 32632}) put(after, v);
  for (int z = 0; z < height; ++z)
    for (int x = 0; x < width; ++x) put(after, sample(x, z));
  std::ofstream out(file, std::ios::binary);
  std::string head = "II*";
  head += '\0';
  put(head, std::uint32_t{8});
  put(head, static_cast<std::uint16_t>(count));
  out << head << tags << std::string(4, '\0') << after;
}

}  // namespace ridgecast::testing_support
