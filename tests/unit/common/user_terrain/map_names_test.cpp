// Height maps by their names, and the files beside them that say how they are read.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/process/scratch.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"
#include "common/user_terrain/catalogue.h"

namespace ridgecast::user_terrain {
namespace {

using terrain::Terrain;
using testing::HasSubstr;

class FolderOfMaps : public testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_.path() / name, std::ios::binary) << text; }
  void map(const std::string& name, const std::string& middle) const {
    write(name, "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\nNODATA_value -9999\n7 7 7\n7 " + middle + " 7\n7 7 7\n");
  }
  Outcome<std::shared_ptr<const Terrain>> named(const std::string& name, const std::vector<std::string>& raster = {}) const {
    Request request;
    request.terrain = name;
    request.folder = folder_.path();
    for (const std::string& r : raster) EXPECT_TRUE(raster::addRasterOption(r, request.raster));
    return load(request, nullptr);
  }
  process::Scratch folder_ = process::Scratch::create().value();
};

TEST_F(FolderOfMaps, EachIsATerrainByItsName) {
  map("flat.asc", "7");
  map("peak.ASC", "9");
  const auto entries = list(folder_.path());
  ASSERT_TRUE(entries);
  ASSERT_EQ(entries->size(), terrain::builtIn().size() + 2);
  EXPECT_EQ(entries->back().name, "peak");
  EXPECT_EQ(entries->back().summary, "height map, peak.ASC");
  EXPECT_EQ(entries->back().problem, "");
  const auto flat = named("flat"), peak = named("peak");
  ASSERT_TRUE(flat && peak);
  EXPECT_EQ((*flat)->name(), "flat");
  EXPECT_EQ((*flat)->height({0, 0}), 7);
  EXPECT_EQ((*peak)->height({0, 0}), 9);
  EXPECT_THAT(named("hill").error().message, testing::AllOf(HasSubstr("there is no terrain \"hill\""), HasSubstr("flat, peak")));
  Request request;
  request.terrain = "flat", request.folder = folder_.path();
  ASSERT_TRUE(glsl::parseAssignment("height=3"));
  request.parameters = {*glsl::parseAssignment("height=3")};
  EXPECT_THAT(load(request, nullptr).error().message, HasSubstr("\"flat\" is a height map, which has no parameters"));
}

TEST_F(FolderOfMaps, TheLinesBesideAMapSayHowItIsRead) {
  map("hole.asc", "-9999");
  EXPECT_THAT(named("hole").error().message, HasSubstr("nodata=fill"));
  EXPECT_TRUE(named("hole", {"nodata=fill"}));
  write("hole.raster", "# what a surveyor left out\r\n\n  nodata=30\nscale=2");
  const auto hole = named("hole"), byPath = named((folder_.path() / "hole.asc").string());
  ASSERT_TRUE(hole) << hole.error().message;
  EXPECT_EQ((*hole)->height({0, 0}), 30);
  EXPECT_EQ((*hole)->height({10 * 256, 0}), 14);
  ASSERT_TRUE(byPath);
  EXPECT_EQ(terrain::contentHash(**byPath), terrain::contentHash(**hole));

  EXPECT_THAT(named("hole", {"nodata=fill"}).error().message, HasSubstr("add a line to it, and leave --raster, --drape and --classes out"));
  write("hole.raster", "nodata=30\npith=3\n");
  EXPECT_THAT(named("hole").error().message, testing::AllOf(HasSubstr("hole.raster:2: "), HasSubstr("there is pitch=METRES")));
  write("hole.raster", "nodata=30\ndrape=ramp.txt\n");
  EXPECT_THAT(named("hole").error().message, HasSubstr("ramp.txt"));
  write("ramp.txt", "0 255 0 0\n100 255 0 0\n");
  const auto draped = named("hole");
  ASSERT_TRUE(draped) << draped.error().message;
  EXPECT_TRUE((*draped)->raster()->shape().draped);
  EXPECT_THAT(filesOf({.terrain = "hole", .folder = folder_.path()}),
              testing::IsSupersetOf({folder_.path() / "hole.asc", folder_.path() / "hole.raster", folder_.path() / "ramp.txt"}));
}

TEST_F(FolderOfMaps, FilesThatCannotHaveTheirNameSayWhy) {
  map("twin.asc", "7");
  map("twin.hgt", "7");
  map("two words.asc", "7");
  map("alpine.asc", "7");
  write("words.raster", "");
  std::map<std::string, std::string> problems;
  for (const Entry& entry : list(folder_.path()).value())
    if (!entry.problem.empty()) problems[entry.name] = entry.problem;
  EXPECT_EQ(problems.size(), 3u);
  EXPECT_THAT(problems["twin"], HasSubstr("two terrains cannot have the name twin"));
  EXPECT_THAT(problems["two words"], HasSubstr("rename it"));
  EXPECT_THAT(problems["alpine"], HasSubstr("built-in"));
  EXPECT_THAT(named("twin").error().message, HasSubstr("two terrains cannot have the name twin"));
  EXPECT_FALSE((*named("alpine"))->raster());
}

}  // namespace
}  // namespace ridgecast::user_terrain
