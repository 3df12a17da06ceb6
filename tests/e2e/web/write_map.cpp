// Writes a height map of 16 km in UTM, hills on a slope, for the example pages' test:  write_map FILE.tif
#include <cmath>

#include "tests/support/geo_tiff.h"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  ridgecast::testing_support::writeGeoTiff<std::uint16_t, 1>(argv[1], 800, 800, 20, [](int x, int z) {
    const double hills = 300 * std::sin(x * 0.031) * std::cos(z * 0.027) + 40 * std::sin(x * 0.19 + z * 0.23);
    return std::array{static_cast<std::uint16_t>(1200 + x + hills)};
  });
}
