// The window at an X server without a screen, with keys that are really pressed: modes change what is shown, places can be typed, and
// whatever ends a viewer ends it soon and with an exit code that says so.

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "tests/e2e/window.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

class Keys : public WindowTest {};

TEST_F(Keys, ChangeWhatIsShown) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "6", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "1"});  // no figures, the mesh alone
  const render::Picture mesh = rested();

  press({"x"});
  const Difference edges = compare(mesh, rested());
  EXPECT_GT(edges.darker, 0.03);  // edges are dark
  EXPECT_LT(edges.darker, 0.9);
  press({"x"});
  EXPECT_EQ(compare(mesh, rested()).mean, 0);  // and gone again

  press({"n"});
  const render::Picture levels = rested();
  EXPECT_GT(compare(mesh, levels).moved, 0.1);
  press({"n"});
  const Difference ages = compare(levels, shot());
  EXPECT_GT(ages.moved, 0.1);
  press({"n"});
  EXPECT_EQ(compare(mesh, rested()).mean, 0);

  // The ray march shows the same land, nearly; the difference of the two is dark; both side by side are each what they were.
  press({"2"});
  const render::Picture march = rested();
  const Difference same = compare(mesh, march);
  EXPECT_GT(same.mean, 0.1);
  EXPECT_LT(same.mean, 20);
  press({"1", "t"});  // the mesh as it is, instead of corrected onto the true surface
  EXPECT_GT(compare(rested(), march).mean, 2 * same.mean);
  press({"t"});
  EXPECT_EQ(compare(mesh, rested()).mean, 0);
  press({"4"});
  const render::Picture difference = rested();
  EXPECT_GT(compare(mesh, difference).darker, 0.5);
  press({"3"});
  const render::Picture both = rested();
  EXPECT_EQ(compare(mesh, both, 0, 0.45).mean, 0);
  EXPECT_EQ(compare(march, both, 0.55, 1).mean, 0);
  press({"1"});

  // A frozen camera sees what it saw; from outside the rest lies in the dark, and the mesh stays what it was.
  press({"c"});
  std::this_thread::sleep_for(2500ms);  // the hint goes
  const render::Picture frozen = rested();
  EXPECT_LT(compare(mesh, frozen).moved, 0.08);  // the edges of what it sees are the window's own
  hold("s", 1500ms);
  const render::Picture outside = rested();
  EXPECT_GT(compare(frozen, outside).darker, 0.01);
  press({"c", "h"});
  EXPECT_TRUE(shows([&](const render::Picture& now) { return compare(mesh, now, 0.5, 1).darker > 0.1; })) << "the list of keys";

  press({"Escape", "Escape"});  // closes the list; ends nothing yet
  shot();
  EXPECT_TRUE(viewer_->running()) << viewer_->output();
  press({"Escape", "Escape"});
  EXPECT_EQ(viewer_->wait(300s), 0) << viewer_->output();
  EXPECT_TRUE(server.healthy());
}

TEST_F(Keys, CandidatesAreDotsForAsLongAsTheyAreWanted) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "6", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"f", "1"});
  const render::Picture mesh = rested();
  press({"k"});
  Difference dots;
  EXPECT_TRUE(shows([&](const render::Picture& now) { return (dots = compare(mesh, now)).moved > 0.01; }));
  EXPECT_LT(dots.moved, 0.7);
  press({"k"});
  EXPECT_TRUE(shows([&](const render::Picture& now) { return compare(mesh, now).mean == 0; })) << "dots, or another mesh, are left";
  quit();
  EXPECT_EQ(viewer_->wait(300s), 0) << viewer_->output();
  EXPECT_TRUE(server.healthy());
}

TEST_F(Keys, TypedPlacesAreReachedExactly) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  // As fast as it can be typed: many keys come within one frame.
  type("1j1000000000001\t-77");
  press({"Return"});
  const std::string place = "x=1000000000001&z=-77&";
  // An L that comes before the panel is closed is typed into it.
  ASSERT_TRUE(await([&] { return press({"l"}), viewer_->output().find(place) != std::string::npos; }, 300s)) << viewer_->output();
  press({"r"});
  shot();
  press({"r"});
  ASSERT_TRUE(says("the path flown is in ridgecast-1.json")) << viewer_->output();
  press({"Escape"});  // the panel is closed already; ends nothing
  const auto path = nlohmann::json::parse(readText(folder_ / "ridgecast-1.json"));
  const auto& first = path["keyframes"].front();
  EXPECT_EQ(first["x"].get<double>(), 1000000000001.0);
  EXPECT_EQ(first["z"].get<double>(), -77);
  // What was recorded is followed: back to where it was.
  hold("w", 1500ms);
  press({"o"});
  shot();
  shot();
  press({"r"});
  shot();
  press({"r"});
  ASSERT_TRUE(says("the path flown is in ridgecast-2.json")) << viewer_->output();
  const auto again = nlohmann::json::parse(readText(folder_ / "ridgecast-2.json"));
  EXPECT_NEAR(again["keyframes"].back()["z"].get<double>(), -77, 0.01);
  quit();
  EXPECT_EQ(viewer_->wait(300s), 0) << viewer_->output();
}

TEST_F(Keys, AServerThatGoesIsToldAndTheExitCodeSaysSo) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  server.process().signal(SIGKILL);
  EXPECT_TRUE(says("trying again")) << viewer_->output();
  quit();
  EXPECT_EQ(viewer_->wait(300s), 1) << viewer_->output();
  EXPECT_NE(viewer_->output().find("closed without a connection"), std::string::npos) << viewer_->output();
}

TEST_F(Keys, ClosedInTheMiddleOfADownloadItEndsAtOnce) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "0.05", "--budget", "2000000"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  quit();
  EXPECT_EQ(viewer_->wait(300s), 0) << viewer_->output();
  EXPECT_TRUE(server.healthy());
}

TEST_F(Keys, WithoutOpenGL33ItSaysWhatToDo) {
  ServerProcess server(RIDGECAST_SERVER);
  open({}, server.url(), {{"MESA_GL_VERSION_OVERRIDE", "2.1"}});
  EXPECT_EQ(viewer_->wait(300s), 3) << viewer_->output();
  EXPECT_NE(viewer_->output().find("OpenGL 3.3"), std::string::npos) << viewer_->output();
  EXPECT_NE(viewer_->output().find("driver"), std::string::npos) << viewer_->output();
}

}  // namespace
}  // namespace ridgecast
