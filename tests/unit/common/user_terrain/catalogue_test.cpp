// Terrains by name: folders of files, the cache of what was compiled, and the tutorial.
#include "common/user_terrain/catalogue.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "common/glsl/library.h"
#include "tests/unit/common/terrain/points.h"
#include "tests/unit/common/user_terrain/files.h"

namespace ridgecast::user_terrain {
namespace {

using std::filesystem::path;
using testing::HasSubstr;

TEST_F(Files, theCacheServesWithoutACompilerAndOnlyWhatIsOurs) {
  const path file = write(
      "flat.glsl", "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 4.0; }\n" + std::string(kColour));
  ASSERT_TRUE(load(request(file), nullptr));
  const std::string before = std::getenv("PATH");
  setenv("PATH", folder_.path().c_str(), 1);
  const auto again = load(request(file), nullptr);
  setenv("PATH", before.c_str(), 1);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ((*again)->height({0, 0}), 4.0);
  // Others could have put something there.
  chmod((folder_.path() / "cache").c_str(), 0777);
  EXPECT_THAT(load(request(file), nullptr).error().message, HasSubstr("cannot be trusted"));
  chmod((folder_.path() / "cache").c_str(), 0700);
  // A damaged file is made anew.
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "cache")) {
    std::filesystem::remove(entry.path());  // it is mapped: not in place
    std::ofstream(entry.path()) << "no library";
    chmod(entry.path().c_str(), 0600);
  }
  const auto repaired = load(request(file), nullptr);
  ASSERT_TRUE(repaired) << repaired.error().message;
  EXPECT_EQ((*repaired)->height({0, 0}), 4.0);
}

TEST_F(Files, foldersOfferTerrainsByName) {
  write("dune.glsl",
        "//! one dune\nconst float level = 5.0;  //! 0..50 m: how high\nfloat terrainHeight(ivec2 cell, vec2 fraction, float footprint, "
        "uint seed) { return level; }\n" +
            std::string(kColour));
  write("broken.glsl", "#include \"x\"\n");
  write("notes.txt", "no terrain");
  const auto entries = list(folder_.path());
  ASSERT_TRUE(entries);
  ASSERT_EQ(entries->size(), terrain::builtIn().size() + 2);
  const Entry& broken = (*entries)[terrain::builtIn().size()];
  const Entry& dune = entries->back();
  EXPECT_EQ(broken.name, "broken");
  EXPECT_THAT(broken.problem, HasSubstr("#include"));
  EXPECT_EQ(dune.name, "dune");
  EXPECT_EQ(dune.summary, "one dune");
  ASSERT_EQ(dune.parameters.size(), 1u);
  EXPECT_TRUE(list(folder_.path() / "none").has_error());

  Request r = request("dune");
  r.folder = folder_.path();
  const auto t = load(r, nullptr);
  ASSERT_TRUE(t) << t.error().message;
  EXPECT_EQ((*t)->height({1, 2}), 5.0);
  r.terrain = "dunes";
  EXPECT_THAT(load(r, nullptr).error().message, HasSubstr("alpine"));
  EXPECT_THAT(load(r, nullptr).error().message, HasSubstr("dune"));
  write("alpine.glsl", "");
  EXPECT_THAT(load(request(folder_.path() / "alpine.glsl"), nullptr).error().message, HasSubstr("built-in"));
}

TEST(Catalogue, RasterOptionsOfOtherTerrainsAreRefused) {
  Request request;
  ASSERT_TRUE(raster::addRasterOption("pitch=3", request.raster));
  for (const char* terrain : {"alpine", "mine.glsl"}) {
    request.terrain = terrain;
    const auto loaded = load(request, {});
    ASSERT_FALSE(loaded) << terrain;
    EXPECT_THAT(loaded.error().message, HasSubstr("--raster")) << terrain;
  }
}

// What the README tells a newcomer to save and run.
TEST_F(Files, theTutorialRunsAsItStands) {
  const path file = path(RIDGECAST_TERRAINS) / "tutorial" / "dunes.glsl";
  const auto read = [](const path& p) {
    std::ifstream in(p);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const std::string text = read(file);
  EXPECT_LT(std::count(text.begin(), text.end(), '\n'), 20);
  EXPECT_THAT(read(path(RIDGECAST_TERRAINS) / "README.md"), HasSubstr("```glsl\n" + text + "```\n"));
  const auto t = load(request(file), nullptr);
  ASSERT_TRUE(t) << t.error().message;
  const terrain::Points p = terrain::pointsAt(1e8, 2000);
  std::vector<float> h(p.x.size());
  (*t)->heights(p.x, p.z, h);
  const auto [least, most] = std::minmax_element(h.begin(), h.end());
  EXPECT_GE(*least, 0.0f);
  EXPECT_GT(*most - *least, 100.0f);
}

// Parameters come over the network, each with a compilation of its own.
TEST_F(Files, TheCacheKeepsWhatWasUsedLast) {
  const path cache = folder_.path() / "cache", file = write("kept.glsl",
                                                            "const float tall = 5.0;  //! 1..9 m: how tall\n"
                                                            "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, "
                                                            "uint seed) {\nreturn tall;\n}\n" +
                                                                std::string(kColour));
  Request first = request(file);
  first.parameters = {{"tall", 2.0}};
  ASSERT_TRUE(load(first, {}));
  const auto entries = [&] {
    std::vector<path> out;
    for (const auto& entry : std::filesystem::directory_iterator(cache)) out.push_back(entry.path());
    return out;
  };
  ASSERT_EQ(entries().size(), 1u);
  const path used = entries().front();
  const auto old = std::filesystem::file_time_type::clock::now() - std::chrono::hours(9);
  std::filesystem::last_write_time(used, old - std::chrono::hours(1));  // the oldest of all
  std::ofstream(cache / "somebody-elses.so") << "mine";
  std::filesystem::last_write_time(cache / "somebody-elses.so", old - std::chrono::hours(2));
  for (std::size_t k = 0; k < glsl::Cache::kMaxKept + 20; ++k) {
    char name[64];
    std::snprintf(name, sizeof name, "%032zx-baseline.so", k);
    std::ofstream(cache / name) << "old";
    std::filesystem::last_write_time(cache / name, old + std::chrono::seconds(k));
  }
  ASSERT_TRUE(load(first, {}));  // used again
  Request second = first;
  second.parameters = {{"tall", 3.0}};
  const auto loaded = load(second, {});
  ASSERT_TRUE(loaded);
  EXPECT_EQ((*loaded)->height({0, 0}), 3.0);
  EXPECT_EQ(entries().size(), glsl::Cache::kMaxKept + 1);
  EXPECT_TRUE(std::filesystem::exists(used));
  EXPECT_TRUE(std::filesystem::exists(cache / "somebody-elses.so"));
  EXPECT_FALSE(std::filesystem::exists(cache / (std::string(32, '0') + "-baseline.so")));
}

}  // namespace
}  // namespace ridgecast::user_terrain
