#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <numbers>
#include <optional>
#include <random>

#include <jpeglib.h>

#include "server/earth/earth.h"
#include "server/map/mercator.h"
#include "server/map/picture.h"
#include "server/map/sheet.h"

namespace ridgecast::map {
namespace {

// The formula of map viewers: the tile of a place, with its fraction.
std::pair<double, double> tileOf(const Place& place, int level) {
  const double latitude = place.latitude * std::numbers::pi / 180, n = std::ldexp(1.0, level);
  return {(place.longitude + 180) / 360 * n, (1 - std::log(std::tan(latitude) + 1 / std::cos(latitude)) / std::numbers::pi) / 2 * n};
}

TEST(Mercator, TheWorldsOriginLiesAtItsPlace) {
  for (const Place& place : {Place{11.5, 47.25}, {-179.9, -84.9}, {0, 0}, {151.2, -33.9}})
    for (int level = 0; level <= kFinestTileLevel; ++level) {
      const auto [x, y] = tileOf(place, level);
      const TileAddress tile{level, static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)};
      const Sheet sheet = sheetOf(tile, place);
      EXPECT_EQ(sheet.columns, 256u);
      EXPECT_EQ(sheet.pitchX, sheet.pitchZ);
      const double column = (x - std::floor(x)) * 256 - 0.5, row = (y - std::floor(y)) * 256 - 0.5;
      // Doubles hold Mercator metres to 4e-9.
      EXPECT_NEAR(sheet.x + column * sheet.pitchX, 0, 1e-5 + sheet.pitchX * 1e-5) << level;
      EXPECT_NEAR(sheet.z + row * sheet.pitchZ, 0, 1e-5 + sheet.pitchZ * 1e-5) << level;
    }
}

TEST(Mercator, AMetreIsAMetreAtTheOrigin) {
  const Place place{11.5, 47.25};
  const Sheet sheet = sheetOf({14, 0, 0}, place);
  const double parallel = 2 * std::numbers::pi * 6'378'137 * std::cos(place.latitude * std::numbers::pi / 180);
  EXPECT_NEAR(sheet.pitchX / 256, parallel / 16384 / 256, 1e-6);
  EXPECT_GT(sheetOf({14, 1, 0}, place).x, sheet.x) << "east is +x";
  EXPECT_GT(sheetOf({14, 0, 1}, place).z, sheet.z) << "south is +z";
}

// They were a world apart: the tile behind the meridian was taken the long way round.
TEST(Mercator, NeighboursContinueEachOtherAcrossThe180thMeridian) {
  for (const Place& place : {Place{179.9, -16.5}, Place{-179.9, -16.5}}) {
    const Sheet a = sheetOf({8, 255, 140}, place), b = sheetOf({8, 0, 140}, place);
    EXPECT_NEAR(a.x + 256 * a.pitchX, b.x, 1e-3);
    EXPECT_LT(std::abs(b.x), 256 * b.pitchX);
  }
}

class Placed final : public terrain::Raster {
 public:
  const terrain::RasterShape& shape() const override { return shape_; }
  terrain::RasterOrigin origin() const override {
    terrain::RasterOrigin out;
    out.crs = crs_;
    out.easting = easting_;
    out.northing = northing_;
    return out;
  }
  std::string crs_ = "EPSG:32632";
  double easting_ = 800'000, northing_ = 5'240'000;
  void tile(terrain::TileAddress, terrain::Tile& out) const override { out.fill(0); }
  terrain::RasterShape shape_{
      .x = {-256'000, terrain::pitchOf(2560)}, .z = {-256'000, terrain::pitchOf(2560)}, .width = 201, .height = 201};
};

// 300 km east of its zone's meridian the grid is turned by 2.8 degrees: a tile of 12 km lay 600 m off.
TEST(Mercator, AMapsPixelsLieWhereItsGridHasThem) {
  const Placed map;
  const earth::Grid* const grid = earth::Grid::of("EPSG:32632", {800'000, 5'240'000});
  ASSERT_TRUE(grid);
  std::mt19937 random(4);
  for (const int level : {9, 11, 14, 18}) {
    const auto [x, y] = tileOf({12.96443, 47.24484}, level);
    const TileAddress tile{level, static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)}, east{level, tile.x + 1, tile.y};
    const auto sheet = sheetOf(tile, map), beside = sheetOf(east, map);
    ASSERT_TRUE(sheet && beside);
    for (std::size_t j = 0; j < sheet->nodesAcross(); ++j) {
      EXPECT_NEAR(sheet->nodes[(j + 1) * sheet->nodesAcross() - 1].x, beside->nodes[j * sheet->nodesAcross()].x, 1e-3);
      EXPECT_NEAR(sheet->nodes[(j + 1) * sheet->nodesAcross() - 1].z, beside->nodes[j * sheet->nodesAcross()].z, 1e-3);
    }
    for (int k = 0; k < 50; ++k) {
      const double column = random() % 256 + 0.5, row = random() % 256 + 0.5;
      const double longitude = std::ldexp(tile.x + column / 256, 1 - level) * 180 - 180;
      const double latitude =
          std::atan(std::sinh(std::numbers::pi * (1 - std::ldexp(tile.y + row / 256, 1 - level)))) * 180 / std::numbers::pi;
      const auto at = grid->at(longitude, latitude);
      ASSERT_TRUE(at);
      // Between nodes, by hand.
      const std::size_t n = sheet->nodesAcross(), i = static_cast<std::size_t>(column / 32), j = static_cast<std::size_t>(row / 32);
      const double s = column / 32 - static_cast<double>(i), t = row / 32 - static_cast<double>(j);
      const auto mix = [&](double Sheet::Node::*c) {
        const auto of = [&](std::size_t a, std::size_t b) { return sheet->nodes[b * n + a].*c; };
        return (of(i, j) * (1 - s) + of(i + 1, j) * s) * (1 - t) + (of(i, j + 1) * (1 - s) + of(i + 1, j + 1) * s) * t;
      };
      EXPECT_NEAR(mix(&Sheet::Node::x), (at->easting - 800'000) * 256, 0.02 * sheet->pitchX + 0.01) << level;
      EXPECT_NEAR(mix(&Sheet::Node::z), -(at->northing - 5'240'000) * 256, 0.02 * sheet->pitchZ + 0.01) << level;
    }
    EXPECT_FALSE(isBeside(*sheet, map.shape()));
    EXPECT_EQ(isBeside(*sheetOf({level, tile.x, tile.y + (1u << (level - 8))}, map), map.shape()), true);
  }
  EXPECT_FALSE(sheetOf({3, 6, 3}, map)) << "the grid does not reach there";
}

// Whatever tile is not beside the map lies within its bounds, and no side of them is farther out than the map.
TEST(Mercator, BoundsHoldTheWholeMapAndNoMore) {
  const Placed map;
  for (const std::optional<Place>& origin : {std::optional<Place>(), std::optional(Place{-70, -33})}) {
    const auto bounds = boundsOf(map.shape().area(), &map, origin);
    ASSERT_TRUE(bounds);
    double west = 180, south = 90, east = -180, north = -90;  // of pixels of the map
    const Place middle{(bounds->west + bounds->east) / 2, (bounds->south + bounds->north) / 2};
    const auto [x, y] = tileOf(middle, 15);
    for (int j = -12; j <= 12; ++j)
      for (int i = -12; i <= 12; ++i) {
        const TileAddress tile{15, static_cast<std::uint32_t>(x) + static_cast<std::uint32_t>(i),
                               static_cast<std::uint32_t>(y) + static_cast<std::uint32_t>(j)};
        const auto sheet = origin ? std::optional(sheetOf(tile, *origin, &map)) : sheetOf(tile, map);
        ASSERT_TRUE(sheet);
        for (std::size_t k = 0; k < sheet->nodes.size(); ++k) {
          const auto& node = sheet->nodes[k];
          if (std::abs(node.x) > 256'000 || std::abs(node.z) > 256'000) continue;
          const std::size_t across = k % sheet->nodesAcross(), down = k / sheet->nodesAcross();
          const double column = static_cast<double>(across) / 8, row = static_cast<double>(down) / 8;
          const double longitude = std::ldexp(tile.x + column, 1 - 15) * 180 - 180;
          const double latitude = std::atan(std::sinh(std::numbers::pi * (1 - std::ldexp(tile.y + row, 1 - 15)))) * 180 / std::numbers::pi;
          west = std::min(west, longitude), east = std::max(east, longitude);
          south = std::min(south, latitude), north = std::max(north, latitude);
        }
      }
    constexpr double kTiny = 1e-5, kNode = 360.0 / 32768 / 8;
    EXPECT_GE(west, bounds->west - kTiny);
    EXPECT_LE(east, bounds->east + kTiny);
    EXPECT_GE(south, bounds->south - kTiny);
    EXPECT_LE(north, bounds->north + kTiny);
    EXPECT_NEAR(west, bounds->west, 2 * kNode);
    EXPECT_NEAR(east, bounds->east, 2 * kNode);
    EXPECT_NEAR(south, bounds->south, 2 * kNode);
    EXPECT_NEAR(north, bounds->north, 2 * kNode);
  }
  const int finest = finestLevelOf(map.shape(), 47);
  const double pixel = sheetOf({finest, 0, 0}, Place{0, 47}).pitchX;
  EXPECT_LE(pixel, 2560);
  EXPECT_GT(pixel, 1280);
  Placed fiji;
  fiji.crs_ = "EPSG:32760";
  fiji.easting_ = 820'500;
  fiji.northing_ = 8'175'000;
  const auto crossed = boundsOf(fiji.shape().area(), &fiji, {});
  ASSERT_TRUE(crossed);
  EXPECT_EQ(crossed->west, -180);
  EXPECT_EQ(crossed->east, 180);
  EXPECT_NEAR(crossed->south, -16.5, 0.2);
  fiji.crs_ = "EPSG:1";
  EXPECT_FALSE(boundsOf(fiji.shape().area(), &fiji, {}));
  EXPECT_TRUE(boundsOf(fiji.shape().area(), &fiji, Place{1, 2}));
}

// Laid elsewhere by hand, it stays turned.
TEST(Mercator, AMapLaidElsewhereStaysTurned) {
  const Placed map;
  const Place place{-70, -33};
  const Sheet straight = sheetOf({12, 1251, 2448}, place), turned = sheetOf({12, 1251, 2448}, place, &map);
  const double length = std::hypot(straight.x - straight.pitchX / 2, straight.z - straight.pitchZ / 2);
  EXPECT_NEAR(std::hypot(turned.nodes[0].x, turned.nodes[0].z), length, 1e-6 * length);
  const double angle =
      std::atan2(turned.nodes[0].z, turned.nodes[0].x) - std::atan2(straight.z - straight.pitchZ / 2, straight.x - straight.pitchX / 2);
  EXPECT_NEAR(std::abs(angle), 2.83 * std::numbers::pi / 180, 0.1 * std::numbers::pi / 180);
}

TEST(Mercator, NeighboursContinueEachOther) {
  const Place place{11.5, 47.25};
  const Sheet a = sheetOf({12, 2177, 1436}, place), b = sheetOf({12, 2178, 1437}, place);
  EXPECT_NEAR(a.x + 256 * a.pitchX, b.x, 1e-3);
  EXPECT_NEAR(a.z + 256 * a.pitchZ, b.z, 1e-3);
}

TEST(Terrarium, IsWithinHalfAUnit) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> any(-32'768, 32'767);
  const auto decoded = [](const std::uint8_t* rgb) { return rgb[0] * 256.0 + rgb[1] + rgb[2] / 256.0 - 32'768; };
  std::uint8_t rgb[3];
  for (int k = 0; k < 100'000; ++k) {
    const float height = any(random);
    terrarium(height, rgb);
    ASSERT_LE(std::abs(decoded(rgb) - double{height}), 0.5 / 256) << height;
  }
  terrarium(1e6f, rgb);
  EXPECT_NEAR(decoded(rgb), 32'768, 1.0 / 256);
  terrarium(-1e6f, rgb);
  EXPECT_EQ(decoded(rgb), -32'768);
}

TEST(Sheets, HoldTheTerrainsHeights) {
  const auto terrain = terrain::create("alpine", 3).value();
  const Sheet sheet{-1000.4, 5e9 + 0.3, 700.25, 800.5, 30, 20};
  const auto all = heights(*terrain, sheet);
  ASSERT_EQ(all.size(), 600u);
  for (const auto& [column, row] : {std::pair{0, 0}, {29, 0}, {7, 13}, {29, 19}}) {
    const auto x = static_cast<lattice::Step>(std::llround(sheet.x + column * sheet.pitchX)),
               z = static_cast<lattice::Step>(std::llround(sheet.z + row * sheet.pitchZ));
    float height = 0;
    terrain->heights({&x, 1}, {&z, 1}, {&height, 1});
    EXPECT_EQ(all[30 * static_cast<std::size_t>(row) + static_cast<std::size_t>(column)], height);
  }
  std::stop_source stopped;
  stopped.request_stop();
  EXPECT_TRUE(heights(*terrain, sheet, stopped.get_token()).empty());
  EXPECT_TRUE(colours(*terrain, sheet, stopped.get_token()).empty());
}

// Colours are the terrain's, asked pixel by pixel.
TEST(Sheets, HoldTheTerrainsColours) {
  const auto terrain = terrain::create("archipelago", 3).value();
  const Sheet sheet{0, 0, 5120, 5120, 16, 8};
  const auto all = colours(*terrain, sheet);
  ASSERT_EQ(all.size(), 3u * 128);
  for (std::uint32_t row = 0; row < 8; ++row)
    for (std::uint32_t column = 0; column < 16; ++column) {
      const lattice::Step x = 5120 * column, z = 5120 * row;
      const lattice::Step xs[] = {x, x - 5120, x + 5120, x, x}, zs[] = {z, z, z, z - 5120, z + 5120};
      float h[5];
      terrain->heights(xs, zs, h);
      const float nx = (h[1] - h[2]) / 40, nz = (h[3] - h[4]) / 40, length = std::sqrt(nx * nx + 1 + nz * nz);
      const std::array<float, 3> normal{nx / length, 1 / length, nz / length};
      std::array<float, 3> colour{};
      terrain->colours()(&x, &z, h, &normal, 20, &colour, 1, 3);
      for (std::size_t c = 0; c < 3; ++c) {
        const double linear = std::clamp(double{colour[c]}, 0.0, 1.0);
        const double srgb = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
        EXPECT_NEAR(all[3 * (16 * row + column) + c], srgb * 255, 0.51);
      }
    }
}

std::vector<std::uint8_t> noise(std::uint32_t columns, std::uint32_t rows) {
  std::mt19937 random(7);
  std::vector<std::uint8_t> out(std::size_t{3} * columns * rows);
  for (auto& v : out) v = static_cast<std::uint8_t>(random());
  return out;
}

TEST(Pictures, APngHoldsItsPixels) {
  const auto pixels = noise(37, 21);
  const std::string file = png(pixels, 37, 21);
  EXPECT_EQ(file, png(pixels, 37, 21));
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_memory(&image, file.data(), file.size()));
  EXPECT_EQ(image.width, 37u);
  EXPECT_EQ(image.height, 21u);
  image.format = PNG_FORMAT_RGB;
  std::vector<std::uint8_t> read(PNG_IMAGE_SIZE(image));
  ASSERT_TRUE(png_image_finish_read(&image, nullptr, read.data(), 0, nullptr));
  EXPECT_EQ(read, pixels);
}

TEST(Pictures, AJpegIsClose) {
  std::vector<std::uint8_t> pixels(std::size_t{3} * 64 * 48);
  for (std::size_t k = 0; k < pixels.size(); ++k) pixels[k] = static_cast<std::uint8_t>(k / 3 % 64 * 3 + k % 3 * 20);
  const std::string file = jpeg(pixels, 64, 48);
  EXPECT_LT(file.size(), 3000u);
  jpeg_decompress_struct in{};
  jpeg_error_mgr errors{};
  in.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&in);
  jpeg_mem_src(&in, reinterpret_cast<const unsigned char*>(file.data()), file.size());
  jpeg_read_header(&in, TRUE);
  jpeg_start_decompress(&in);
  ASSERT_EQ(in.output_width, 64u);
  ASSERT_EQ(in.output_height, 48u);
  std::vector<std::uint8_t> row(std::size_t{3} * 64);
  for (std::size_t j = 0; j < 48; ++j) {
    JSAMPROW at = row.data();
    jpeg_read_scanlines(&in, &at, 1);
    for (std::size_t k = 0; k < row.size(); ++k) ASSERT_NEAR(row[k], pixels[3 * 64 * j + k], 12);
  }
  jpeg_finish_decompress(&in);
  jpeg_destroy_decompress(&in);
}

}  // namespace
}  // namespace ridgecast::map
