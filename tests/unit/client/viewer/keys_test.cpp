// One table of keys: README shows it, window and page have an action for each of its rows, and no key does two things.
#include "common/keys/keys.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

#include "tests/support/process.h"

namespace ridgecast::keys {
namespace {

std::string read(const std::string& file) {
  std::string text = testing_support::readText(RIDGECAST_SOURCE "/" + file);
  EXPECT_FALSE(text.empty()) << file;
  return text;
}

// What is held down is read by the devices themselves.
bool isHeld(const Row& row) {
  return std::set<std::string>{"fly", "rise", "sink", "sprint", "speed", "look", "divider", "radius"}.contains(row.action);
}

TEST(Keys, EachDoesOneThing) {
  std::set<std::string> strokes, actions;
  for (const Row& row : table()) {
    EXPECT_TRUE(actions.insert(row.action).second) << row.action;
    for (const std::string& stroke : strokesOf(row)) EXPECT_TRUE(strokes.insert(stroke).second) << stroke;
    EXPECT_TRUE((std::set<std::string>{"both", "window", "page"}.contains(row.where))) << row.where;
  }
  EXPECT_GT(table().size(), 25u);
}

TEST(Keys, ReadmeShowsTheTable) {
  const std::string readme = read("README.md");
  std::string expected = "| key | | where |\n|---|---|---|\n";
  for (const Row& row : table()) {
    std::string keys;
    for (const std::string& stroke : strokesOf(row)) keys += (keys.empty() ? "`" : ", `") + stroke + "`";
    expected += "| " + keys + " | " + row.words + " | " + (row.where == "both" ? "" : row.where) + " |\n";
  }
  EXPECT_NE(readme.find(expected), std::string::npos) << "README.md should have\n" << expected;
}

TEST(Keys, WindowAndPageHaveAnActionForEach) {
  const std::string window = read("client/viewer/world_window.cpp"), page = read("client/web/src/ui/viewer.ts");
  for (const Row& row : table()) {
    if (isHeld(row)) continue;
    EXPECT_TRUE(row.where == "page" || window.find("{\"" + row.action + "\",") != std::string::npos) << row.action;
    const bool onPage = row.where != "window" && row.action != "back";  // which the browser does itself
    EXPECT_TRUE(!onPage || page.find("      " + row.action + ": () =>") != std::string::npos) << row.action;
  }
}

}  // namespace
}  // namespace ridgecast::keys
