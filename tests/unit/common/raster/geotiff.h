#pragma once
// Writes GeoTIFFs by libtiff.

#include <gtest/gtest.h>
#include <tiffio.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iterator>
#include <vector>

namespace ridgecast::raster {

// A GeoTIFF; by default a picture of 120 x 90 pixels of half a metre.
struct Tiff {
  int width = 120, height = 90, bands = 3, bits = 8, packing = COMPRESSION_NONE, order = PLANARCONFIG_CONTIG;
  bool tiled = false, pixelsArePoints = false;
  int alpha = EXTRASAMPLE_UNASSALPHA;  // of a fourth band
  double across = 0.5, down = 0.5, west = 500'010, north = 4'600'100;
  std::uint16_t epsg = 32632;
  const char* noData = nullptr;
  std::function<int(int x, int z, int band)> sample = [](int x, int z, int band) { return (x * 37 + z * 91 + band * 55 + x * z) % 256; };
};

inline void write(const std::filesystem::path& file, const Tiff& t) {
  static const TIFFExtendProc before = TIFFSetTagExtender([](TIFF* f) {
    static char a[] = "scale", b[] = "tie", c[] = "none", d[] = "keys";
    static const TIFFFieldInfo fields[] = {{33550, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, a},
                                           {33922, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, b},
                                           {34735, -1, -1, TIFF_SHORT, FIELD_CUSTOM, 1, 1, d},
                                           {42113, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, c}};
    TIFFMergeFieldInfo(f, fields, std::size(fields));
  });
  (void)before;
  TIFF* f = TIFFOpen(file.c_str(), "w");
  ASSERT_TRUE(f);
  TIFFSetField(f, TIFFTAG_IMAGEWIDTH, t.width);
  TIFFSetField(f, TIFFTAG_IMAGELENGTH, t.height);
  TIFFSetField(f, TIFFTAG_SAMPLESPERPIXEL, t.bands);
  TIFFSetField(f, TIFFTAG_BITSPERSAMPLE, t.bits);
  TIFFSetField(f, TIFFTAG_COMPRESSION, t.packing);
  TIFFSetField(f, TIFFTAG_PHOTOMETRIC,
               t.bands < 3                     ? PHOTOMETRIC_MINISBLACK
               : t.packing == COMPRESSION_JPEG ? PHOTOMETRIC_YCBCR
                                               : PHOTOMETRIC_RGB);
  if (t.packing == COMPRESSION_JPEG) TIFFSetField(f, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
  TIFFSetField(f, TIFFTAG_PLANARCONFIG, t.order);
  const auto extra = static_cast<std::uint16_t>(t.alpha);
  if (t.bands == 4) TIFFSetField(f, TIFFTAG_EXTRASAMPLES, 1, &extra);
  const double scale[] = {t.across, t.down, 0}, tie[] = {0, 0, 0, t.west, t.north, 0};
  const std::uint16_t keys[] = {1, 1, 0, 2, 1025, 0, 1, static_cast<std::uint16_t>(t.pixelsArePoints ? 2 : 1), 3072, 0, 1, t.epsg};
  TIFFSetField(f, 33550, 3, scale);
  TIFFSetField(f, 33922, 6, tie);
  if (t.epsg) TIFFSetField(f, 34735, static_cast<int>(std::size(keys)), keys);
  if (t.noData) TIFFSetField(f, 42113, t.noData);
  const int wide = t.tiled ? 32 : t.width, high = t.tiled ? 16 : t.height;
  t.tiled ? (TIFFSetField(f, TIFFTAG_TILEWIDTH, wide), TIFFSetField(f, TIFFTAG_TILELENGTH, high))
          : TIFFSetField(f, TIFFTAG_ROWSPERSTRIP, high);
  for (int z = 0; z < t.height; z += high)
    for (int x = 0; x < t.width; x += wide) {
      std::vector<unsigned char> bytes;
      for (int k = 0; k < wide * high * t.bands; ++k) {
        const int pixel = k / t.bands,
                  v = t.sample(std::min(x + pixel % wide, t.width - 1), std::min(z + pixel / wide, t.height - 1), k % t.bands);
        bytes.push_back(static_cast<unsigned char>(v & 255));
        if (t.bits == 16) bytes.push_back(static_cast<unsigned char>(v >> 8));
      }
      const auto size = static_cast<tmsize_t>(bytes.size());
      const auto piece = t.tiled ? TIFFComputeTile(f, static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(z), 0, 0) : 0;
      ASSERT_GE(t.tiled ? TIFFWriteEncodedTile(f, piece, bytes.data(), size) : TIFFWriteEncodedStrip(f, 0, bytes.data(), size), 0);
    }
  TIFFClose(f);
}

}  // namespace ridgecast::raster
