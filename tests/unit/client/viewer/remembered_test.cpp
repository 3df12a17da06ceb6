// What the window remembers comes back as it was; a broken or hostile file is named and ignored; two windows keep both their changes.
#include "client/viewer/remembered.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "tests/support/process.h"

namespace ridgecast::viewer {
namespace {

using testing::HasSubstr;

class RememberedTest : public testing::Test {
 protected:
  std::string problemOf(const std::string& text) const {
    std::ofstream(file_) << text;
    const auto read = readRemembered(file_);
    return read ? "" : read.error().message;
  }
  testing_support::ScratchFolder folder_;
  const std::filesystem::path file_ = folder_ / "window.json";
};

TEST_F(RememberedTest, NothingIsTheDefaults) {
  const auto read = readRemembered(file_);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->width, 1280u);
  EXPECT_EQ(read->mode, Mode::kSplit);
  EXPECT_TRUE(read->places.empty());
}

TEST_F(RememberedTest, ComesBackAsItWas) {
  Remembered last;
  last.width = 900;
  last.height = 500;
  last.divider = 0.25;
  last.speed = 123.5;
  last.textScale = 1.6;
  last.mode = Mode::kDifference;
  last.borders = Borders::kAge;
  last.figures = last.smooth = last.vsync = last.members = false;
  last.plots = last.wireframe = last.invertY = true;
  last.name = "Ada \xc3\xa9";
  last.visit({"a:7070/default", {lattice::kMaxPosition, -257}, 12.5, -170, 30});
  const std::filesystem::path below = folder_ / "new" / "window.json";
  ASSERT_TRUE(keepChanges(below, {}, last));
  const auto read = readRemembered(below);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->width, 900u);
  EXPECT_EQ(read->height, 500u);
  EXPECT_EQ(read->divider, 0.25);
  EXPECT_EQ(read->speed, 123.5);
  EXPECT_EQ(read->textScale, 1.6);
  EXPECT_EQ(read->mode, Mode::kDifference);
  EXPECT_EQ(read->borders, Borders::kAge);
  EXPECT_FALSE(read->figures || read->smooth || read->vsync || read->members);
  EXPECT_TRUE(read->plots && read->wireframe && read->invertY);
  EXPECT_EQ(read->name, last.name);
  ASSERT_TRUE(read->placeAt("a:7070/default"));
  EXPECT_FALSE(read->placeAt("a:7070/other"));
  const Remembered::Place& place = read->places.front();
  EXPECT_EQ(place.at, (lattice::Point{lattice::kMaxPosition, -257}));
  EXPECT_EQ(place.altitude, 12.5);
  EXPECT_EQ(place.yaw, -170);
  EXPECT_EQ(place.pitch, 30);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(below.parent_path()), {}), 1) << "a part of a file is left";
}

// What the command line sets and nobody changes is not kept; nor does one window undo what another has kept.
TEST_F(RememberedTest, OnlyWhatChangedIsWritten) {
  Remembered first, last;
  first.textScale = last.textScale = 3;
  last.divider = 0.75;
  last.visit({"a:1/s", {}});
  ASSERT_TRUE(keepChanges(file_, first, last));
  Remembered other;
  other.plots = true;
  other.visit({"b:1/s", {}});
  ASSERT_TRUE(keepChanges(file_, {}, other));
  const auto read = readRemembered(file_);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->textScale, 1);
  EXPECT_EQ(read->divider, 0.75);
  EXPECT_TRUE(read->plots);
  ASSERT_EQ(read->places.size(), 2u);
  EXPECT_EQ(read->places.front().where, "b:1/s");
}

TEST_F(RememberedTest, ThePlaceLongestNotVisitedIsForgotten) {
  for (std::size_t k = 0; k <= Remembered::kMaxPlaces; ++k) {
    Remembered last;
    last.visit({"a:1/" + std::to_string(k == 5 ? 0 : k), {}});
    ASSERT_TRUE(keepChanges(file_, {}, last));
  }
  const auto read = readRemembered(file_);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->places.size(), Remembered::kMaxPlaces);
  Remembered one;
  one.visit({"a:1/new", {}});
  ASSERT_TRUE(keepChanges(file_, {}, one));
  const auto later = readRemembered(file_);
  ASSERT_TRUE(later);
  EXPECT_EQ(later->places.size(), Remembered::kMaxPlaces);
  EXPECT_TRUE(later->placeAt("a:1/0"));
  EXPECT_FALSE(later->placeAt("a:1/1"));
}

TEST_F(RememberedTest, ABrokenOrHostileFileIsNamedAndReplaced) {
  const std::string deep(20000, '[');
  for (const auto& [text, why] : std::initializer_list<std::pair<std::string, std::string>>{
           {"", "not JSON"},
           {"{", "not JSON"},
           {deep, "not JSON"},
           {deep + std::string(20000, ']'), "not a JSON object"},
           {"7", "not a JSON object"},
           {R"({"divider": 1e999})", "not JSON"},
           {R"({"divider": "left"})", "'divider' should be a number from 0.02 to 0.98"},
           {R"({"width": -1})", "'width'"},
           {R"({"height": 1e9})", "'height'"},
           {R"({"speed": null})", "'speed'"},
           {R"({"mode": "upside down"})", "'mode'"},
           {R"({"leaves": 3})", "'leaves'"},
           {R"({"figures": 1})", "'figures' should be true or false"},
           {R"({"name": ")" + std::string(33, 'x') + "\"}", "'name'"},
           {R"({"places": {}})", "'places'"},
           {R"({"places": [1]})", "'where'"},
           {R"({"places": [{"where": "a:1/s", "x": "1e99", "z": "0"}]})", "'x'"},
           {R"({"places": [{"where": "a:1/s", "x": 5, "z": "0"}]})", "'x'"},
           {R"({"places": [{"where": "a:1/s", "x": "0", "z": "0", "altitude": -5}]})", "'altitude'"},
           {R"({"name": ")" + std::string(70'000, 'x') + "\"}", "larger than 64 KiB"}}) {
    const std::string problem = problemOf(text);
    EXPECT_THAT(problem, HasSubstr(why)) << text.substr(0, 80);
    EXPECT_THAT(problem, HasSubstr(file_.string()));
    EXPECT_EQ(problem.find('\n'), std::string::npos);
  }
  EXPECT_EQ(problemOf(R"({"unknown": [1, 2], "divider": 0.5})"), "");
  problemOf("{");
  Remembered last;
  last.divider = 0.75;
  ASSERT_TRUE(keepChanges(file_, {}, last));
  EXPECT_EQ(readRemembered(file_)->divider, 0.75);
}

TEST_F(RememberedTest, WhatIsNoFileIsNotRead) {
  ASSERT_EQ(mkfifo(file_.c_str(), 0600), 0);  // reading it would wait for ever
  const auto read = readRemembered(file_);
  ASSERT_FALSE(read);
  EXPECT_THAT(read.error().message, HasSubstr("not a file"));
  const std::filesystem::path folder = folder_ / "folder";
  std::filesystem::create_directories(folder / "full");
  EXPECT_FALSE(readRemembered(folder));
  const auto kept = keepChanges(folder, {}, {});
  ASSERT_FALSE(kept);
  EXPECT_THAT(kept.error().message, HasSubstr(folder.string()));
}

TEST_F(RememberedTest, TheFileIsWhereTheDesktopKeepsSuch) {
  const char* const before = std::getenv("XDG_CONFIG_HOME");
  const std::string home = std::getenv("HOME") ? std::getenv("HOME") : "", config = before ? before : "";
  setenv("XDG_CONFIG_HOME", "/c", 1);
  EXPECT_EQ(rememberedFile(), "/c/ridgecast/window.json");
  setenv("XDG_CONFIG_HOME", "relative", 1);
  setenv("HOME", "/h", 1);
  EXPECT_EQ(rememberedFile(), "/h/.config/ridgecast/window.json");
  unsetenv("HOME");
  EXPECT_EQ(rememberedFile(), std::nullopt);
  setenv("HOME", home.c_str(), 1);
  before ? setenv("XDG_CONFIG_HOME", config.c_str(), 1) : unsetenv("XDG_CONFIG_HOME");
}

}  // namespace
}  // namespace ridgecast::viewer
