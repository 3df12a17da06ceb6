// The window's edit mode with keys and a mouse that are really pressed, against the real server: a click makes an edit where it was
// clicked, undo, roads, refusals, and a token without the right.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "tests/e2e/operator.h"
#include "tests/e2e/window.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using Json = nlohmann::json;

constexpr int kWidth = 640, kHeight = 360;
constexpr int kX = 400, kY = 240;  // where the mouse is
constexpr int kBar = 22;           // a row of pixels through the tools

class WindowEdits : public WindowTest {
 protected:
  WindowEdits() { size_ = std::to_string(kWidth) + "x" + std::to_string(kHeight); }
  // Above a slope, looking down on it.
  void fly(const std::string& threshold, const std::string& url, const std::string& more = "") {
    openRemembering({"--x 1400 --z 3600 --altitude 150 --pitch -60 --reduced-motion --threshold", threshold, "--size", size_, more}, url,
                    "kept");
  }
  void move(int x, int y) {
    EXPECT_EQ(runProgram({"xdotool", "mousemove", "--window", windowNumber(), std::to_string(x), std::to_string(y)}, environment_).code, 0);
    shot();
  }
  void click(int x, int y, const std::string& button = "1", int times = 1) {
    move(x, y);
    EXPECT_EQ(runProgram({"xdotool", "click", "--repeat", std::to_string(times), "--delay", "20", button}, environment_).code, 0);
    shot();
  }
  std::vector<Json> edits() const {
    std::vector<Json> out;
    const Json answer = Json::parse(get(server_.port(), "/v1/sessions/default/edits"));
    for (const Json& made : answer["edits"]) out.push_back(made["edit"]);
    return out;
  }
  double heightAt(double x, double z) const {
    const Json answer = Json::parse(get(server_.port(), "/v1/heights?at=" + std::to_string(x) + "," + std::to_string(z)));
    return answer["heights"][0];
  }
  // Where the terrain lies below a pixel, by the server's ray: x, z, and how far away; the camera's rotation is written out once more.
  std::array<double, 3> groundBelow(int px, int py) const {
    const double pitch = -60 * std::numbers::pi / 180, focal = kHeight / 2.0 / std::tan(std::numbers::pi / 6);
    const double right = px - kWidth / 2.0, up = kHeight / 2.0 - py, y = heightAt(1400, 3600) + 150;
    const double ahead = focal * std::cos(pitch) - up * std::sin(pitch), rise = focal * std::sin(pitch) + up * std::cos(pitch);
    const double length = std::hypot(right, rise, ahead);
    const std::array<double, 3> d{right / length, rise / length, -ahead / length};
    const std::string ray =
        "1400," + std::to_string(y) + ",3600," + std::to_string(d[0]) + "," + std::to_string(d[1]) + "," + std::to_string(d[2]);
    const Json answer = Json::parse(get(server_.port(), "/v1/rays?ray=" + ray + "&reach=10000"));
    const double distance = answer["rays"][0]["distance"];
    return {1400 + distance * d[0], 3600 + distance * d[2], distance};
  }
  ServerProcess server_{RIDGECAST_SERVER};
};

// Pixels of the brush's colour around a place.
int brushAround(const render::Picture& p, int x, int y, int reach) {
  int count = 0;
  for (int row = std::max(0, y - reach); row < std::min<int>(static_cast<int>(p.height), y + reach); ++row)
    for (int column = std::max(0, x - reach); column < std::min<int>(static_cast<int>(p.width), x + reach); ++column) {
      const std::uint8_t* rgb = &p.rgb[3 * (static_cast<std::size_t>(row) * p.width + static_cast<std::size_t>(column))];
      count += std::abs(rgb[0] - 255) < 20 && std::abs(rgb[1] - 209) < 20 && std::abs(rgb[2] - 102) < 20;
    }
  return count;
}

// The left end of the tool that is chosen, in the bar at the top.
int chosenTool(const render::Picture& p) {
  for (std::uint32_t column = 0; column < p.width; ++column) {
    const std::uint8_t* rgb = &p.rgb[3 * (std::size_t{kBar} * p.width + column)];
    if (rgb[0] == 0x8f && rgb[1] == 0xc1 && rgb[2] == 0xe8) return static_cast<int>(column);
  }
  return -1;
}

TEST_F(WindowEdits, AClickMakesACraterBelowTheMouseAndUndoTakesItBack) {
  fly("1", server_.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "1"});
  const auto [x, z, distance] = groundBelow(kX, kY);
  move(kX, kY);
  const render::Picture before = rested();
  EXPECT_EQ(brushAround(before, kX, kY, 150), 0);
  press({"i"});
  click(kX, kY, "4", 10);  // the wheel: 1.15 to the power of 10
  ASSERT_TRUE(shows([](const render::Picture& now) { return brushAround(now, kX, kY, 150) > 20; })) << "no brush";
  EXPECT_TRUE(edits().empty());
  const double height = heightAt(x, z);
  click(kX, kY);
  ASSERT_TRUE(says("Edit 1 made.")) << viewer_->output();
  const Json crater = edits().at(0);
  EXPECT_EQ(crater["op"], "crater");
  EXPECT_NEAR(crater["radius"].get<double>(), 8 * std::pow(1.15, 10), 0.3);
  EXPECT_LT(std::hypot(crater["x"].get<double>() - x, crater["z"].get<double>() - z), distance / 100) << "more than 1.5 pixels off";
  const double depth = height - heightAt(crater["x"], crater["z"]);
  EXPECT_NEAR(depth, crater["depth"].get<double>(), 3) << "the ground there is not level";
  EXPECT_GT(depth, 5);
  EXPECT_TRUE(shows([&](const render::Picture& now) { return compare(before, now).moved > 0.02; })) << "no crater";

  press({"u"});
  ASSERT_TRUE(says("Edit 1 undone.")) << viewer_->output();
  EXPECT_EQ(edits().at(1), (Json{{"op", "undo"}, {"edit", 1}}));
  EXPECT_EQ(heightAt(x, z), height);
  press({"u"});
  EXPECT_TRUE(says("You have no edit to undo.")) << viewer_->output();
  // Without the mode a key and a click do what they always do.
  press({"i", "u"});
  EXPECT_TRUE(shows([](const render::Picture& now) { return brushAround(now, kX, kY, 150) == 0; })) << "the brush stays";
  EXPECT_EQ(edits().size(), 2u);
  close();
}

TEST_F(WindowEdits, ARoadFollowsClicksUntilADoubleClickAndTheBarHasItsTool) {
  fly("4", server_.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "1", "i"});
  rested();
  std::set<int> tools{chosenTool(shot())};
  for (int left = 70; left < kWidth && tools.size() < 6; left += 20) {
    click(left, kBar);
    tools.insert(chosenTool(shot()));
  }
  ASSERT_EQ(tools.size(), 6u) << "the road is the last of six";
  EXPECT_TRUE(edits().empty()) << "a click on the bar is none on the ground";
  const auto [x, z, distance] = groundBelow(kX, kY);  // before the ground changes
  click(kX, kY);
  click(kX + 60, kY - 10);
  click(kX + 40, kY + 40, "1", 2);
  EXPECT_TRUE(await([&] { return edits().size() == 1; })) << viewer_->output();
  EXPECT_EQ(edits().at(0)["op"], "road");
  const Json line = edits().at(0)["line"];  // surveyed: with places between
  EXPECT_LT(std::hypot(line.front()[0].get<double>() - x, line.front()[1].get<double>() - z), distance / 50);
  EXPECT_GE(line.size(), 3u);
  // A drag looks around and makes nothing.
  const render::Picture before = rested();
  move(kX, kY);
  runProgram({"xdotool", "mousedown", "1"}, environment_);
  move(kX + 120, kY);
  runProgram({"xdotool", "mouseup", "1"}, environment_);
  EXPECT_TRUE(shows([&](const render::Picture& now) { return compare(before, now).moved > 0.1; })) << "it does not turn";
  EXPECT_EQ(edits().size(), 1u);
  press({"Escape"});
  EXPECT_TRUE(shows([](const render::Picture& now) { return brushAround(now, kX, kY, 300) == 0; })) << "Esc does not end it";
  close();
}

TEST_F(WindowEdits, WhoLacksTheRightIsToldAndConnectedStill) {
  const std::string tokens = folder_ / "tokens", token = folder_ / "token";
  ASSERT_EQ(runProgram({RIDGECAST_SERVER, "token", "--token-file", tokens, "--holder", "viewer", "--rights", "view", "--out", token}).code,
            0);
  ServerProcess guarded(RIDGECAST_SERVER, {"--token-file", tokens});
  fly("20", guarded.url(), "--token-file " + token);
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"1", "i"});
  EXPECT_TRUE(says("The token lacks the right 'edit'.")) << viewer_->output();
  EXPECT_EQ(viewer_->output().find("connection to the server is lost"), std::string::npos) << viewer_->output();
  close();
}

}  // namespace
}  // namespace ridgecast
