// Files as people's tools make them, made here by GDAL's programs: each is read right or refused in a sentence, never anything else. The
// same ground in all of them, its heights and places judged by the formula that it was made of.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <iomanip>
#include <sstream>
#include <string>
#include <vector>

#include "common/process/reach.h"
#include "common/raster/raster_terrain.h"
#include "tests/support/process.h"

namespace ridgecast::raster {
namespace {

using testing::HasSubstr;
using testing_support::runProgram;

constexpr int kWidth = 40, kHeight = 30;
constexpr double kWest = 680'000, kNorth = 5'240'300;  // UTM zone 32, pixels of 10 m

int ground(int x, int z) { return 1000 + 3 * x + 2 * z + static_cast<int>(std::lround(40 * std::sin(x * 0.7) * std::cos(z * 0.5))); }
bool isHole(int x, int z) { return x == 7 || (x > 30 && z > 20); }

// A file that is made by a script in a folder with these, and how it is read:
//   plain.tif   the ground, floats, EPSG:32632          int.tif   of 16 bits
//   holes.tif   -9999 where it is missing, as NoData    mask.tif  the same by a mask, 0 there
struct Case {
  std::string script;
  std::string file = "map.tif";
  std::string said = {};                                              // in the line at the start
  std::function<double(double)> height = [](double h) { return h; };  // metres of the ground's numbers
  std::vector<std::string> options = {"place=geo"};
  double unit = 1;        // metres a unit of the plane
  bool hasHoles = false;  // read as -50
  bool isPlaced = true;
};

class Maps : public testing::Test {
 protected:
  void SetUp() override {
    if (!testing_support::programExists("gdal_translate")) GTEST_SKIP() << "GDAL's programs are missing: ./run install test";
    for (const bool hasHoles : {false, true}) {
      std::ofstream out(folder_ / (hasHoles ? "holes.asc" : "plain.asc"));
      out << "ncols " << kWidth << "\nnrows " << kHeight << "\nxllcorner " << kWest << "\nyllcorner " << std::fixed << kNorth - 10 * kHeight
          << "\ncellsize 10\nnodata_value -9999\n";
      for (int z = 0; z < kHeight; ++z)
        for (int x = 0; x < kWidth; ++x) out << (hasHoles && isHole(x, z) ? -9999 : ground(x, z)) << (x + 1 < kWidth ? ' ' : '\n');
    }
    shell(
        "gdal_translate -q -a_srs EPSG:32632 -ot Float32 -a_nodata none plain.asc plain.tif; gdal_translate -q -ot Int16 plain.tif "
        "int.tif; "
        "gdal_translate -q -a_srs EPSG:32632 -ot Float32 holes.asc holes.tif; gdalwarp -q -dstalpha holes.tif alpha.tif; "
        "gdal_translate -q -b 1 -mask 2 --config GDAL_TIFF_INTERNAL_MASK YES alpha.tif mask.tif");
  }
  void shell(const std::string& script) const {
    const auto done = runProgram({"/bin/sh", "-ec", "cd '" + folder_.operator/("").string() + "'; " + script});
    ASSERT_EQ(done.code, 0) << script << "\n" << done.output;
  }
  Outcome<std::shared_ptr<const terrain::Terrain>> load(const std::string& file, const std::vector<std::string>& options) const {
    RasterOptions how;
    for (const std::string& option : options) EXPECT_TRUE(addRasterOption(option, how)) << option;
    return loadRaster(folder_ / file, how, 1);
  }
  std::string refusal(const std::string& script, const std::string& file = "map.tif", const std::vector<std::string>& options = {}) const {
    shell(script);
    const auto loaded = load(file, options);
    return loaded ? "it was loaded: " + describe(*(*loaded)->raster()) : loaded.error().message;
  }

  void judge(const Case& c) const {
    SCOPED_TRACE(c.script);
    shell("rm -rf map* && " + c.script);
    auto options = c.options;
    if (c.hasHoles) options.push_back("nodata=-50");
    const auto loaded = load(c.file, options);
    ASSERT_TRUE(loaded) << loaded.error().message;
    const terrain::Terrain& terrain = **loaded;
    const terrain::RasterShape& shape = terrain.raster()->shape();
    ASSERT_EQ(std::pair(shape.width, shape.height), std::pair(std::uint32_t{kWidth}, std::uint32_t{kHeight}));
    if (c.isPlaced) {
      EXPECT_NEAR(static_cast<double>(shape.x.origin) / 256, (kWest + 5) * c.unit, 0.003);
      EXPECT_NEAR(static_cast<double>(shape.z.origin) / 256, -(kNorth - 5) * c.unit, 0.003);
      EXPECT_NEAR(shape.x.metres(), 10 * c.unit, 1e-8);
    }
    for (int z = 0; z < kHeight; ++z)
      for (int x = 0; x < kWidth; ++x) {
        std::int32_t sample = 0;
        terrain.raster()->samples(x, z, 1, 1, &sample);
        ASSERT_NEAR(sample / 256.0, c.hasHoles && isHole(x, z) ? -50 : c.height(ground(x, z)), 0.003) << x << ", " << z;
      }
    EXPECT_THAT(describe(*terrain.raster()), HasSubstr(c.said));
  }

  testing_support::ScratchFolder folder_;
};

TEST_F(Maps, MasksAreHoles) {
  for (Case c : {
           Case{"cp holes.tif map.tif"},
           Case{"cp mask.tif map.tif", "map.tif", "read by GDAL as GTiff: mask"},
           Case{"cp alpha.tif map.tif", "map.tif", "mask"},
           Case{"gdal_translate -q -b 1 -mask 2 --config GDAL_TIFF_INTERNAL_MASK NO alpha.tif map.tif", "map.tif", "mask"},
           Case{"gdal_translate -q -co TILED=YES -co COMPRESS=LZW --config GDAL_TIFF_INTERNAL_MASK YES mask.tif map.tif"},
           Case{"gdal_translate -q -of COG -co COMPRESS=DEFLATE --config GDAL_TIFF_INTERNAL_MASK YES mask.tif map.tif"},
           Case{"gdal_translate -q -of VRT holes.tif map.vrt", "map.vrt", "read by GDAL as VRT"},
           Case{"gdal_translate -q -of VRT mask.tif map.vrt", "map.vrt"},
           Case{"gdal_translate -q -of VRT alpha.tif map.vrt", "map.vrt"},
           Case{.script = "gdal_translate -q -ot UInt16 alpha.tif map.png -of PNG", .file = "map.png", .isPlaced = false},
           Case{"gdal_translate -q -ot UInt16 -a_nodata 0 -b 1 alpha.tif map.png -of PNG", "map.png"},
           Case{"gdalwarp -q -dstnodata nan holes.tif map.tif"},
           Case{.script = "gdal_translate -q -a_nodata none holes.tif map.tif", .options = {"place=geo", "missing=-9999"}},
           Case{.script = "gdal_translate -q -ot UInt16 -a_nodata none holes.tif map.tif", .options = {"place=geo", "missing=0"}},
           Case{"gdal_translate -q -of HFA holes.tif map.img", "map.img"},
           Case{"gdal_translate -q -co PROFILE=BASELINE holes.tif map.tif; test -f map.tif.aux.xml"},
           Case{"gdal_translate -q -of EHdr holes.tif map.flt", "map.flt"},
           Case{"gdal_translate -q -of AAIGrid holes.tif map.asc", "map.asc"},
           Case{"gdal_translate -q -of AAIGrid holes.tif map.asc; rm map.prj; sed -i 's/-9999/nan/g' map.asc", "map.asc"},
           Case{"gdal_translate -q -of AAIGrid holes.tif map.asc; rm map.prj; sed -i 's/-9999/NaN/g; /NODATA/d' map.asc", "map.asc"},
           Case{"gdal_translate -q -of netCDF holes.tif map.nc", "map.nc"},
           Case{"gdal_translate -q -of GSBG holes.tif map.grd", "map.grd"},
           Case{"gdal_translate -q -of SAGA holes.tif map.sdat", "map.sdat"},
           Case{"gdal_translate -q -of RST holes.tif map.rst", "map.rst"},
           Case{"gdal_translate -q -ot Int32 -co COMPRESS=LERC holes.tif map.tif"},
           Case{"gdal_translate -q -ot Float64 -co COMPRESS=ZSTD -co PREDICTOR=3 holes.tif map.tif"},
           Case{"gdal_translate -q -co BIGTIFF=YES -co ENDIANNESS=BIG -co TILED=YES -co BLOCKXSIZE=16 -co BLOCKYSIZE=16 "
                "holes.tif map.tif"},
           Case{"gdal_translate -q -co TILED=YES -co BLOCKXSIZE=16 -co BLOCKYSIZE=16 -co SPARSE_OK=YES holes.tif map.tif"},
           Case{"gdal_translate -q holes.tif map.tif; gdaladdo -q -r average map.tif 2 4"},
           Case{"gdal_translate -q holes.tif map.tif; gdaladdo -q -ro map.tif 2 4; test -f map.tif.ovr"},
       }) {
    c.hasHoles = true;
    judge(c);
  }
}

// While somebody uses it: a map is read once, but a source that has another content makes another map.
TEST_F(Maps, VirtualMapsAndFoldersAreReadAgainWhenASourceChanges) {
  shell("rm -rf map* && mkdir mapdir && cp plain.tif mapdir/a.tif && gdal_translate -q -of VRT plain.tif map.vrt");
  for (const auto& [file, source] : {std::pair{"map.vrt", "plain.tif"}, {"mapdir", "mapdir/a.tif"}}) {
    SCOPED_TRACE(file);
    const auto first = load(file, {"place=geo"}), second = load(file, {"place=geo"});
    ASSERT_TRUE(first && second) << first.error().message;
    EXPECT_EQ((*first)->raster()->shape().content, (*second)->raster()->shape().content);
    shell("cp " + std::string(source) + " kept.tif; gdal_translate -q -scale 0 1000 1 1001 -ot Float32 kept.tif new.tif; mv new.tif " +
          std::string(source));
    const auto changed = load(file, {"place=geo"});
    ASSERT_TRUE(changed);
    EXPECT_EQ((*changed)->raster()->shape().lowest, (*first)->raster()->shape().lowest + 256);
    shell("mv kept.tif " + std::string(source));
  }
}

// Interpolated with -9999 as a height, as tools do that do not know of it, and then said to have holes again.
TEST_F(Maps, SamplesMixedWithNoDataCountAsMissing) {
  // A hole of 100 m x 90 m.
  shell(
      "gdal_translate -q -a_nodata none plain.tif bare.tif; gdal_translate -q -srcwin 20 10 10 9 -scale 0 9999 -9999 -9999 plain.tif "
      "hole.tif; gdalwarp -q hole.tif bare.tif");
  for (const char* how : {"bilinear", "cubic", "lanczos"}) {
    shell("rm -rf map* && gdalwarp -q -overwrite -r " + std::string(how) +
          " -te 680003 5240004 680397 5240296 -tr 10 10 -srcnodata none bare.tif map.tif");
    for (const char* nodata : {"nodata=fill", "nodata=-50"}) {
      const auto loaded = load("map.tif", {"missing=-9999", nodata});
      ASSERT_TRUE(loaded) << loaded.error().message;
      EXPECT_THAT(describe(*(*loaded)->raster()), HasSubstr("samples beside missing ones were interpolated with the NoData value")) << how;
      EXPECT_GE((*loaded)->raster()->shape().lowest, (nodata == std::string("nodata=fill") ? 900 : -50) * 256) << how;
      EXPECT_LE((*loaded)->raster()->shape().highest, 1300 * 256) << how;
    }
  }
  // A rim that is steep and no more is the ground's own.
  shell("gdal_translate -q holes.tif map.tif");
  const auto loaded = load("map.tif", {"nodata=fill"});
  ASSERT_TRUE(loaded);
  EXPECT_THAT(describe(*(*loaded)->raster()), testing::Not(HasSubstr("beside missing")));
}

TEST_F(Maps, UnitsScalesAndOffsetsAreApplied) {
  const auto feet = [](double h) { return h * 0.3048; };
  const auto surveyFeet = [](double h) { return h * 12 / 39.37; };
  const auto scaled = [](double h) { return h * 0.1 - 500; };
  const std::string unit =
      "gdal_translate -q -of VRT plain.tif map0.vrt; sed 's|<ColorInterp>|<UnitType>UNIT</UnitType>&|' map0.vrt > map.vrt; ";
  const auto inUnit = [&](const std::string& name, const std::string& more) {
    std::string script = unit;
    return script.replace(script.find("UNIT<"), 4, name) + more;
  };
  for (const Case& c : {
           Case{"gdal_translate -q -a_srs EPSG:32632+6360 plain.tif map.tif", "map.tif", "", surveyFeet},
           Case{"gdal_translate -q -a_srs EPSG:32632+8228 plain.tif map.tif", "map.tif", "", feet},
           Case{"gdal_translate -q -a_srs EPSG:32632+5703 plain.tif map.tif"},
           Case{"gdal_translate -q -a_srs EPSG:32632+7837 plain.tif map.tif"},
           Case{inUnit("ft", "true"), "map.vrt", "ft to metres", feet},
           Case{inUnit("US survey foot", "gdal_translate -q map.vrt map.tif"), "map.tif", "US survey foot to metres", surveyFeet},
           Case{inUnit("m", "gdal_translate -q map.vrt map.tif")},
           Case{inUnit("dm", "gdal_translate -q map.vrt map.tif"), "map.tif", "", [](double h) { return h / 10; }},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 int.tif map.tif", "map.tif", "scale 0.1, offset -500", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -ot Float32 int.tif map.tif", "map.tif", "", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -of VRT int.tif map.vrt", "map.vrt", "", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -ot UInt16 -of PNG int.tif map.png", "map.png", "", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -of HFA int.tif map.img", "map.img", "", scaled},
           Case{.script = "gdal_translate -q -a_srs EPSG:2263 plain.tif map.tif", .unit = 12 / 39.37},
           Case{.script = "gdal_translate -q -a_srs EPSG:2263+6360 plain.tif map.tif", .height = surveyFeet, .unit = 12 / 39.37},
           Case{.script = "gdal_translate -q -a_srs EPSG:2222 plain.tif map.tif", .unit = 0.3048},
           Case{"gdal_translate -q -a_srs '+proj=utm +zone=25 +south +ellps=intl +towgs84=-206,172,-6,0,0,0,0 +units=m' "
                "plain.tif map.tif",
                "map.tif", "+proj=utm +zone=25 +south +ellps=intl +towgs84=-206,172,-6,0,0,0,0"},
           Case{"gdal_translate -q -a_srs EPSG:2056 plain.tif map.tif"},
           Case{.script = "gdal_translate -q -a_srs EPSG:2263 -of VRT plain.tif map.vrt",
           .file = "map.vrt",
           .said = "us-ft",
           .unit = 12 / 39.37},
           Case{.script = inUnit("ft", "true"),
           .file = "map.vrt",
           .height = [](double h) { return 2 * h; },
           .options = {"place=geo", "scale=2"}},
           Case{.script = "gdal_translate -q -a_srs EPSG:2225+6360 plain.tif map.tif", .height = surveyFeet, .unit = 12 / 39.37},
           Case{"gdal_translate -q -a_srs EPSG:32632+6360 -of VRT plain.tif map.vrt", "map.vrt", "us-ft to metres", surveyFeet},
           Case{"gdal_translate -q -a_srs EPSG:32632+8228 -of VRT plain.tif map.vrt", "map.vrt", "", feet},
           Case{"gdal_translate -q -a_srs EPSG:32632+5773 -of VRT plain.tif map.vrt", "map.vrt"},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -co PROFILE=BASELINE int.tif map.tif; test -f map.tif.aux.xml", "map.tif",
                "", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -of netCDF int.tif map.nc", "map.nc", "", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -of EHdr int.tif map.bil", "map.bil", "", scaled},
           Case{"gdal_translate -q -a_scale 0.1 -a_offset -500 -of COG int.tif map.tif", "map.tif", "", scaled},
       })
    judge(c);
  EXPECT_THAT(refusal(inUnit("hPa", "true"), "map.vrt"), HasSubstr("its heights are in \"hPa\": say how many metres that is"));
}

TEST_F(Maps, FilesBesideTheMapSayWhereItLies) {
  for (const Case& c : {
           Case{"gdal_translate -q -co TFW=YES -co PROFILE=BASELINE plain.tif map.tif; rm -f map.tif.aux.xml"},
           Case{"gdal_translate -q -co TFW=YES -co PROFILE=BASELINE plain.tif map.tif; rm map.tif.aux.xml; mv map.tfw map.TFW"},
           Case{"gdal_translate -q -co TFW=YES -co PROFILE=BASELINE plain.tif map.tif; rm map.tif.aux.xml; mv map.tfw map.wld"},
           Case{"gdal_translate -q -co PROFILE=BASELINE plain.tif map.tif; test -f map.tif.aux.xml"},
           Case{"gdal_translate -q -of PNG -ot UInt16 plain.tif map.png; test -f map.png.aux.xml", "map.png"},
           Case{"gdal_translate -q -of PNG -ot UInt16 -co WORLDFILE=YES plain.tif map.png; rm map.png.aux.xml; mv map.wld map.pgw",
                "map.png"},
           Case{"gdal_translate -q -of PNG -ot UInt16 -co WORLDFILE=YES plain.tif map.png; rm map.png.aux.xml", "map.png"},
           Case{"gdal_translate -q -of AAIGrid plain.tif map.asc; test -f map.prj", "map.asc", "read by GDAL as AAIGrid"},
           Case{.script = "gdal_translate -q -of PNG -ot UInt16 plain.tif map.png; rm map.png.aux.xml",
           .file = "map.png",
           .options = {},
           .isPlaced = false},
           Case{"cp plain.tif map.tif; gdalinfo -stats map.tif > /dev/null; test -f map.tif.aux.xml"},
           Case{"gdal_translate -q -co TFW=YES -co PROFILE=BASELINE plain.tif map.tif; rm map.tif.aux.xml; mv map.tfw map.tifw"},
           Case{"gdal_translate -q -of PNG -ot UInt16 -co WORLDFILE=YES plain.tif map.png; rm map.png.aux.xml; mv map.wld map.pngw",
                "map.png"},
           Case{"gdal_translate -q -of AAIGrid plain.tif map.asc; rm map.prj", "map.asc"},
           Case{"gdal_translate -q -of AAIGrid plain.tif map.asc; sed -i 's/$/\\r/' map.asc", "map.asc"},
           Case{"gdal_translate -q -of AAIGrid plain.tif map.asc; rm map.prj; sed -i 's/xllcorner.*/XLLCENTER 680005/; "
                "s/yllcorner.*/YLLCENTER 5240005/' map.asc",
                "map.asc"},
           Case{"gdal_translate -q -of AAIGrid plain.tif map.asc; sed -i 's/cellsize.*/dx 10\\ndy 10/' map.asc", "map.asc"},
       })
    judge(c);
}

TEST_F(Maps, OtherFormatsAreRead) {
  for (const Case& c : {
           Case{"cp plain.tif map.geotiff", "map.geotiff"},
           Case{"gdal_translate -q -of HFA plain.tif map.img", "map.img", "HFA"},
           Case{"gdal_translate -q -of EHdr plain.tif map.bil", "map.bil"},
           Case{"gdal_translate -q -of EHdr int.tif map.bil", "map.bil"},
           Case{"gdal_translate -q -of ENVI plain.tif map.dat", "map.dat"},
           Case{"gdal_translate -q -of GSBG plain.tif map.grd", "map.grd"},
           Case{"gdal_translate -q -of RST plain.tif map.rst", "map.rst"},
           Case{"gdal_translate -q -of netCDF plain.tif map.nc", "map.nc"},
           Case{"gdal_translate -q -of JP2OpenJPEG -ot UInt16 -co REVERSIBLE=YES -co QUALITY=100 plain.tif map.jp2", "map.jp2"},
           Case{.script = "gdal_translate -q -of PNM -ot UInt16 plain.tif map.pgm", .file = "map.pgm", .options = {}, .isPlaced = false},
           Case{"gdal_translate -q -of XYZ plain.tif map.xyz", "map.xyz"},
           Case{"mkdir map; gdal_translate -q -srcwin 0 0 20 30 plain.tif map/a.tif; gdal_translate -q -srcwin 20 0 20 30 "
                "plain.tif map/b.tif",
                "map", "2 files"},
           Case{"mkdir map; for x in 0 10 20 30; do for y in 0 15; do gdal_translate -q -srcwin $x $y 10 15 -ot Int16 plain.tif "
                "map/$x.$y.tif; done; done",
                "map/", "8 files"},
           Case{.script = "mkdir map; gdal_translate -q -srcwin 0 0 20 30 holes.tif map/a.tif; gdal_translate -q -srcwin 20 0 20 30 "
                          "holes.tif map/b.tif",
           .file = "map",
           .said = "2 files",
           .hasHoles = true},
           Case{"gdal_translate -q -srcwin 0 0 20 30 plain.tif mapa.tif; gdal_translate -q -srcwin 20 0 20 30 plain.tif "
                "mapb.tif; gdalbuildvrt -q map.vrt mapa.tif mapb.tif",
                "map.vrt"},
           Case{"gdal_translate -q -co NBITS=12 -ot UInt16 plain.tif map.tif"},
           Case{"gdal_translate -q -of BT plain.tif map.bt", "map.bt"},
           Case{"gdal_translate -q -of PCIDSK plain.tif map.pix", "map.pix"},
           Case{"gdal_translate -q -of ILWIS plain.tif map.mpr", "map.mpr"},
           Case{"gdal_translate -q -of GPKG -co TILE_FORMAT=TIFF plain.tif map.gpkg", "map.gpkg"},
           Case{"gdal_translate -q -of GS7BG plain.tif map.grd", "map.grd"},
           Case{"gdal_translate -q -of GSAG plain.tif map.grd", "map.grd"},
           Case{.script = "gdal_translate -q -of KRO plain.tif map.kro", .file = "map.kro", .options = {}, .isPlaced = false},
           Case{"gdal_translate -q -of ZMap plain.tif map.zmap", "map.zmap"},
           Case{"cp plain.tif map.TIFF", "map.TIFF"},
           Case{"gdalbuildvrt -q -addalpha map.vrt plain.tif", "map.vrt"},
           Case{"gdalwarp -q -of VRT plain.tif map.vrt", "map.vrt"},
           Case{"gdal_translate -q -of VRT plain.tif mapin.vrt; gdal_translate -q -of VRT mapin.vrt map.vrt", "map.vrt"},
       })
    judge(c);
  EXPECT_THAT(refusal("rm -rf map; mkdir map", "map"), HasSubstr("there is no height map in this folder"));
}

// Pitches that are no whole number of steps.
TEST_F(Maps, PitchesAreThoseOfTheFile) {
  const double foot = 0.03048, surveyFoot = 1.2 / 39.37;
  const auto sized = [](double unit, const std::string& more) {
    std::ostringstream out;
    out << std::setprecision(17) << "gdal_translate -q -a_ullr " << kWest * unit << ' ' << kNorth * unit << ' '
        << (kWest + 10 * kWidth) * unit << ' ' << (kNorth - 10 * kHeight) * unit << " plain.tif " << more;
    return out.str();
  };
  for (const double unit : {0.01, 0.02, 1.0 / 30, foot, surveyFoot, 1.0009})
    for (const auto& [how, file] : {std::pair{"map.tif", "map.tif"}, {"-of VRT map.vrt", "map.vrt"}, {"-of HFA map.img", "map.img"}})
      judge({.script = sized(unit, how), .file = file, .unit = unit});
}

// Packed more than 2,000 times: a sea with an island.
TEST_F(Maps, WellPackedFilesAreWhole) {
  for (const std::string packing : {"ZSTD", "LZMA", "DEFLATE -co ZLEVEL=9", "LERC"}) {
    shell("gdal_translate -q -ot Float32 -outsize 3000 3000 -r near -scale 0 1 0 0 -co COMPRESS=" + packing + " plain.tif map.tif");
    const auto loaded = load("map.tif", {"pitch=1"});
    ASSERT_TRUE(loaded) << packing << ": " << loaded.error().message;
    EXPECT_EQ((*loaded)->height({0, 0}), 0);
  }
}

TEST_F(Maps, WhatIsNotInMetresOnTheGroundIsRefusedWithWhatToDo) {
  for (const char* crs : {"3857", "3395", "3785"}) {
    EXPECT_THAT(refusal(std::string("gdal_translate -q -a_srs EPSG:") + crs + " plain.tif map.tif"),
                testing::AllOf(HasSubstr("Mercator"), HasSubstr("gdalwarp -t_srs EPSG:326")));
    EXPECT_THAT(refusal(std::string("gdal_translate -q -of VRT -a_srs EPSG:") + crs + " plain.tif map.vrt", "map.vrt"),
                HasSubstr("Mercator"));
  }
  EXPECT_THAT(refusal("gdal_translate -q -a_srs '+proj=merc +lon_0=10 +datum=WGS84' plain.tif map.tif"), HasSubstr("Mercator"));
  for (const auto& [how, file] : {std::pair{"map.tif", "map.tif"}, {"-of VRT map.vrt", "map.vrt"}, {"-of HFA map.img", "map.img"}})
    EXPECT_THAT(refusal(std::string("rm -f map*; gdal_translate -q -a_srs EPSG:4806 -a_ullr 1 45 2 44 plain.tif ") + how, file),
                HasSubstr("Greenwich"));
  for (const char* first : {"", "-outsize 50% 50%"})
    EXPECT_THAT(refusal(std::string("rm -f map*; gdal_translate -q ") + first +
                        " plain.tif map.tif; gdal_translate -q -co APPEND_SUBDATASET=YES -outsize 25% 25% plain.tif map.tif"),
                HasSubstr("it has several pages: take one of them"));
  const std::string pacific = "gdal_translate -q -a_srs EPSG:4326 -a_ullr 232 50 233 49 plain.tif map.tif";
  EXPECT_THAT(refusal(pacific), HasSubstr("UTM zone 9 north (gdalwarp -t_srs EPSG:32609)"));
  EXPECT_THAT(refusal("gdal_translate -q -a_srs EPSG:4326 -a_ullr 232 50 233 49 -of VRT plain.tif map.vrt", "map.vrt"),
              HasSubstr("EPSG:32609"));
  EXPECT_THAT(refusal("gdal_translate -q -a_srs EPSG:4326 -a_ullr 232 50 233 49 -of netCDF plain.tif map.nc", "map.nc"),
              HasSubstr("EPSG:32609"));
  EXPECT_THAT(refusal("gdal_translate -q -gcp 0 0 1 1 1 -gcp 9 0 2 1 1 -gcp 0 9 1 2 1 plain.tif map.tif"), HasSubstr("not how far apart"));
  EXPECT_THAT(refusal("gdal_translate -q -b 1 -b 1 plain.tif map.tif"), HasSubstr("2 bands"));
  EXPECT_THAT(refusal("gdal_translate -q -b 1 -b 1 -of VRT plain.tif map.vrt", "map.vrt"), HasSubstr("2 bands"));
  EXPECT_THAT(refusal("gdal_translate -q -ot UInt16 -scale 0 2000 65535 65535 plain.tif map.tif"), HasSubstr("missing=65535"));
  EXPECT_THAT(refusal("gdal_translate -q -ot CFloat32 -of VRT plain.tif map.vrt", "map.vrt"), HasSubstr("complex"));
  EXPECT_THAT(refusal("printf 'no map' > map.bin", "map.bin"), HasSubstr("GDAL cannot read it"));
  for (const std::string archive : {"map.zip", "map.tar.gz", "map.tgz"})
    EXPECT_THAT(refusal("tar czf " + archive + " plain.tif", archive), HasSubstr("this is an archive: unpack it"));
  EXPECT_THAT(
      refusal("printf 'ncols 4\\nnrows 2\\nxllcorner -20\\nyllcorner 40\\ncellsize 0.25\\n1 2 3 4\\n5 6 7 8\\n' > map.asc", "map.asc"),
      HasSubstr("degrees or metres"));
}

// A picture of one colour on the western half; on the eastern one it is masked, and the map keeps its own.
TEST_F(Maps, PicturesAreMaskedAsTheirFilesSay) {
  shell(
      "for c in 200 100 50; do gdal_translate -q -ot Byte -scale 0 1 $c $c -a_nodata none plain.tif $c.tif; done; "
      "gdal_translate -q -ot Byte -scale 0 1 255 255 -srcwin 0 0 20 30 plain.tif west.tif; gdalbuildvrt -q -te 680000 5240000 680400 "
      "5240300 a.vrt west.tif; "
      "gdalbuildvrt -q -separate rgba.vrt 200.tif 100.tif 50.tif a.vrt; "
      "for c in 200 100 50; do gdal_translate -q -srcwin 0 0 20 30 $c.tif w$c.tif; gdalbuildvrt -q -te 680000 5240000 680400 5240300 "
      "b$c.vrt "
      "w$c.tif; done; gdalbuildvrt -q -separate black.vrt b200.vrt b100.vrt b50.vrt a.vrt; "
      "gdal_translate -q -co PHOTOMETRIC=RGB -co ALPHA=YES rgba.vrt rgba.tif; "
      "gdal_translate -q -b 1 -b 2 -b 3 -mask 4 -co PHOTOMETRIC=RGB --config GDAL_TIFF_INTERNAL_MASK YES rgba.tif masked.tif");
  for (const std::string script :
       {"cp rgba.tif drape.tif", "gdal_translate -q -of VRT rgba.tif drape.vrt", "cp masked.tif drape.tif",
        "gdal_translate -q -b 1 -b 2 -b 3 -mask 4 -co PHOTOMETRIC=RGB rgba.tif drape.tif --config GDAL_TIFF_INTERNAL_MASK NO",
        "gdal_translate -q -co COMPRESS=JPEG -co JPEG_QUALITY=100 -co PHOTOMETRIC=YCBCR --config GDAL_TIFF_INTERNAL_MASK YES masked.tif "
        "drape.tif",
        "gdal_translate -q -co COMPRESS=JPEG -co TILED=YES -co JPEG_QUALITY=100 -co PHOTOMETRIC=YCBCR --config GDAL_TIFF_INTERNAL_MASK NO "
        "masked.tif drape.tif",
        "gdal_translate -q -ot UInt16 -scale 0 255 0 65535 -co PHOTOMETRIC=RGB -co ALPHA=YES rgba.tif drape.tif",
        "gdal_translate -q -co PHOTOMETRIC=RGB -co ALPHA=PREMULTIPLIED black.vrt drape.tif",
        "gdal_translate -q -co PHOTOMETRIC=RGB -a_nodata 0 -b 1 -b 2 -b 3 black.vrt drape.tif",
        "gdal_translate -q -of PNG rgba.tif drape.png; test -f drape.png.aux.xml", "gdal_translate -q -of COG rgba.tif drape.tif"}) {
    SCOPED_TRACE(script);
    shell("rm -f drape*; " + script);
    RasterOptions how;
    how.geographic = true;
    const auto bare = loadRaster(folder_ / "plain.tif", how, 1);
    how.drape = folder_ / std::filesystem::path(script.substr(script.find("drape."), 9));
    const auto draped = loadRaster(folder_ / "plain.tif", how, 1);
    ASSERT_TRUE(bare && draped) << (draped ? "" : draped.error().message);
    const auto colour = [](const terrain::Terrain& terrain, double east) {
      const lattice::Step x = std::llround((kWest + east) * 256), z = -std::llround((kNorth - 155) * 256);
      const float height = 1100;
      const std::array<float, 3> up{0, 1, 0};
      std::array<float, 3> out{};
      terrain.colours()(&x, &z, &height, &up, 0.01f, &out, 1, 1);
      return out;
    };
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(colour(**draped, 85)[c], std::pow((std::array{200, 100, 50}[c] / 255.0 + 0.055) / 1.055, 2.4), 0.02);
      EXPECT_EQ(colour(**draped, 325)[c], colour(**bare, 325)[c]);
    }
  }
}

// Files of which a server must fear something: they are refused, and nothing is fetched that the folder does not have.
TEST_F(Maps, HostileFilesReachNothingElse) {
  const auto vrt = [](const std::string& source, int side = 40) {
    return "printf '<VRTDataset rasterXSize=\"" + std::to_string(side) +
           "\" rasterYSize=\"30\"><VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource>" + "<SourceFilename relativeToVRT=\"0\">" +
           source + "</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>' > map.vrt";
  };
  EXPECT_THAT(refusal(vrt("/vsicurl/http://127.0.0.1:9/a.tif"), "map.vrt"), HasSubstr("which is not in its folder"));
  EXPECT_THAT(refusal("mkdir -p other; cp plain.tif /tmp/ridgecast-outside.tif; " + vrt("/tmp/ridgecast-outside.tif"), "map.vrt"),
              HasSubstr("which is not in its folder"));
  shell("rm /tmp/ridgecast-outside.tif");
  EXPECT_THAT(refusal(vrt("../../../etc/passwd"), "map.vrt"),
              testing::AnyOf(HasSubstr("not in its folder"), HasSubstr("GDAL cannot read it")));
  EXPECT_THAT(refusal(vrt("NETCDF:&quot;/tmp/x.nc&quot;:height"), "map.vrt"), HasSubstr("GDAL cannot read it"));
  EXPECT_THAT(refusal(vrt("map.vrt"), "map.vrt"), HasSubstr("GDAL cannot read it"));
  EXPECT_THAT(refusal(vrt("plain.tif", 2'000'000'000), "map.vrt"),
              testing::AnyOf(HasSubstr("there are at most 2^32"), HasSubstr("too long to read")));
  EXPECT_THAT(refusal(vrt("plain.tif", 100'000'000), "map.vrt"), HasSubstr("more than 2^30 samples"));
  EXPECT_THAT(
      refusal("printf '<GDAL_WMS><Service name=\"TMS\"><ServerUrl>http://127.0.0.1:9/${z}</ServerUrl></Service></GDAL_WMS>' > map.xml",
              "map.xml"),
      HasSubstr("GDAL cannot read it"));
}

// GDAL finds the name of a source wherever XML can hide it, and lists those that are plain files alone; the kernel refuses it the others.
TEST_F(Maps, SourcesThatGdalDoesNotListAreOutOfReach) {
  if (!process::ReachRules::areKept()) GTEST_SKIP() << "this kernel has no Landlock";
  testing_support::ScratchFolder other;
  const std::string secret = (other / "secret.tif").string(), named = "GTIFF_DIR:1:" + secret;
  shell("cp plain.tif '" + secret + "'");
  const auto write = [&](const char* name, const std::string& source) {
    std::ofstream(folder_ / name) << "<VRTDataset rasterXSize=\"40\" rasterYSize=\"30\"><VRTRasterBand dataType=\"Float32\" band=\"1\">"
                                  << "<SimpleSource" << source << "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>";
  };
  write("inner.vrt", "><SourceFilename>" + secret + "</SourceFilename>");
  for (const std::string& source :
       {std::string("><SourceFilename relativeToVRT=\"1\">inner.vrt</SourceFilename>"), "><SourceFilename>" + named + "</SourceFilename>",
        " SourceFilename=\"" + named + "\">", ">< SourceFilename>" + named + "</SourceFilename>",
        "><SourceFilename>GTIFF_DIR&#58;1&#58;" + secret + "</SourceFilename>",
        "><SourceFilename><![CDATA[" + named + "]]></SourceFilename>"}) {
    write("map.vrt", source);
    EXPECT_THAT(refusal("true", "map.vrt", {"pitch=10"}), HasSubstr("GDAL cannot read it")) << source;
    // The same, of what is there.
    std::string mine = source;
    if (const std::size_t at = mine.find(secret); at != std::string::npos)
      mine.replace(at, secret.size(), (folder_ / "plain.tif").string());
    if (mine == source) write("inner.vrt", "><SourceFilename>" + (folder_ / "plain.tif").string() + "</SourceFilename>");
    write("map.vrt", mine);
    EXPECT_TRUE(load("map.vrt", {"pitch=10"})) << mine;
  }
}

// A program that a hostile file has misled may write anything: it is read as what it is.
TEST_F(Maps, AnotherSizeThanWasSaidIsRefused) {
  shell(
      "mkdir tools; for p in gdalinfo gdalsrsinfo gdalbuildvrt; do ln -s $(command -v $p) tools/$p; done; "
      "printf '#!/bin/sh\\nexec '$(command -v gdal_translate)' -outsize 3 2 \"$@\"\\n' > tools/gdal_translate; chmod +x "
      "tools/gdal_translate");
  const std::string path = std::getenv("PATH");
  setenv("PATH", ((folder_ / "tools").string() + ":" + path).c_str(), 1);
  const std::string said = refusal("cp mask.tif map.tif");
  setenv("PATH", path.c_str(), 1);
  EXPECT_THAT(said, HasSubstr("a map of another size than they said"));
}

TEST_F(Maps, AreReadWhateverLiesBesideThem) {
  shell("for what in aux.xml msk ovr; do truncate -s 3G plain.tif.$what; done; truncate -s 3G plain.tfw");
  const auto loaded = load("plain.tif", {"place=geo"});
  EXPECT_TRUE(loaded) << loaded.error().message;
}

TEST(MapsWithoutGdal, AreRefusedWithThePackage) {
  testing_support::ScratchFolder folder;
  std::ofstream(folder / "map.vrt") << "<VRTDataset/>";
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/nowhere", 1);
  const auto loaded = loadRaster(folder / "map.vrt", {}, 1);
  setenv("PATH", path.c_str(), 1);
  ASSERT_FALSE(loaded);
  EXPECT_THAT(loaded.error().message, HasSubstr("which GDAL's programs read: install the package gdal-bin"));
}

}  // namespace
}  // namespace ridgecast::raster
