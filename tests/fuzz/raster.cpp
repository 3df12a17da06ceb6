// A height map's file, or a picture's: the first byte chooses the format and the raw form, the rest is the file. Nothing crashes,
// and no claim makes it allocate.
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "common/raster/raster_file.h"

// GDAL's programs are not ours to fuzz.
extern "C" int LLVMFuzzerInitialize(int*, char***) { return setenv("PATH", "/nowhere", 1); }

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ridgecast;
  if (size < 1) return 0;
  static constexpr const char* kEndings[] = {".tif", ".png", ".r16", ".raw", ".asc", ".hgt"};
  const std::string file =
      "/dev/shm/N47E011-fuzz-raster-" + std::to_string(getpid()) + kEndings[data[0] & 32 ? 4 + data[0] % 2 : data[0] % 4];
  std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(data + 1), static_cast<std::streamsize>(size - 1));
  raster::RasterOptions options;
  options.bigEndian = data[0] & 4;
  options.isSigned = data[0] & 8;
  if (data[0] & 16) options.width = 3, options.height = 2;
  auto opened = data[0] & 64 ? raster::openLaid(file, data[0] & 128 ? raster::Content::kClasses : raster::Content::kColours)
                             : raster::openRaster(file, options);
  if (opened) {
    const raster::RasterHeader& header = (*opened)->header();
    if (header.width == 0 || header.height == 0) std::abort();
    std::vector<double> row(std::size_t{header.width} * header.bands);
    for (std::uint32_t j = 0; j < header.height && (*opened)->row(row); ++j) continue;
  } else if (opened.error().message.empty()) {
    std::abort();
  }
  std::filesystem::remove(file);
  return 0;
}
