// The window at an X server without a screen, with keys that are really pressed (XTEST, by xdotool): modes change what is shown, places can be
// typed, and whatever ends a viewer ends it soon and with an exit code that says so.

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "client/render/picture.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using namespace std::chrono_literals;

// Until `done`, at most so long.
template <class Done>
bool await(Done done, std::chrono::milliseconds patience) {
  for (const auto until = std::chrono::steady_clock::now() + patience; std::chrono::steady_clock::now() < until;) {
    if (done()) return true;
    std::this_thread::sleep_for(50ms);
  }
  return done();
}

// An X server and a viewer on it.
class Keys : public testing::Test {
 protected:
  void SetUp() override {
    if (!programExists("Xvfb") || !programExists("xdotool")) GTEST_SKIP() << "Xvfb or xdotool is not installed (packages xvfb, xdotool)";
    screen_ = std::make_unique<Process>(std::vector<std::string>{"Xvfb", "-displayfd", "1", "-screen", "0", "800x600x24"});
    ASSERT_TRUE(await([&] { return screen_->output().find('\n') != std::string::npos; }, 20s)) << screen_->output();
    const std::string number = screen_->output();
    environment_ = {
        {"DISPLAY", ":" + number.substr(number.find_first_of("0123456789"), number.find('\n') - number.find_first_of("0123456789"))},
        {"WAYLAND_DISPLAY", {}}};
  }

  void open(std::vector<std::string> arguments, const std::string& url, const Environment& more = {}) {
    std::string command = "cd '" + (folder_ / "").string() + "' && exec '" RIDGECAST_CLIENT "' view '" + url +
                          "' --size 320x180 --x 1400 --z 3600 --altitude 300 --pitch -14";
    for (const std::string& a : arguments) command += " " + a;
    Environment all = environment_;
    all.insert(all.end(), more.begin(), more.end());
    viewer_ = std::make_unique<Process>(std::vector<std::string>{"sh", "-c", command}, all);
  }
  bool says(const std::string& text, std::chrono::milliseconds patience = 60s) {
    return await([&] { return viewer_->output().find(text) != std::string::npos || !viewer_->running(); }, patience) &&
           viewer_->output().find(text) != std::string::npos;
  }
  // Once the window is there.
  bool opened() {
    return says("viewing ", 30s) &&
           await(
               [&] {
                 return runProgram({"xdotool", "search", "--onlyvisible", "--name", "Ridgecast"}, environment_).code == 0;
               },
               20s);
  }
  void press(const std::vector<std::string>& keys) {
    for (const std::string& key : keys) {
      EXPECT_EQ(runProgram({"xdotool", "key", key}, environment_).code, 0);
      std::this_thread::sleep_for(100ms);
    }
  }
  void hold(const std::string& key, std::chrono::milliseconds time) {
    runProgram({"xdotool", "keydown", key}, environment_);
    std::this_thread::sleep_for(time);
    runProgram({"xdotool", "keyup", key}, environment_);
  }
  void type(const std::string& text) { EXPECT_EQ(runProgram({"xdotool", "type", "--delay", "60", "--", text}, environment_).code, 0); }

  render::Picture shot() {
    const std::string name = "ridgecast-" + std::to_string(++shots_) + ".png";
    press({"F12"});
    EXPECT_TRUE(says("is in " + name)) << viewer_->output();
    auto picture = render::readPng((folder_ / name).string());
    EXPECT_TRUE(picture);
    return picture ? *picture : render::Picture{};
  }
  // What is shown once it has come to rest.
  render::Picture rested() {
    render::Picture last = shot();
    for (int k = 0; k < 60; ++k) {
      std::this_thread::sleep_for(300ms);
      render::Picture now = shot();
      if (now.rgb == last.rgb) return now;
      last = std::move(now);
    }
    ADD_FAILURE() << "the picture does not come to rest";
    return last;
  }

  std::unique_ptr<Process> screen_, viewer_;
  Environment environment_;
  ScratchFolder folder_;
  int shots_ = 0;
};

// Means of the differences of two pictures of a size, 0..255, over the columns from `left` to `right` (0..1); without the lowest rows, where words are.
struct Difference {
  double mean = 0, darker = 0, moved = 0;  // shares of pixels that are darker, or differ, by more than 24
};
Difference compare(const render::Picture& a, const render::Picture& b, double left = 0, double right = 1) {
  Difference out;
  if (a.width != b.width || a.height != b.height) {
    ADD_FAILURE() << "pictures of two sizes";
    return out;
  }
  double n = 0;
  for (std::uint32_t row = 0; row < a.height * 8 / 10; ++row)
    for (auto column = static_cast<std::uint32_t>(left * a.width); column < static_cast<std::uint32_t>(right * a.width); ++column) {
      const std::size_t at = 3 * (std::size_t{row} * a.width + column);
      double sum = 0, most = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const double d = double{static_cast<double>(b.rgb[at + c])} - a.rgb[at + c];
        sum += d / 3;
        most = std::max(most, std::abs(d));
        out.mean += std::abs(d) / 3;
      }
      out.darker += sum < -24;
      out.moved += most > 24;
      ++n;
    }
  out.mean /= n;
  out.darker /= n;
  out.moved /= n;
  return out;
}

TEST_F(Keys, ChangeWhatIsShown) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "6", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"F3", "1"});  // no figures, the mesh alone
  std::this_thread::sleep_for(2s);
  const render::Picture mesh = rested();

  press({"f"});
  const Difference edges = compare(mesh, rested());
  EXPECT_GT(edges.darker, 0.03);  // edges are dark
  EXPECT_LT(edges.darker, 0.9);
  press({"f"});
  EXPECT_EQ(compare(mesh, rested()).mean, 0);  // and gone again

  press({"b"});
  const render::Picture levels = rested();
  EXPECT_GT(compare(mesh, levels).moved, 0.1);
  press({"b"});
  const Difference ages = compare(levels, shot());
  EXPECT_GT(ages.moved, 0.1);
  press({"b"});
  EXPECT_EQ(compare(mesh, rested()).mean, 0);

  // The ray march shows the same land, nearly; the difference of the two is dark; both side by side are each what they were.
  press({"2"});
  const render::Picture march = rested();
  const Difference same = compare(mesh, march);
  EXPECT_GT(same.mean, 0.1);
  EXPECT_LT(same.mean, 20);
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
  press({"c", "F1"});
  EXPECT_GT(compare(mesh, shot(), 0.5, 1).darker, 0.1);  // the list of keys

  press({"Escape", "Escape"});
  EXPECT_EQ(viewer_->wait(30s), 0) << viewer_->output();
  EXPECT_TRUE(server.healthy());
}

TEST_F(Keys, TypedPlacesAreReachedExactly) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"1", "j"});
  shot();  // a picture: what was pressed before it is done
  shot();
  type("1000000000001");
  press({"Tab"});
  shot();
  type("-77");
  press({"Return"});
  shot();
  shot();
  press({"r"});
  shot();
  press({"r"});
  ASSERT_TRUE(says("the path flown is in ridgecast-1.json")) << viewer_->output();
  const auto path = nlohmann::json::parse(readText(folder_ / "ridgecast-1.json"));
  const auto& place = path["keyframes"].front();
  EXPECT_EQ(place["x"].get<double>(), 1000000000001.0);
  EXPECT_EQ(place["z"].get<double>(), -77);
  press({"Escape"});
  EXPECT_EQ(viewer_->wait(30s), 0) << viewer_->output();
}

TEST_F(Keys, AServerThatGoesIsToldAndTheExitCodeSaysSo) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  server.process().signal(SIGKILL);
  EXPECT_TRUE(says("trying again")) << viewer_->output();
  press({"Escape"});
  EXPECT_EQ(viewer_->wait(30s), 1) << viewer_->output();
  EXPECT_NE(viewer_->output().find("closed without a connection"), std::string::npos) << viewer_->output();
}

TEST_F(Keys, ClosedInTheMiddleOfADownloadItEndsAtOnce) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "0.05", "--budget", "2000000"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  press({"Escape"});
  EXPECT_EQ(viewer_->wait(30s), 0) << viewer_->output();
  EXPECT_TRUE(server.healthy());
}

TEST_F(Keys, WithoutOpenGL33ItSaysWhatToDo) {
  ServerProcess server(RIDGECAST_SERVER);
  open({}, server.url(), {{"MESA_GL_VERSION_OVERRIDE", "2.1"}});
  EXPECT_EQ(viewer_->wait(30s), 3) << viewer_->output();
  EXPECT_NE(viewer_->output().find("OpenGL 3.3"), std::string::npos) << viewer_->output();
  EXPECT_NE(viewer_->output().find("driver"), std::string::npos) << viewer_->output();
}

}  // namespace
}  // namespace ridgecast
