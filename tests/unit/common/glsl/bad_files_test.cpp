// The catalogue of bad terrain files (tests/cases/terrain): each gives one message that says what and where, and exit code 2.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "common/process/child.h"
#include "common/process/scratch.h"

namespace ridgecast::glsl {
namespace {

using std::filesystem::path;

bool hasTools() { return process::findProgram("glslangValidator") && (process::findProgram("g++") || process::findProgram("c++")); }

process::ChildEnd serve(const path& file, const path& cache) {
  auto end = process::runChild(RIDGECAST_SERVER, {"--port", "0", "--terrain-cache", cache.string(), "--terrain", file.string()},
                               {.time = std::chrono::seconds(600), .memory = ~std::uint64_t{0}});
  EXPECT_TRUE(end);
  return end ? *end : process::ChildEnd{};
}

void expectOneMessage(const process::ChildEnd& end, const std::string& file, const std::string& part) {
  EXPECT_FALSE(end.timedOut) << file;
  EXPECT_EQ(end.status, 2) << file << ": " << end.output;
  EXPECT_THAT(end.output, testing::StartsWith("ridgecast-server: ")) << file;
  EXPECT_THAT(end.output, testing::HasSubstr(part)) << file;
  // One line for each thing that is wrong; below it the file's line and a caret, if it has one.
  std::istringstream lines(end.output);
  std::size_t complaints = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.find(file + ":") != std::string::npos || complaints == 0) {
      ++complaints;
      continue;
    }
    ASSERT_THAT(line, testing::StartsWith("  ")) << end.output;
    ASSERT_TRUE(std::getline(lines, line)) << end.output;
    EXPECT_EQ(line.find_first_not_of(" \t"), line.size() - 1) << end.output;
    EXPECT_THAT(line, testing::EndsWith("^")) << end.output;
  }
  EXPECT_EQ(complaints, file == "empty.glsl" ? 2u : 1u) << file << ": " << end.output;  // which lacks both functions
}

TEST(BadTerrainFiles, eachGivesItsOneMessage) {
  if (!hasTools()) GTEST_SKIP() << "needs glslangValidator and g++";
  auto scratch = process::Scratch::create();
  ASSERT_TRUE(scratch);
  std::ifstream table(path(RIDGECAST_CASES) / "expected.txt");
  std::set<std::string> seen;
  for (std::string line; std::getline(table, line);) {
    if (line.empty() || line.starts_with('#')) continue;
    const auto bar = line.find('|');
    ASSERT_NE(bar, std::string::npos) << line;
    const std::string file = line.substr(0, line.find(' '));
    seen.insert(file);
    expectOneMessage(serve(path(RIDGECAST_CASES) / file, scratch->path() / "cache"), file, line.substr(bar + 2));
  }
  for (const auto& entry : std::filesystem::directory_iterator(RIDGECAST_CASES))
    EXPECT_TRUE(entry.path().extension() == ".txt" || seen.contains(entry.path().filename())) << entry.path() << " is not in expected.txt";
}

TEST(BadTerrainFiles, aFileOfTenMegabytes) {
  auto scratch = process::Scratch::create();
  ASSERT_TRUE(scratch);
  const path file = scratch->path() / "large.glsl";
  std::ofstream(file) << std::string(10 << 20, '\n');
  expectOneMessage(serve(file, scratch->path() / "cache"), "large.glsl", "the file has 10485760 bytes; a terrain file has at most 262144");
}

TEST(BadTerrainFiles, noFileAndAFolder) {
  auto scratch = process::Scratch::create();
  ASSERT_TRUE(scratch);
  expectOneMessage(serve(scratch->path() / "none.glsl", scratch->path() / "cache"), "none.glsl", "there is no file");
  std::filesystem::create_directory(scratch->path() / "folder.glsl");
  expectOneMessage(serve(scratch->path() / "folder.glsl", scratch->path() / "cache"), "folder.glsl", "there is no file");
}

TEST(BadTerrainFiles, withoutACompilerTheMessageSaysWhatToInstall) {
  auto scratch = process::Scratch::create();
  ASSERT_TRUE(scratch);
  const path file = scratch->path() / "flat.glsl", tools = scratch->path() / "tools";
  std::ofstream(file)
      << "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 1.0; }\n"
         "vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return normal; }\n";
  const std::string before = std::getenv("PATH");
  std::filesystem::create_directory(tools);
  setenv("PATH", tools.c_str(), 1);
  expectOneMessage(serve(file, scratch->path() / "cache"), "flat.glsl", "apt-get install glslang-tools g++");
  setenv("PATH", before.c_str(), 1);
  if (!hasTools()) return;
  std::filesystem::create_symlink(*process::findProgram("glslangValidator"), tools / "glslangValidator");
  setenv("PATH", tools.c_str(), 1);
  expectOneMessage(serve(file, scratch->path() / "cache"), "flat.glsl", "apt-get install g++ glslang-tools");
  setenv("PATH", before.c_str(), 1);
}

}  // namespace
}  // namespace ridgecast::glsl
