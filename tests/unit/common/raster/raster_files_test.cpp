// Height maps from files: TIFF, PNG and raw rows, what is made of their samples, and how the grid goes on beyond them. TIFFs are written
// here by libtiff, PNGs and raw rows byte by byte.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiffio.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <random>

#include "common/process/scratch.h"
#include "common/raster/raster_terrain.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using testing::HasSubstr;

class RasterFiles : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& name) const { return scratch_->path() / name; }
  static std::shared_ptr<const terrain::Terrain> load(const std::filesystem::path& path, const std::vector<std::string>& options = {},
                                                      const MapLimits& limits = {}) {
    RasterOptions o;
    for (const std::string& option : options) EXPECT_TRUE(addRasterOption(option, o)) << option;
    auto loaded = loadRaster(path, o, 1, limits);
    EXPECT_TRUE(loaded) << loaded.error().message;
    return loaded ? *loaded : nullptr;
  }
  static std::string complaint(const std::filesystem::path& path, const std::vector<std::string>& options = {}) {
    RasterOptions o;
    for (const std::string& option : options) EXPECT_TRUE(addRasterOption(option, o)) << option;
    const auto loaded = loadRaster(path, o, 1);
    return loaded ? "it was loaded" : loaded.error().message;
  }
  // 16-bit rows, least byte first.
  void raw(const std::string& name, int width, int height, const std::function<int(int, int)>& sample) const {
    std::ofstream out(file(name), std::ios::binary);
    for (int z = 0; z < height; ++z)
      for (int x = 0; x < width; ++x) out.put(static_cast<char>(sample(x, z) & 255)).put(static_cast<char>(sample(x, z) >> 8 & 255));
  }
  struct Tiff {
    int width = 50, height = 40, bits = 32, format = SAMPLEFORMAT_IEEEFP, packing = COMPRESSION_NONE;
    bool tiled = false, geographic = true;
    std::vector<std::uint16_t> keys = {};  // code, value; those of the GeoKeyDirectory
    std::vector<double> transformation = {}, doubles = {};
    const char* noData = nullptr;
    std::function<double(int, int)> sample;
  };
  void tiff(const std::string& name, const Tiff& t) const {
    static const TIFFExtendProc before = TIFFSetTagExtender([](TIFF* f) {
      static char a[] = "scale", b[] = "tie", c[] = "none", d[] = "transformation", e[] = "keys", g[] = "doubles";
      static const TIFFFieldInfo fields[] = {
          {33550, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, a}, {33922, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, b},
          {34264, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, d}, {34735, -1, -1, TIFF_SHORT, FIELD_CUSTOM, 1, 1, e},
          {34736, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, g}, {42113, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, c}};
      TIFFMergeFieldInfo(f, fields, 6);
    });
    (void)before;
    TIFF* f = TIFFOpen(file(name).c_str(), "w");
    ASSERT_TRUE(f);
    TIFFSetField(f, TIFFTAG_IMAGEWIDTH, t.width);
    TIFFSetField(f, TIFFTAG_IMAGELENGTH, t.height);
    TIFFSetField(f, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(f, TIFFTAG_BITSPERSAMPLE, t.bits);
    TIFFSetField(f, TIFFTAG_SAMPLEFORMAT, t.format);
    TIFFSetField(f, TIFFTAG_COMPRESSION, t.packing);
    TIFFSetField(f, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(f, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    if (t.packing != COMPRESSION_NONE) TIFFSetField(f, TIFFTAG_PREDICTOR, t.format == SAMPLEFORMAT_IEEEFP ? 3 : 2);
    if (t.geographic) {
      const double scale[] = {30, 30, 0}, tie[] = {0, 0, 0, 500'000, 4'600'000, 0};
      TIFFSetField(f, 33550, 3, scale);
      TIFFSetField(f, 33922, 6, tie);
    }
    if (t.noData) TIFFSetField(f, 42113, t.noData);
    if (!t.transformation.empty()) TIFFSetField(f, 34264, 16, t.transformation.data());
    if (!t.doubles.empty()) TIFFSetField(f, 34736, static_cast<int>(t.doubles.size()), t.doubles.data());
    if (!t.keys.empty()) {
      std::vector<std::uint16_t> directory = {1, 1, 0, static_cast<std::uint16_t>(t.keys.size() / 2)};
      for (std::size_t k = 0; k < t.keys.size(); k += 2)
        directory.insert(directory.end(), {t.keys[k], static_cast<std::uint16_t>(t.keys[k] == 3077 ? 34736 : 0), 1, t.keys[k + 1]});
      TIFFSetField(f, 34735, static_cast<int>(directory.size()), directory.data());
    }
    const int wide = t.tiled ? 32 : t.width, high = t.tiled ? 16 : 1;
    t.tiled ? (TIFFSetField(f, TIFFTAG_TILEWIDTH, wide), TIFFSetField(f, TIFFTAG_TILELENGTH, high))
            : TIFFSetField(f, TIFFTAG_ROWSPERSTRIP, 7);
    for (int z = 0; z < t.height; z += high)
      for (int x = 0; x < t.width; x += wide) {
        std::vector<unsigned char> bytes;
        for (int k = 0; k < wide * high; ++k) {
          const double v = t.sample(std::min(x + k % wide, t.width - 1), std::min(z + k / wide, t.height - 1));
          const auto put = [&](auto value) {
            bytes.resize(bytes.size() + sizeof value);
            std::memcpy(&bytes[bytes.size() - sizeof value], &value, sizeof value);
          };
          if (t.format == SAMPLEFORMAT_IEEEFP)
            t.bits == 32 ? put(static_cast<float>(v)) : put(v);
          else
            t.bits == 16 ? put(static_cast<std::int16_t>(v)) : put(static_cast<std::int32_t>(v));
        }
        ASSERT_GE(t.tiled ? TIFFWriteTile(f, bytes.data(), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(z), 0, 0)
                          : TIFFWriteScanline(f, bytes.data(), static_cast<std::uint32_t>(z), 0),
                  0);
      }
    TIFFClose(f);
  }
  void png(const std::string& name, int width, int height, const std::function<int(int, int)>& sample) const {
    std::string rows;
    for (int z = 0; z < height; ++z) {
      rows.push_back('\0');
      for (int x = 0; x < width; ++x) rows.append({static_cast<char>(sample(x, z) >> 8), static_cast<char>(sample(x, z) & 255)});
    }
    std::string packed(rows.size() + 1000, '\0');
    uLongf size = packed.size();
    compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(rows.data()), rows.size());
    packed.resize(size);
    std::ofstream out(file(name), std::ios::binary);
    const auto big = [](std::uint32_t v) {
      return std::string{static_cast<char>(v >> 24), static_cast<char>(v >> 16), static_cast<char>(v >> 8), static_cast<char>(v)};
    };
    const auto chunk = [&](const std::string& body, std::size_t length) {
      out << big(static_cast<std::uint32_t>(length)) << body
          << big(static_cast<std::uint32_t>(crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()))));
    };
    out << "\x89PNG\r\n\x1a\n";
    chunk("IHDR" + big(static_cast<std::uint32_t>(width)) + big(static_cast<std::uint32_t>(height)) + std::string("\x10\0\0\0\0", 5), 13);
    chunk("IDAT" + packed, packed.size());
    chunk("IEND", 0);
  }

  std::optional<process::Scratch> scratch_ = process::Scratch::create().value();
};

double bumpy(int x, int z) { return 700 + 3.25 * x - 2.5 * z + ((x * 7 + z * 13) % 11); }

TEST_F(RasterFiles, aGeoTiffInEveryFormGivesItsHeightsAtItsPlace) {
  for (const bool tiled : {false, true})
    for (const int packing : {COMPRESSION_NONE, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_LZW})
      for (const int bits : {16, 32, 64}) {
        Tiff t{.bits = bits,
               .format = bits == 16 ? SAMPLEFORMAT_INT : SAMPLEFORMAT_IEEEFP,
               .packing = packing,
               .tiled = tiled,
               .sample = bumpy};
        tiff("map.tif", t);
        const auto terrain = load(file("map.tif"), {"place=geo"});
        ASSERT_TRUE(terrain);
        EXPECT_EQ(terrain->name(), "map");
        const terrain::RasterShape& shape = terrain->raster()->shape();
        EXPECT_EQ(shape.x.pitch, terrain::pitchOf(30 * 256));
        EXPECT_EQ(shape.x.origin, Step{500'015} * 256) << "easting of the first pixel's middle";
        EXPECT_EQ(shape.z.origin, -Step{4'599'985} * 256) << "north is -z";
        for (int z = 0; z < t.height; z += 3)
          for (int x = 0; x < t.width; x += 3) {
            const double expected = bits == 16 ? std::trunc(bumpy(x, z)) : bumpy(x, z);
            ASSERT_EQ(terrain->height({shape.x.of(x), shape.z.of(z)}), expected) << x << ", " << z;
          }
      }
}

TEST_F(RasterFiles, SaysWhatWasUnderstoodOfAMap) {
  tiff("map.tif", {.keys = {1024, 1, 3072, 32632}, .sample = [](int x, int z) { return 2.0 * x + z; }});
  EXPECT_EQ(describe(*load(file("map.tif"), {"edge=mirror"})->raster()),
            "50 x 40 samples, 30 m apart (1470 x 1170 m), 0 to 137 m high, EPSG:32632, middle at easting 500750, northing 4599400, "
            "edge mirror");
  tiff("own.tif", {.keys = {1024, 1, 3072, 32767, 3076, 9001}, .sample = bumpy});
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/nowhere", 1);
  EXPECT_THAT(describe(*load(file("own.tif"))->raster()), HasSubstr("edge clamp; its CRS has no EPSG number"));
  setenv("PATH", path.c_str(), 1);
  tiff("bare.tif", {.geographic = false, .sample = [](int, int) { return 3.5; }});
  EXPECT_EQ(describe(*load(file("bare.tif"), {"edge=-12.5"})->raster()),
            "50 x 40 samples, 1 m apart (49 x 39 m), -12.5 to 3.5 m high, edge -12.5");
}

TEST_F(RasterFiles, AGeoTiffInFeetIsConverted) {
  struct Case {
    std::vector<std::uint16_t> keys;
    double metres;
  };
  for (const Case& c : {Case{{1024, 1, 3076, 9001}, 1}, Case{{1024, 1, 3076, 9002}, 0.3048}, Case{{1024, 1, 3076, 9003}, 12 / 39.37},
                        Case{{1024, 1, 3076, 9036}, 1000}, Case{{1024, 1, 3076, 32767, 3077, 0}, 0.25}}) {
    tiff("map.tif", {.keys = c.keys, .doubles = {0.25}, .sample = bumpy});
    if (c.metres == 1000) {
      EXPECT_THAT(complaint(file("map.tif")), HasSubstr("that must be 0.0625 to 1024 m"));
      continue;
    }
    const auto terrain = load(file("map.tif"), {"place=geo"});
    ASSERT_TRUE(terrain);
    const terrain::RasterShape& shape = terrain->raster()->shape();
    EXPECT_NEAR(shape.x.metres(), 30 * c.metres, 2e-9) << c.metres;
    EXPECT_EQ(shape.x.origin, std::round(500'015 * c.metres * 256));
    EXPECT_EQ(shape.z.origin, std::round(-4'599'985 * c.metres * 256));
  }
  tiff("map.tif", {.keys = {1024, 1, 3076, 9084}, .sample = bumpy});
  EXPECT_THAT(complaint(file("map.tif")), HasSubstr("unit 9084 of the EPSG list"));
  EXPECT_THAT(complaint(file("map.tif"), {"pitch=2", "place=geo"}), HasSubstr("unit 9084 of the EPSG list"));
  EXPECT_EQ(load(file("map.tif"), {"pitch=2"})->raster()->shape().x.pitch, terrain::pitchOf(512));
}

// Of 10 cm, a third of a metre, a foot of the United States, and nearly square: rounded to whole steps, the far side of a map of 1 km lay
// up to 15 m off.
TEST_F(RasterFiles, SamplesLieWhereTheFileSaysThroughout) {
  for (const auto& [across, down] : {std::pair{0.1, 0.1}, {1.0 / 3, 1.0 / 3}, {12 / 39.37, 12 / 39.37}, {10, 10.009}, {0.5, 2}}) {
    const std::vector<double> place{across, 0, 0, 5000, 0, -down, 0, 8000, 0, 0, 0, 0, 0, 0, 0, 1};
    tiff("map.tif", {.width = 3000, .height = 2000, .geographic = false, .transformation = place, .sample = [](int x, int z) {
                       return 100 + 10 * std::sin(0.01 * x) + 10 * std::cos(0.013 * z);
                     }});
    const auto terrain = load(file("map.tif"), {"place=geo"});
    ASSERT_TRUE(terrain);
    const double steepest = 0.1 / across + 0.13 / down, off = steepest / 512 + 0.004;  // a step away at most, and half a step high
    for (const int z : {0, 1, 999, 1500, 1999})
      for (const int x : {0, 1, 1234, 2000, 2999}) {
        const double east = 5000 + (x + 0.5) * across, north = 8000 - (z + 0.5) * down;
        EXPECT_NEAR(terrain->height({std::llround(east * 256), std::llround(-north * 256)}),
                    100 + 10 * std::sin(0.01 * x) + 10 * std::cos(0.013 * z), off)
            << x << ", " << z << " of " << across << " x " << down;
      }
  }
  EXPECT_THAT(describe(*load(file("map.tif"))->raster()), HasSubstr("3000 x 2000 samples, 0.5 x 2 m apart (1499.5 x 3998 m)"));
}

TEST_F(RasterFiles, HeightsInFeetAreConvertedUnlessAScaleIsGiven) {
  const auto corner = [&](const std::vector<std::string>& options) {
    const auto terrain = load(file("map.tif"), options);
    return terrain ? terrain->height({-25 * 30 * 256, -20 * 30 * 256}) : 0;
  };
  tiff("map.tif", {.keys = {1024, 1, 3076, 9001, 4099, 9003}, .sample = bumpy});
  EXPECT_NEAR(corner({}), 700 * 12 / 39.37, 0.004);
  EXPECT_NEAR(corner({"scale=0.5"}), 350, 0.004);
  tiff("map.tif", {.keys = {1024, 1, 3076, 9001, 4099, 9002}, .sample = bumpy});
  EXPECT_NEAR(corner({}), 700 * 0.3048, 0.004);
  tiff("map.tif", {.keys = {1024, 1, 4099, 9001}, .sample = bumpy});
  EXPECT_TRUE(load(file("map.tif")));
}

TEST_F(RasterFiles, AModelTransformationPlacesTheMapOrIsRefused) {
  tiff("map.tif", {.geographic = false, .transformation = {10, 0, 0, 5000, 0, -10, 0, 8000, 0, 0, 0, 0, 0, 0, 0, 1}, .sample = bumpy});
  const auto terrain = load(file("map.tif"), {"place=geo"});
  ASSERT_TRUE(terrain);
  const terrain::RasterShape& shape = terrain->raster()->shape();
  EXPECT_EQ(shape.x.pitch, terrain::pitchOf(10 * 256));
  EXPECT_EQ(shape.x.origin, Step{5005} * 256) << "the first pixel's middle";
  EXPECT_EQ(shape.z.origin, -Step{7995} * 256);
  for (const auto& [a, b, e, f] : {std::array{8.0, 6.0, 6.0, -8.0}, std::array{10.0, 0.0, 0.0, 10.0}, std::array{10.0, 0.1, 0.0, -10.0}}) {
    tiff("map.tif", {.geographic = false, .transformation = {a, b, 0, 5000, e, f, 0, 8000, 0, 0, 0, 0, 0, 0, 0, 1}, .sample = bumpy});
    EXPECT_THAT(complaint(file("map.tif")), HasSubstr("its rows do not run east and its columns south: turn it (gdalwarp)"));
    EXPECT_THAT(complaint(file("map.tif"), {"pitch=10"}), HasSubstr("turn it (gdalwarp)"));
  }
}

TEST_F(RasterFiles, aPngAndRawRowsWithScaleAndOffsetLieAroundTheOrigin) {
  const auto sample = [](int x, int z) { return 20'000 + x * 17 - z * 5; };
  png("map.png", 65, 33, sample);
  raw("map.r16", 65, 33, sample);
  for (const std::string name : {"map.png", "map.r16"}) {
    const auto terrain = load(file(name), {"pitch=2", "scale=0.1", "offset=-1000", "size=65x33"});
    ASSERT_TRUE(terrain);
    for (int z = 0; z < 33; z += 4)
      for (int x = 0; x < 65; x += 4)
        ASSERT_NEAR(terrain->height({(x - 32) * 512, (z - 16) * 512}), sample(x, z) * 0.1 - 1000, 0.002) << name;
  }
  EXPECT_EQ(terrain::contentHash(*load(file("map.r16"), {"size=65x33"})), terrain::contentHash(*load(file("map.png"))));
  EXPECT_NE(terrain::contentHash(*load(file("map.png"))), terrain::contentHash(*load(file("map.png"), {"edge=mirror"})));
  EXPECT_NE(terrain::contentHash(*load(file("map.png"))), terrain::contentHash(*load(file("map.png"), {"scale=1.1"})));
}

TEST_F(RasterFiles, rawRowsInBothByteOrdersAndSigns) {
  std::ofstream(file("two.raw"), std::ios::binary) << std::string("\x01\x02\xff\xff\x00\x80\x00\x01", 8);
  const auto at = [](const terrain::Terrain& t, int x, int z) { return t.height({(x - 1) * 256, (z - 1) * 256}); };
  const auto little = load(file("two.raw"), {"scale=0.25"}), big = load(file("two.raw"), {"order=big", "type=signed", "scale=0.5"});
  EXPECT_THAT(complaint(file("two.raw")), HasSubstr("column 1, row 0 is 65535 m high"));
  EXPECT_EQ(at(*little, 0, 0), 0x201 * 0.25);
  EXPECT_EQ(at(*little, 1, 1), 64);
  EXPECT_EQ(at(*big, 0, 0), 0x102 * 0.5);
  EXPECT_EQ(at(*big, 1, 0), -0.5);
}

TEST(RasterEdge, foldsAsItsRuleSays) {
  for (const std::uint32_t n : {2u, 3u, 7u}) {
    for (std::int64_t k = -30; k < 30; ++k) {
      EXPECT_EQ(folded(k, n, Edge::kClamp), static_cast<std::uint32_t>(std::clamp<std::int64_t>(k, 0, n - 1)));
      EXPECT_EQ(folded(k, n, Edge::kRepeat), folded(k + n, n, Edge::kRepeat));
      EXPECT_EQ(folded(k, n, Edge::kMirror), folded(-k, n, Edge::kMirror));
      EXPECT_EQ(folded(k, n, Edge::kMirror), folded(2 * (std::int64_t{n} - 1) - k, n, Edge::kMirror));
      EXPECT_EQ(folded(k, n, Edge::kConstant).has_value(), k >= 0 && k < n);
      for (const Edge edge : {Edge::kClamp, Edge::kMirror, Edge::kRepeat, Edge::kConstant})
        if (k >= 0 && k < n) {
          EXPECT_EQ(folded(k, n, edge), static_cast<std::uint32_t>(k));
        }
    }
  }
}

TEST_F(RasterFiles, theGridGoesOnForEverAndTilesAreItsSamples) {
  raw("map.r16", 20, 30, [](int x, int z) { return 1000 + 31 * x + 7 * z; });
  for (const std::string edge : {"clamp", "mirror", "repeat", "-50"}) {
    const auto terrain = load(file("map.r16"), {"size=20x30", "pitch=10", "edge=" + edge});
    const terrain::RasterShape& shape = terrain->raster()->shape();
    auto tile = std::make_unique<terrain::Tile>();
    for (const std::int64_t far : {std::int64_t{0}, std::int64_t{-1}, std::int64_t{1'000'000}, std::int64_t{-2'000'000'000}}) {
      terrain->raster()->tile({far, -far}, *tile);
      for (std::int64_t k = 0; k < terrain::kTileSide; k += 9) {
        const lattice::Point p{shape.x.of(far * terrain::kTileSide + k), shape.z.of(-far * terrain::kTileSide + 5)};
        ASSERT_EQ(terrain->heightStep(p), (*tile)[static_cast<std::size_t>(5 * terrain::kTileSide + k)]) << edge << " " << far;
        ASSERT_GE(terrain->heightStep(p), shape.lowest);
        ASSERT_LE(terrain->heightStep(p), shape.highest);
      }
    }
  }
  EXPECT_EQ(load(file("map.r16"), {"size=20x30", "edge=-50"})->height({100'000'000, 0}), -50);
}

TEST_F(RasterFiles, aMapThatDoesNotFitIntoMemoryIsTheSame) {
  png("map.png", 300, 200, [](int x, int z) { return 5000 + (x * x + 31 * z) % 977; });
  std::mt19937 random(1);
  std::vector<Step> x(5000), z(5000);
  for (std::size_t k = 0; k < x.size(); ++k)
    x[k] = static_cast<Step>(random() % 100'000) - 50'000, z[k] = static_cast<Step>(random() % 100'000) - 50'000;
  std::vector<float> a(x.size()), b(x.size());
  load(file("map.png"))->heights(x, z, a);
  load(file("map.png"), {}, {.inMemory = 1000})->heights(x, z, b);  // the first is gone, so nothing is shared
  EXPECT_EQ(a, b);
}

TEST_F(RasterFiles, TerrainsOfOneMapShareItsSamples) {
  const auto sample = [](int x, int z) { return 100 + x * z % 77; };
  constexpr std::uint64_t kSamples = 64 * 32 * 4, kMap = kSamples + (8 * 4 + 2 * 1 + 1) * 8, kTwo = 2 * kMap;  // with ranges of blocks
  raw("map.r16", 64, 32, sample);
  const MapLimits limits{.inMemory = kMap, .total = kTwo};
  const auto open = [&](const std::string& name, std::uint32_t seed, const std::string& option) {
    RasterOptions o;
    EXPECT_TRUE(addRasterOption("size=64x32", o) && addRasterOption(option, o));
    return loadRaster(file(name), o, seed, limits);
  };
  std::vector<std::shared_ptr<const terrain::Terrain>> held;
  const std::uint64_t before = bytesOfMaps();
  for (std::uint32_t seed = 0; seed < 6; ++seed) held.push_back(open("map.r16", seed, "pitch=2").value());
  EXPECT_EQ(bytesOfMaps(), before + kMap);
  EXPECT_EQ(held[3]->seed(), 3u);
  EXPECT_EQ(terrain::contentHash(*held[1]), terrain::contentHash(*load(file("map.r16"), {"size=64x32", "pitch=2"})));

  held.push_back(open("map.r16", 1, "scale=2").value());  // other options, other samples
  EXPECT_EQ(bytesOfMaps(), before + kTwo);
  EXPECT_EQ(held.back()->height({0, 0}), 2 * held[0]->height({0, 0}));

  raw("other.r16", 64, 32, sample);
  const auto third = open("other.r16", 1, "pitch=2");
  ASSERT_FALSE(third);
  EXPECT_THAT(third.error().message, HasSubstr("takes 1 MB; with it the height maps in use would take more than 1 MB, the most"));
  held.erase(held.begin(), held.begin() + 6);
  EXPECT_TRUE(open("other.r16", 1, "pitch=2"));
  held.clear();
  EXPECT_EQ(bytesOfMaps(), before);
}

// A map that was written again is read again.
TEST_F(RasterFiles, AChangedMapIsNotShared) {
  raw("map.r16", 2, 2, [](int, int) { return 5; });
  const auto first = load(file("map.r16"));
  std::filesystem::remove(file("map.r16"));
  raw("map.r16", 2, 3, [](int, int) { return 9; });
  EXPECT_EQ(load(file("map.r16"), {"size=2x3"})->height({0, 0}), 9);
  EXPECT_EQ(first->height({0, 0}), 5);
}

TEST_F(RasterFiles, whatIsNoHeightIsReplacedOnlyWhenSaidSo) {
  Tiff t{.noData = "-32768", .sample = [](int x, int z) { return x == 4 && z == 2 ? NAN : x == 9 ? -32768 : 10; }};
  tiff("map.tif", t);
  EXPECT_THAT(complaint(file("map.tif")), HasSubstr("41 samples are missing (NoData), the first at column 9, row 0"));
  const auto terrain = load(file("map.tif"), {"nodata=-3"});
  const terrain::RasterShape& s = terrain->raster()->shape();
  EXPECT_EQ(terrain->height({s.x.of(4), s.z.of(2)}), -3);
  EXPECT_EQ(s.lowest, -3 * 256);
}

// Cut off anywhere, changed anywhere: a message or a map, never a crash.
TEST_F(RasterFiles, brokenFilesGiveAMessage) {
  tiff("map.tif", {.width = 20, .height = 16, .packing = COMPRESSION_ADOBE_DEFLATE, .tiled = true, .sample = bumpy});
  png("map.png", 20, 16, [](int x, int z) { return 100 + x * z; });
  std::mt19937 random(6);
  for (const std::string name : {"map.tif", "map.png"}) {
    std::string bytes(std::filesystem::file_size(file(name)), '\0');
    std::ifstream(file(name), std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    const std::filesystem::path broken = file("broken" + name.substr(3));
    for (std::size_t n = 0; n < bytes.size(); n += 1 + bytes.size() / 120) {
      std::ofstream(broken, std::ios::binary) << bytes.substr(0, n);
      const std::string said = complaint(broken);
      if (name == "map.tif") {
        EXPECT_THAT(said, HasSubstr("broken.tif: ")) << n;
      }
    }
    for (int round = 0; round < 250; ++round) {
      std::string changed = bytes;
      for (int k = 0; k < 3; ++k) changed[random() % changed.size()] = static_cast<char>(random());
      std::ofstream(broken, std::ios::binary) << changed;
      complaint(broken);
    }
  }
}

TEST_F(RasterFiles, OverviewsFollowUpToABoundAndEnd) {
  const auto withPages = [&](const std::string& name, int count) {
    tiff(name, {.width = 20, .height = 16, .sample = bumpy});
    TIFF* const f = TIFFOpen(file(name).c_str(), "a");
    ASSERT_TRUE(f);
    for (int page = 0; page < count; ++page) {
      TIFFSetField(f, TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE);
      TIFFSetField(f, TIFFTAG_IMAGEWIDTH, 1);
      TIFFSetField(f, TIFFTAG_IMAGELENGTH, 1);
      TIFFSetField(f, TIFFTAG_BITSPERSAMPLE, 8);
      TIFFSetField(f, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
      unsigned char sample = 1;
      ASSERT_EQ(TIFFWriteScanline(f, &sample, 0, 0), 1);
      ASSERT_EQ(TIFFWriteDirectory(f), 1);
    }
    TIFFClose(f);
  };
  withPages("map.tif", 63);
  EXPECT_EQ(complaint(file("map.tif")), "it was loaded");
  withPages("many.tif", 10'000);
  EXPECT_THAT(complaint(file("many.tif")), HasSubstr("many.tif: it has several pages"));

  // The last page's successor: the first page, which ends them as nothing does, or a place beyond the file.
  std::string bytes(std::filesystem::file_size(file("map.tif")), '\0');
  std::ifstream(file("map.tif"), std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  const auto read = [&](std::size_t at, auto value) {
    std::memcpy(&value, &bytes.at(at), sizeof value);
    return value;
  };
  const std::uint32_t first = read(4, std::uint32_t{});
  std::size_t successor = 4;
  while (const std::uint32_t page = read(successor, std::uint32_t{})) successor = page + 2u + 12u * read(page, std::uint16_t{});
  for (const std::uint32_t next : {first, 0x7fff'fff0u}) {
    std::memcpy(&bytes[successor], &next, sizeof next);
    std::ofstream(file("map.tif"), std::ios::binary) << bytes;
    EXPECT_THAT(complaint(file("map.tif")), HasSubstr(next == first ? "it was loaded" : "map.tif: its page 65 cannot be read"));
  }
}

TEST(RasterOptions, areCheckedOneByOne) {
  RasterOptions o;
  for (const std::string right : {"pitch=30", "scale=-0.1", "offset=5", "edge=mirror", "edge=0", "nodata=-5", "size=2x300", "order=big",
                                  "type=signed", "place=geo", "nodata=fill", "project=local"})
    EXPECT_TRUE(addRasterOption(right, o)) << right;
  for (const std::string wrong : {"",        "pitch",     "pitch=",       "pitch=0",    "pitch=nan",  "pitch=1e9",  "pitch=3m",
                                  "scale=0", "scale=inf", "edge=fold",    "edge=1e9",   "nodata=x",   "size=5",     "size=1x5",
                                  "size=5x", "size=-5x5", "order=middle", "type=float", "place=here", "colour=red", "project=utm"}) {
    const auto added = addRasterOption(wrong, o);
    ASSERT_FALSE(added) << wrong;
    EXPECT_THAT(added.error().message, HasSubstr("--raster")) << wrong;
  }
  EXPECT_TRUE(isRasterName("a/b.TIF") && isRasterName("x.tiff") && isRasterName("x.Png") && isRasterName("x.raw") &&
              isRasterName("x.r16") && isRasterName("x.asc") && isRasterName("N47E011.HGT"));
  EXPECT_FALSE(isRasterName("png") || isRasterName("x.glsl") || isRasterName("x.tif.glsl"));
}

}  // namespace
}  // namespace ridgecast::raster
