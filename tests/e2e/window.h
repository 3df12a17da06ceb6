#pragma once
// A viewer's window at an X server without a screen, with keys that are really pressed (XTEST, by xdotool). Deadlines are there to end what
// hangs and are long: the machine may be slow, and busy with other things. Nothing is judged by time.

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "client/render/picture.h"
#include "tests/support/process.h"
#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

using namespace std::chrono_literals;

// An X server and a viewer on it.
class WindowTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!programExists("Xvfb") || !programExists("xdotool")) GTEST_SKIP() << "Xvfb or xdotool is not installed (packages xvfb, xdotool)";
    startScreen();
  }
  // The line that is a number alone; where other X servers run, complaints about theirs come before it.
  std::string displayNumber() const {
    std::istringstream lines(screen_->output());
    for (std::string line; std::getline(lines, line);)
      if (!line.empty() && !lines.eof() && line.find_first_not_of("0123456789") == std::string::npos) return line;
    return {};
  }
  void startScreen() {
    screen_ =
        std::make_unique<Process>(std::vector<std::string>{"Xvfb", "-displayfd", "1", "-noreset", "-r", "-screen", "0", "800x600x24"});
    ASSERT_TRUE(await([&] { return !displayNumber().empty(); }, 60s)) << screen_->output();
    environment_ = {{"DISPLAY", ":" + displayNumber()}, {"WAYLAND_DISPLAY", {}}};
  }

  // Where all windows begin, so that what another one remembers is nothing to them.
  void open(std::vector<std::string> arguments, const std::string& url, const Environment& more = {}) {
    for (const char* a : {"--x 1400 --z 3600 --altitude 300 --pitch -14", "--size"}) arguments.emplace_back(a);
    arguments.push_back(size_);
    openRemembering(arguments, url, "configuration-" + std::to_string(++opened_), more);
  }
  // With a folder in which it keeps what it remembers.
  void openRemembering(const std::vector<std::string>& arguments, const std::string& url, const std::string& configuration,
                       const Environment& more = {}) {
    std::string command = "cd '" + (folder_ / "").string() + "' && exec '" RIDGECAST_CLIENT "' view '" + url + "'";
    for (const std::string& a : arguments) command += " " + a;
    Environment all = environment_;
    all.emplace_back("XDG_CONFIG_HOME", folder_ / configuration);
    all.insert(all.end(), more.begin(), more.end());
    viewer_ = std::make_unique<Process>(std::vector<std::string>{"sh", "-c", command}, all);
  }
  bool says(const std::string& text, std::chrono::milliseconds timeout = 300s) {
    return await([&] { return viewer_->output().find(text) != std::string::npos || !viewer_->running(); }, timeout) &&
           viewer_->output().find(text) != std::string::npos;
  }
  // Once the window is there, and drawn as it stays.
  bool opened() {
    return appeared() && await([&] { return drawn() || !viewer_->running(); }, 300s) && drawn();
  }
  bool drawn() const {
    const std::string said = viewer_->output();
    return said.find("the graphics driver compiles") == std::string::npos || said.find("own colours") != std::string::npos ||
           said.find("warning: ") != std::string::npos;
  }
  bool appeared() {
    return says("viewing ") &&
           await(
               [&] {
                 return runProgram({"xdotool", "search", "--onlyvisible", "--name", "Ridgecast"}, environment_).code == 0;
               },
               300s);
  }
  // The window's number, as xdotool has it.
  std::string windowNumber() {
    const std::string found = runProgram({"xdotool", "search", "--onlyvisible", "--name", "Ridgecast"}, environment_).output;
    return found.substr(0, found.find('\n'));
  }
  void press(const std::vector<std::string>& keys) {
    for (const std::string& key : keys) {
      EXPECT_EQ(runProgram({"xdotool", "key", key}, environment_).code, 0);
      std::this_thread::sleep_for(100ms);
    }
  }
  void quit() { press({"ctrl+q"}); }
  void close(int code = 0) {
    quit();
    EXPECT_EQ(viewer_->wait(300s), code) << viewer_->output();
  }
  void hold(const std::string& key, std::chrono::milliseconds time) {
    runProgram({"xdotool", "keydown", key}, environment_);
    std::this_thread::sleep_for(time);
    runProgram({"xdotool", "keyup", key}, environment_);
  }
  void type(const std::string& text) { EXPECT_EQ(runProgram({"xdotool", "type", "--delay", "3", "--", text}, environment_).code, 0); }

  // Until a picture is as wanted.
  template <class Wanted>
  bool shows(Wanted wanted) {
    return await([&] { return wanted(shot()); }, 300s);
  }

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
    for (int k = 0; k < 300; ++k) {
      std::this_thread::sleep_for(100ms);
      render::Picture now = shot();
      const std::string said = "ridgecast-" + std::to_string(shots_) + ".png";
      if (now.rgb == last.rgb && viewer_->output().find(said + ", and was still") == std::string::npos) return now;
      last = std::move(now);
    }
    ADD_FAILURE() << "the picture does not come to rest";
    return last;
  }

  std::string size_ = "320x180";
  std::unique_ptr<Process> screen_, viewer_;
  Environment environment_;
  ScratchFolder folder_;
  int shots_ = 0, opened_ = 0;
};

// Means of the differences of two pictures of a size, 0..255, over the columns from `left` to `right` (0..1); without the lowest rows,
// where words are.
struct Difference {
  double mean = 0, darker = 0, moved = 0;  // shares of pixels that are darker, or differ, by more than 24
};
inline Difference compare(const render::Picture& a, const render::Picture& b, double left = 0, double right = 1) {
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

}  // namespace ridgecast::testing_support
