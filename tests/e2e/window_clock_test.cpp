// The session's clock driven by keys that are really pressed: in a world, and in a recording of a server that was killed.

#include <gtest/gtest.h>

#include <csignal>
#include <cstdio>
#include <memory>
#include <string>

#include "client/link/connection.h"
#include "tests/e2e/window.h"
#include "tests/support/flier.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

class WindowClock : public WindowTest {
 protected:
  void look(const std::string& url) {
    open({"--threshold", "20", "--reduced-motion"}, url);
    ASSERT_TRUE(opened()) << viewer_->output();
    press({"f", "1"});
  }
  void join(const std::string& url) {
    wire::Hello hello;
    hello.clock = true;
    onlooker_ = link::Connection::open(core::parseUrl(url).value(), hello, {.reconnects = false, .timeout = kTimeout}).value();
  }
  // The clock as another member sees it, once nobody has it and it is as wanted.
  bool hears(const auto& wanted) {
    if (await([&] {
          const wire::Clock said = onlooker_->clock().said();
          return onlooker_->waitForClock(0, 100ms) && said.owner == 0 && wanted(said);
        }))
      return true;
    const wire::Clock said = onlooker_->clock().said();
    std::printf("heard: mode %d, rate %g, time %llu, owner %llu\n", static_cast<int>(said.mode), said.rate,
                static_cast<unsigned long long>(said.time), static_cast<unsigned long long>(said.owner));
    return false;
  }
  std::unique_ptr<link::Connection> onlooker_;
};

TEST_F(WindowClock, KeysDriveItWhileItIsShown) {
  ServerProcess server(RIDGECAST_SERVER);
  look(server.url());
  join(server.url());
  press({"z", "v", "apostrophe"});
  EXPECT_TRUE(hears([](const wire::Clock& said) { return said.mode == wire::ClockMode::kScaled && said.rate == 2; })) << "z did nothing";
  press({"z"});
  ASSERT_TRUE(hears([](const wire::Clock& said) { return said.mode == wire::ClockMode::kStepped; }));
  const std::uint64_t before = onlooker_->clock().said().time;
  press({"0"});  // ten seconds from what it shows: where it draws slowly, it has not heard yet at which moment the clock stood still
  EXPECT_TRUE(hears([&](const wire::Clock& said) { return said.time > before + 5'000'000 && said.time < before + 15'000'000; }));
  press({"9"});
  EXPECT_TRUE(says("Time goes back only in recordings.")) << viewer_->output();
  press({"semicolon"});  // what it goes on with
  shot();                // where the X server has to wait, GLFW takes two of one key for one that is held
  press({"semicolon", "z"});
  EXPECT_TRUE(hears([](const wire::Clock& said) { return said.mode == wire::ClockMode::kScaled && said.rate == 0.5; }));
  // Somebody else's is theirs.
  onlooker_->setClock({true, wire::ClockMode::kRealTime, 1});
  ASSERT_TRUE(await([&] { return onlooker_->clock().said().owner == onlooker_->world().camera; }));
  press({"z"});
  shot();
  EXPECT_EQ(onlooker_->clock().said().mode, wire::ClockMode::kRealTime);
  onlooker_->setClock({.own = false});
  EXPECT_TRUE(await([&] {  // at first the window may not have heard that it is free
    press({"z"});
    return onlooker_->clock().said().mode == wire::ClockMode::kStepped;
  }));
  close();
}

TEST_F(WindowClock, ARecordingIsPausedAndGoesBack) {
  const std::string recordings = (folder_ / "recordings").string();
  {
    ServerProcess server(RIDGECAST_SERVER, {"--record", recordings});
    Flier flier(server.url(), {.threshold = 20});
    camera::Camera camera;
    camera.pose = {.x = 1400 * 256, .z = 3600 * 256, .y = 2700};
    for (int k = 0; k < 40; ++k) {
      camera.pose.x += 512;
      flier.step(camera);
      std::this_thread::sleep_for(100ms);
    }
    std::this_thread::sleep_for(2s);  // a block
    server.process().signal(SIGKILL);
    server.process().wait(60s);
  }
  const ServerProcess player(RIDGECAST_SERVER, {"replay", recordings, "--serve"});
  const std::string url = player.url();
  join(url);
  onlooker_->setClock({true, wire::ClockMode::kStepped, 0});
  onlooker_->setClock({.own = false});
  look(url);
  press({"0"});  // the clock is shown by itself
  ASSERT_TRUE(hears([](const wire::Clock& said) { return said.end > 2'000'000 && said.time == said.end; }));
  const std::uint64_t end = onlooker_->clock().said().end;
  press({"9"});
  EXPECT_TRUE(says("connected again")) << viewer_->output();
  ASSERT_TRUE(await([&] { return onlooker_->error().has_value(); }));
  join(url);
  ASSERT_TRUE(hears([&](const wire::Clock& said) { return said.end == end && said.time == (end > 10'000'000 ? end - 10'000'000 : 1); }));
  press({"z"});
  EXPECT_TRUE(hears([](const wire::Clock& said) { return said.mode == wire::ClockMode::kRealTime; }));
  close();
}

}  // namespace
}  // namespace ridgecast
