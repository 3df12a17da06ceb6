// What a window goes through: other sizes, screens with small pixels, other worlds, others in its session.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "client/link/connection.h"
#include "common/terrain/terrain.h"
#include "tests/e2e/window.h"
#include "tests/support/flier.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

class Window : public WindowTest {
 protected:
  void click(int x, int y) {
    runProgram({"xdotool", "mousemove", "--window", windowNumber(), std::to_string(x), std::to_string(y)}, environment_);
    shot();
    runProgram({"xdotool", "click", "1"}, environment_);
    shot();
  }
};

TEST_F(Window, AfterItsSizeChangedThePictureIsThatOfAWindowOfThatSize) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "2"});
  rested();
  ASSERT_EQ(runProgram({"xdotool", "windowsize", windowNumber(), "420", "280"}, environment_).code, 0);
  ASSERT_TRUE(shows([](const render::Picture& now) { return now.width == 420 && now.height == 280; }));
  const render::Picture march = rested();
  press({"1"});
  const render::Picture mesh = rested();
  close();
  size_ = "420x280";
  open({"--threshold", "20", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "2"});
  EXPECT_EQ(compare(march, rested()).mean, 0);
  press({"1"});
  EXPECT_LT(compare(mesh, rested()).mean, 4);  // of a mesh that was built for another size first
  close();
  EXPECT_TRUE(server.healthy());
}

TEST_F(Window, FillsTheScreenAndComesBack) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "50"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"1", "F11"});
  EXPECT_TRUE(shows([](const render::Picture& now) { return now.width == 800 && now.height == 600; }));
  press({"F11"});
  EXPECT_TRUE(shows([](const render::Picture& now) { return now.width == 320 && now.height == 180; }));
  close();
}

// How many rows the figures at the upper left cover.
std::uint32_t rowsOf(const render::Picture& with, const render::Picture& without) {
  std::uint32_t last = 0;
  for (std::uint32_t row = 0; row < with.height; ++row)
    if (std::size_t{row} * with.width * 3 + 60 <= with.rgb.size() &&
        !std::equal(&with.rgb[std::size_t{row} * with.width * 3 + 45], &with.rgb[std::size_t{row} * with.width * 3 + 60],
                    &without.rgb[std::size_t{row} * with.width * 3 + 45]))
      last = row;
  return last;
}

TEST_F(Window, OnAScreenOfSmallPixelsWindowAndTextAreAsLargeAsElsewhere) {
  if (!programExists("xprop")) GTEST_SKIP() << "xprop is not installed (package x11-utils)";
  ServerProcess server(RIDGECAST_SERVER);
  size_ = "400x300";
  std::uint32_t rows[2] = {};
  for (const int scale : {1, 2}) {
    if (scale == 2) {
      // What a desktop says of such a screen.
      ASSERT_EQ(
          runProgram({"xprop", "-root", "-f", "RESOURCE_MANAGER", "8s", "-set", "RESOURCE_MANAGER", "Xft.dpi: 192\n"}, environment_).code,
          0);
    }
    open({"--threshold", "50", "--reduced-motion"}, server.url());
    ASSERT_TRUE(opened()) << viewer_->output();
    press({"1"});
    const auto width = static_cast<std::uint32_t>(400 * scale), height = static_cast<std::uint32_t>(300 * scale);
    ASSERT_TRUE(shows([&](const render::Picture& now) { return now.width == width && now.height == height; }));
    press({"f"});
    const render::Picture without = rested();  // nothing moves any more: what differs now are the figures
    press({"f"});
    rows[scale - 1] = rowsOf(shot(), without);
    close();
  }
  EXPECT_GT(rows[0], 80u);
  EXPECT_NEAR(rows[1], 2 * rows[0], 0.1 * rows[1]);
}

TEST_F(Window, GoesOnWithATerrainFileThatWasSaved) {
  ScratchFolder folder;
  const auto save = [&](const char* height) {
    std::ofstream(folder / "new") << "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return " << height
                                  << "; }\nvec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, "
                                     "uint seed) { return vec3(0.5, 0.2, 0.1); }\n";
    std::filesystem::rename(folder / "new", folder / "mine.glsl");
  };
  save("10.0");
  ServerProcess server(RIDGECAST_SERVER,
                       {"--watch", "--terrain", (folder / "mine.glsl").string(), "--terrain-cache", (folder / "cache").string()});
  open({"--threshold", "20", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"F3", "1"});
  const render::Picture flat = rested();
  save("10.0 + 900.0 * abs(valueNoise(finer5(widestPlace(cell, fraction)).cell, finer5(widestPlace(cell, fraction)).at, 3u).x)");
  ASSERT_TRUE(says("entering it")) << viewer_->output() << server.process().output();
  EXPECT_TRUE(await([&] { return compare(flat, shot()).moved > 0.1; })) << viewer_->output();
  close();
}

TEST_F(Window, AnotherWorldIsEnteredByTypingItsNameAndIsTheOneThatEverybodySees) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "2"});
  const render::Picture alpine = rested();
  const auto enter = [&](const std::string& terrain, const std::string& seed) {
    type("j\t\t\t" + terrain + "\t" + seed);  // many keys within one frame
    press({"Return"});
  };
  enter("nowhere", "7");  // is told, and the window stays where it is
  EXPECT_TRUE(says("nowhere")) << viewer_->output();
  press({"Escape"});
  EXPECT_EQ(compare(alpine, rested()).mean, 0);
  enter("canyon", "7");
  ASSERT_TRUE(says("viewing canyon, seed 7")) << viewer_->output();
  ASSERT_TRUE(says("drawn with canyon's own colours")) << viewer_->output();
  const render::Picture canyon = rested();
  EXPECT_GT(compare(alpine, canyon).moved, 0.2);
  press({"1"});
  const Difference mesh = compare(canyon, rested());  // its mesh has come, too
  EXPECT_GT(mesh.mean, 0);
  EXPECT_LT(mesh.mean, 20);
  close();
  // It is a session of the server's that others join by name.
  open({"--threshold", "20", "--reduced-motion"}, server.url() + "?session=canyon-7");
  ASSERT_TRUE(opened()) << viewer_->output();
  EXPECT_TRUE(says("viewing canyon, seed 7")) << viewer_->output();
  press({"f", "2"});
  EXPECT_LT(compare(canyon, rested()).mean, 0.5);
  close();
  EXPECT_TRUE(server.healthy());
}

// Metres from the window's camera, which looks 14 degrees down along -z through 60 degrees in height; and where that is in 320 x 180
// pixels.
struct Place {
  double right, up, ahead;  // level
  static constexpr double kPitch = 14 * std::numbers::pi / 180;
  double depth() const { return ahead * std::cos(kPitch) - up * std::sin(kPitch); }
  double pixels() const { return 90 / (depth() * std::tan(std::numbers::pi / 6)); }  // a metre there
  double column() const { return 160 + right * pixels(); }
  double row() const { return 90 - (up * std::cos(kPitch) + ahead * std::sin(kPitch)) * pixels(); }
};

// The colours of members 1 to 3: the window itself is one of them, and colours go by the camera's number.
bool isOfAMember(const std::uint8_t* rgb) {
  constexpr std::uint8_t kColours[][3] = {{0x56, 0xb4, 0xe9}, {0x2f, 0xc2, 0x9a}, {0xf0, 0xe4, 0x42}};
  return std::ranges::any_of(kColours, [rgb](const auto& c) {
    return std::abs(rgb[0] - c[0]) < 10 && std::abs(rgb[1] - c[1]) < 10 && std::abs(rgb[2] - c[2]) < 10;
  });
}

// Whether a picture has the colour of the others' markers within so many pixels of a place.
bool marks(const render::Picture& p, double x, double y, int reach) {
  for (int row = static_cast<int>(y) - reach; row <= static_cast<int>(y) + reach; ++row)
    for (int column = static_cast<int>(x) - reach; column <= static_cast<int>(x) + reach; ++column) {
      if (row < 0 || column < 0 || row >= static_cast<int>(p.height) || column >= static_cast<int>(p.width)) continue;
      const std::uint8_t* rgb = &p.rgb[3 * (static_cast<std::size_t>(row) * p.width + static_cast<std::size_t>(column))];
      if (isOfAMember(rgb)) return true;
    }
  return false;
}

// The first pixel with a member's colour.
std::optional<std::pair<int, int>> placeOfAMember(const render::Picture& p) {
  for (std::size_t k = 0; k + 2 < p.rgb.size(); k += 3)
    if (isOfAMember(&p.rgb[k])) return std::pair(static_cast<int>(k / 3 % p.width), static_cast<int>(k / 3 / p.width));
  return std::nullopt;
}

TEST_F(Window, AnotherMemberIsMarkedWhereItIs) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "1"});
  const render::Picture alone = rested();
  const auto terrain = terrain::create("alpine", 1).value();
  const double ground = terrain->height({1400 * 256, 3600 * 256});
  const Place first{22, -14, 80}, second{-60, -70, 160};
  for (const Place& place : {first, second}) {
    ASSERT_GT(place.column(), 20);
    ASSERT_LT(place.column(), 300);
    ASSERT_FALSE(marks(alone, place.column(), place.row(), 8));
  }
  {
    Flier other(server.url(), {.threshold = 50}, wire::Pacing::kFree);
    const auto stand = [&](const Place& place) {
      camera::Camera camera;
      camera.pose.x = std::llround((1400 + place.right) * 256);
      camera.pose.z = std::llround((3600 - place.ahead) * 256);
      camera.pose.y = ground + 300 + place.up;
      camera.projection.width = camera.projection.height = 64;
      other.send(camera);
    };
    stand(first);
    EXPECT_TRUE(shows([&](const render::Picture& now) { return marks(now, first.column(), first.row(), 2); }));
    stand(second);
    EXPECT_TRUE(shows([&](const render::Picture& now) {
      return marks(now, second.column(), second.row(), 2) && !marks(now, first.column(), first.row(), 2);
    }));
    // Behind the camera it is in the list alone, and a click flies to it.
    stand({0, 0, -500});
    press({"m"});
    std::optional<std::pair<int, int>> dot;
    ASSERT_TRUE(shows([&](const render::Picture& now) { return (dot = placeOfAMember(now)).has_value(); }));
    click(dot->first + 30, dot->second);
    EXPECT_TRUE(shows([&](const render::Picture& now) { return marks(now, 160, 90, 3); })) << "flown to, it stands in the middle";
    // Not wanted in the picture, it is in the list alone; the box to tick is below the list.
    press({"m"});
    shot();
    shot();
    click(dot->first, dot->second + 28);
    press({"Escape"});
    EXPECT_TRUE(shows([&](const render::Picture& now) { return !placeOfAMember(now); })) << "though not wanted";
    press({"m"});
    EXPECT_TRUE(shows([&](const render::Picture& now) { return placeOfAMember(now).has_value(); })) << "it is gone, not hidden";
    press({"Escape"});
  }
  press({"m"});
  EXPECT_TRUE(shows([&](const render::Picture& now) { return !placeOfAMember(now); })) << "though it has left";
  close();
}

// The share of pixels that differ anywhere.
double changed(const render::Picture& a, const render::Picture& b) { return compare(a, b).moved; }

TEST_F(Window, HelpAndFiguresScroll) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "50", "--reduced-motion", "--text-scale", "2"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"1"});
  for (const char* const box : {"figures", "help"}) {
    if (box == std::string("help")) press({"h"});
    const render::Picture top = rested();
    press({"Next"});
    const render::Picture below = rested();
    EXPECT_GT(changed(top, below), 0.02) << box << " do not scroll by PageDown";
    EXPECT_TRUE(await([&] {  // a key counts twice where the machine keeps it down
      press({"Prior"});
      return changed(top, rested()) == 0;
    })) << box
        << " do not scroll back";
  }
  const render::Picture top = rested();
  runProgram({"xdotool", "mousemove", "--window", windowNumber(), "160", "60"}, environment_);
  shot();
  runProgram({"xdotool", "click", "5"}, environment_);
  EXPECT_TRUE(shows([&](const render::Picture& now) { return changed(top, now) > 0.02; })) << "no wheel";
  close();
}

TEST_F(Window, WhatTheServerSaysAboutTheClockIsShown) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "50", "--reduced-motion", "--screenshot", "last.png"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "1"});
  const render::Picture before = rested();  // pictures asked for by F12 are without such sentences
  std::this_thread::sleep_for(3s);          // the window's own sentence about the last of them is gone after 2
  wire::Hello hello;
  hello.clock = true;
  auto owner = link::Connection::open(core::parseUrl(server.url()).value(), hello).value();
  const auto heard = [&](const auto& wanted) {
    return await([&] { return owner->waitForClock(owner->clock().version(), 100ms), wanted(owner->clock().said()); }, 300s);
  };
  owner->setClock({true, wire::ClockMode::kStepped, 0});
  ASSERT_TRUE(heard([&](const wire::Clock& said) { return said.owner == owner->world().camera; }));
  viewer_->signal(SIGSTOP);  // it answers no step
  owner->step({1000, true});
  ASSERT_TRUE(heard([](const wire::Clock& said) { return said.step == 1 && said.waitsFor.size() == 1; }));
  owner->passOver(owner->clock().said().waitsFor.front());
  ASSERT_TRUE(heard([](const wire::Clock& said) { return said.waitsFor.empty(); }));
  viewer_->signal(SIGCONT);
  EXPECT_TRUE(says("was passed over at step 1")) << viewer_->output();
  close();
  const auto last = render::readPng(folder_ / "last.png");
  ASSERT_TRUE(last) << last.error().message;
  EXPECT_GT(compare(before, *last, 0.2, 0.8).moved, 0.05) << "no panel with the sentence";
}

TEST_F(Window, ASessionOfTheListIsEnteredByKeyboard) {
  ServerProcess server(RIDGECAST_SERVER);
  Flier other(server.url() + "?session=race&terrain=canyon&seed=7", {.threshold = 50});
  open({"--threshold", "50", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"1", "f"});
  const render::Picture alone = rested();
  bool entered = false;
  for (int attempt = 0; attempt < 5 && !entered; ++attempt) {  // at first the list may not have come yet
    press({"j"});
    shot();
    press({"Down", "Down", "Down", "Down", "Return"});  // z, above ground, Go, the other session
    entered = says("viewing canyon, seed 7", 20s);
    if (!entered) press({"Escape"});
  }
  ASSERT_TRUE(entered) << viewer_->output();
  EXPECT_TRUE(shows([&](const render::Picture& now) { return changed(alone, now) > 0.1; }));
  close();
}

TEST_F(Window, IsAsItWasWhenItClosed) {
  ServerProcess server(RIDGECAST_SERVER);
  const std::filesystem::path file = folder_ / "kept/ridgecast/window.json";
  const std::vector<std::string> few = {"--threshold", "50", "--reduced-motion"};
  const auto placeOf = [&] {
    press({"l"});
    EXPECT_TRUE(says("#x=")) << viewer_->output();
    const std::string said = viewer_->output();
    const std::size_t from = said.rfind("#x=");
    return said.substr(from, said.find('&', said.find("&z=", from) + 1) - from);
  };
  std::vector<std::string> first = few;
  for (const char* a : {"--size", "420x280", "--x", "1400", "--z", "3600", "--altitude", "300", "--text-scale", "2"}) first.emplace_back(a);
  openRemembering(first, server.url(), "kept");
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "x", "1"});
  ASSERT_EQ(runProgram({"xdotool", "windowsize", windowNumber(), "400", "260"}, environment_).code, 0);
  hold("w", 1500ms);
  ASSERT_TRUE(shows([](const render::Picture& now) { return now.width == 400 && now.height == 260; }));
  const std::string place = placeOf();
  EXPECT_NE(place, "#x=1400&z=3600");
  const render::Picture last = rested();
  close();

  openRemembering(few, server.url(), "kept");
  ASSERT_TRUE(opened()) << viewer_->output();
  const render::Picture again = rested();
  EXPECT_EQ(again.width, 400u);
  EXPECT_EQ(again.height, 260u);
  EXPECT_LT(compare(last, again).moved, 0.02) << "another place or mode, figures, or no wireframe";
  EXPECT_EQ(placeOf(), place);
  close();
  EXPECT_EQ(nlohmann::json::parse(readText(file))["text-scale"], 1) << "what the command line says is for once";

  // The command line wins; --fresh begins and leaves everything as if there were nothing.
  const std::string kept = readText(file);
  for (const std::string how : {"--fresh", "--x 5"}) {
    std::vector<std::string> given = few;
    for (const char* a : {"--size", "320x180"}) given.emplace_back(a);
    given.push_back(how);
    openRemembering(given, server.url(), "kept");
    ASSERT_TRUE(opened()) << viewer_->output();
    EXPECT_EQ(placeOf(), how == "--fresh" ? "#x=0&z=0" : "#x=5&z=0");
    EXPECT_EQ(shot().width, 320u);
    close();
    EXPECT_EQ(readText(file) == kept, how == "--fresh") << readText(file);
  }

  std::ofstream(file) << "{\"divider\": -1}";
  openRemembering({"--size", "320x180"}, server.url(), "kept");
  ASSERT_TRUE(opened()) << viewer_->output();
  EXPECT_TRUE(says("window.json is ignored: 'divider' should be")) << viewer_->output();
  close();
}

}  // namespace
}  // namespace ridgecast
