// Recordings as people make and use them: a real server is recorded, killed, replayed, played to onlookers; flights are flown again.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/link/connection.h"
#include "client/world/world.h"
#include "tests/support/flier.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using namespace testing_support;
using testing::HasSubstr;

constexpr const char* kCrater = R"({"op":"crater","x":1600,"z":3000,"radius":20,"depth":6})";

class RecordingEndToEnd : public testing::Test {
 protected:
  static wire::Settings coarse() {
    wire::Settings settings;
    settings.threshold = 5;
    settings.triangleBudget = 50'000;
    return settings;
  }
  camera::Camera at(int step) const {
    camera::Camera camera;
    camera.pose.x = 400'000 + 3000 * step;
    camera.pose.z = 800'000 - 2000 * step;
    camera.pose.y = 2300 - step;
    camera.pose.yaw = -0.3 + 0.01 * step;
    camera.pose.pitch = -0.25;
    return camera;
  }
  // One camera's flight, in one part.
  fs::path record(int steps) {
    ServerProcess server(RIDGECAST_SERVER, {"--record", recordings.string()});
    {
      Flier flier(server.url(), coarse());
      for (int k = 0; k < steps; ++k) flier.step(at(k));
    }
    EXPECT_EQ(server.stop(), 0);
    return fs::directory_iterator(recordings)->path();
  }
  Finished replay(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {RIDGECAST_SERVER, "replay"});
    return runProgram(arguments);
  }
  std::uintmax_t recordedBytes() const {
    std::uintmax_t sum = 0;
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(recordings, none)) sum += entry.file_size(none);
    return sum;
  }

  ScratchFolder folder;
  const fs::path recordings = folder / "recordings";
};

TEST_F(RecordingEndToEnd, RecordReplayExportAndFlyAgain) {
  {
    ServerProcess server(RIDGECAST_SERVER, {"--record", recordings.string(), "--seed", "3"});
    std::optional<Flier> lockstep(std::in_place, server.url(), coarse()), free(std::in_place, server.url(), coarse(), wire::Pacing::kFree);
    for (int k = 0; k < 20; ++k) {
      if (k == 10) {
        ASSERT_TRUE(lockstep->connection().edit({0, "", kCrater}).get());
      }
      lockstep->step(at(k));
      free->send(at(2 * k));
      while (free->take(20ms)) {
      }
    }
    lockstep.reset();
    free.reset();
    EXPECT_EQ(server.stop(), 0);
  }
  for (const char* threads : {"1", "2", "8"}) {
    const Finished whole = replay({recordings.string(), "--threads", threads});
    EXPECT_EQ(whole.code, 0) << whole.output;
    EXPECT_THAT(whole.output, HasSubstr("1 session, 2 cameras, "));
    EXPECT_THAT(whole.output, HasSubstr(", all equal; 1 edit, 0 questions; "));
  }
  const Finished later = replay({recordings.string(), "--from", "0.3"});
  EXPECT_EQ(later.code, 0) << later.output;
  EXPECT_THAT(later.output, HasSubstr("all equal"));
  const Finished other = replay({recordings.string(), "--terrain", "canyon"});
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.output, HasSubstr("content hash"));
  // The flights, and one of them again.
  const fs::path paths = folder / "paths";
  const Finished written = replay({recordings.string(), "--export", paths.string()});
  EXPECT_EQ(written.output, "2 paths in " + paths.string() + "\n");
  fs::path path;
  for (const auto& entry : fs::directory_iterator(paths))
    if (entry.path().filename().string().ends_with(".camera-1.json")) path = entry.path();
  const auto json = nlohmann::json::parse(readText(path));
  EXPECT_EQ(json["terrain"], "alpine");
  EXPECT_EQ(json["seed"], 3);
  ASSERT_EQ(json["keyframes"].size(), 20u);
  EXPECT_EQ(json["keyframes"][19]["x"], (400'000 + 3000 * 19) / 256.0);
  EXPECT_EQ(json["keyframes"][19]["y"], 2281);
  ServerProcess server(RIDGECAST_SERVER, {"--seed", "3"});
  const Finished flown = runProgram({RIDGECAST_CLIENT, "fly", server.url(), "--path", path.string(), "--out", (folder / "out").string(),
                                     "--size", "64x48", "--threshold", "5", "--frames-every", "99"});
  EXPECT_EQ(flown.code, 0) << flown.output;
}

TEST_F(RecordingEndToEnd, RecordingsOfSeveralServersAreOneSession) {
  std::vector<std::string> folders;
  for (const char* name : {"a", "b"}) {
    folders.push_back((folder / name).string());
    ServerProcess server(RIDGECAST_SERVER, {"--record", folders.back()});
    {
      Flier flier(server.url(), coarse());
      for (int k = 0; k < 5; ++k) flier.step(at(k));
    }
    EXPECT_EQ(server.stop(), 0);
  }
  const Finished both = replay({folders[1], folders[0], "--threads", "2"});
  EXPECT_EQ(both.code, 0) << both.output;
  EXPECT_THAT(both.output, HasSubstr("1 session, 2 cameras, "));
  const Finished nothing = replay({folders[0], (folder / "none").string()});
  EXPECT_EQ(nothing.code, 2);
  EXPECT_THAT(nothing.output, HasSubstr("There is no file or folder"));
  ServerProcess(RIDGECAST_SERVER, {"--record", folders[1], "--seed", "3"}).stop();
  const Finished other = replay(folders);
  EXPECT_EQ(other.code, 2) << other.output;
}

TEST_F(RecordingEndToEnd, AfterKillItIsReplayedToItsLastRecord) {
  ServerProcess server(RIDGECAST_SERVER, {"--record", recordings.string()});
  Flier flier(server.url(), coarse());
  std::uintmax_t before = 0;
  int steps = 0;
  ASSERT_TRUE(await([&] {  // two blocks with iterations in them
    flier.step(at(steps++ % 40));
    if (before == 0 && steps > 2) before = recordedBytes();
    return before > 0 && recordedBytes() > before + 500;
  }));
  server.process().signal(SIGKILL);
  server.process().wait(60s);
  const Finished replayed = replay({recordings.string()});
  EXPECT_EQ(replayed.code, 0) << replayed.output;
  EXPECT_THAT(replayed.output, HasSubstr("1 session, 1 camera, "));
  EXPECT_THAT(replayed.output, HasSubstr("all equal"));
  // With the last block torn, too.
  fs::path part;
  for (const auto& entry : fs::directory_iterator(recordings)) part = entry.path();
  fs::resize_file(part, fs::file_size(part) - 3);
  const Finished torn = replay({part.string()});
  EXPECT_EQ(torn.code, 0) << torn.output;
  EXPECT_THAT(torn.output, HasSubstr("was not written in whole"));
  EXPECT_THAT(torn.output, HasSubstr("all equal"));
}

// The same program: terrain, refinement and the C library then choose their functions for a processor without AVX and FMA.
TEST_F(RecordingEndToEnd, AProcessorWithoutAvxMakesTheSameMeshes) {
  if (!programExists("qemu-x86_64")) GTEST_SKIP() << "qemu-x86_64 is not installed (package qemu-user)";
  {
    ServerProcess server(RIDGECAST_SERVER, {"--record", recordings.string()});
    Flier flier(server.url(), coarse());
    for (int k = 0; k < 8; ++k) {
      if (k == 4) {
        ASSERT_TRUE(flier.connection().edit({0, "", kCrater}).get());
      }
      flier.step(at(5 * k));
    }
    EXPECT_EQ(server.stop(), 0);
  }
  const Finished replayed = runProgram({"qemu-x86_64", "-cpu", "Nehalem", RIDGECAST_SERVER, "replay", recordings.string()});
  EXPECT_EQ(replayed.code, 0) << replayed.output;
  EXPECT_THAT(replayed.output, HasSubstr("1 camera, 8 iterations, all equal; 1 edit, "));
}

TEST_F(RecordingEndToEnd, BeginsWithTheEditsThatWereKept) {
  const std::string state = (folder / "state").string();
  const auto fly = [&](const std::vector<std::string>& arguments, const std::string& edit) {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    {
      Flier flier(server.url(), coarse());
      for (int k = 0; k < 6; ++k) {
        flier.step(at(k));
        if (k == 2) {
          ASSERT_TRUE(flier.connection().edit({0, "", edit}).get());
        }
      }
    }
    EXPECT_EQ(server.stop(), 0);
  };
  fly({"--state", state}, kCrater);
  const std::vector<std::string> recorded{"--state", state, "--record", recordings.string()};
  fly(recorded, R"({"op":"undo","edit":1})");
  const Finished replayed = replay({recordings.string()});
  EXPECT_EQ(replayed.code, 0) << replayed.output;
  EXPECT_THAT(replayed.output, HasSubstr("1 camera, 6 iterations, all equal; 2 edits, "));
  // Edits that were compacted cannot be repeated: there is no other recording.
  ASSERT_EQ(runProgram({RIDGECAST_SERVER, "edits", "compact", state + "/default.edits"}).code, 0);
  fly(recorded, kCrater);
  EXPECT_THAT(replay({recordings.string()}).output, HasSubstr("1 session, 1 camera, 6 iterations"));
}

TEST_F(RecordingEndToEnd, OnlookersSeeItsMembersAndItsGround) {
  {
    ServerProcess server(RIDGECAST_SERVER, {"--record", recordings.string()});
    {
      Flier flier(server.url(), coarse());
      for (int k = 0; k < 10; ++k) flier.step(at(k));
      std::this_thread::sleep_for(3s);  // in which it can be seen
      ASSERT_TRUE(flier.connection().edit({0, "", kCrater}).get());
    }
    EXPECT_EQ(server.stop(), 0);
  }
  // It is played on this server alone, without the engine of the environment's others.
  const ServerProcess player(RIDGECAST_SERVER, {"replay", recordings.string(), "--serve"}, 0,
                             {{"RIDGECAST_SHARED", "redis://127.0.0.1:1"}});
  wire::Hello hello;
  hello.members = hello.clock = hello.edits = true;
  const auto url = core::parseUrl(player.url()).value();
  auto onlooker = link::Connection::open(url, hello, {.reconnects = false, .timeout = kTimeout}).value();
  EXPECT_GT(onlooker->world().camera, 1u);
  const auto member = [&]() -> std::optional<wire::Member> {
    const auto roster = onlooker->others();
    if (!roster || !roster->others().contains(1)) return {};
    return roster->others().at(1).member;
  };
  EXPECT_TRUE(await([&] {
    const auto seen = member();
    return seen && seen->moved && seen->moved->pose.sequence == 10 && seen->moved->pose.camera == at(9);
  }));
  const auto refused = onlooker->edit({0, "", kCrater}).get();
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("plays a recording"));
  // Who takes the clock skips ahead to the end.
  onlooker->setClock({true, wire::ClockMode::kStepped, 0});
  onlooker->step({3'600'000'000, false});
  EXPECT_TRUE(await([&] { return !onlooker->takeEdits().made.empty(); }));
  EXPECT_TRUE(await([&] { return !member(); }));
  EXPECT_FALSE(onlooker->error());
  const wire::Clock over = onlooker->clock().said();
  EXPECT_GT(over.end, 3'000'000u);
  EXPECT_EQ(over.time, over.end);
  // To an earlier time the session begins again, with the ground and the members of then, and stands as it did.
  onlooker->setClock({true, wire::ClockMode::kStepped, 0, 1});
  ASSERT_TRUE(await([&] { return onlooker->error().has_value(); }));
  EXPECT_THAT(onlooker->error()->message, HasSubstr("The session begins again"));
  onlooker = link::Connection::open(url, hello, {.reconnects = false, .timeout = kTimeout}).value();
  ASSERT_TRUE(onlooker->waitForClock(0, kTimeout));
  EXPECT_EQ(onlooker->clock().said().time, 1u);
  EXPECT_EQ(onlooker->clock().said().end, over.end);
  EXPECT_EQ(onlooker->world().edit, 0u);
  EXPECT_FALSE(member());
  onlooker->setClock({true, wire::ClockMode::kStepped, 0, over.end - 1});
  EXPECT_TRUE(await([&] { return !onlooker->takeEdits().made.empty(); }));
  EXPECT_FALSE(onlooker->error());
  // A program's calls: they come back by themselves.
  onlooker.reset();
  const auto program = world::World::join(player.url(), {.camera = false}).value();
  const std::chrono::microseconds end(over.end);
  ASSERT_TRUE(program->isLocal());
  const auto ground = [&] { return program->terrain().height(1600, 3000).value(); };
  const double cratered = ground();
  for (const auto to : {end - 1us, 1'000'000us, 2'000'000us, 5us, end + 1s}) {
    const auto jumped = program->jump(to, kTimeout);
    ASSERT_TRUE(jumped) << jumped.error().message;
    EXPECT_EQ(program->clock().said().time, static_cast<std::uint64_t>(std::min(to, end).count()));
    EXPECT_EQ(program->clock().said().mode, wire::ClockMode::kStepped);
    if (to < 3s)
      EXPECT_GT(ground(), cratered + 5) << "at " << to.count() << " us the crater was not made yet";
    else
      EXPECT_TRUE(await([&] { return ground() == cratered; }));
  }
}

// Whoever joined before had a number and a clock that the recording then took.
TEST_F(RecordingEndToEnd, ListensOnceTheRecordingIsRead) {
  const fs::path first = record(3);
  std::string name = first.filename().string();
  const fs::path second = recordings / name.replace(name.find(".0001."), 6, ".0002.");
  ASSERT_EQ(mkfifo(second.c_str(), 0600), 0);  // reading it waits for us
  const std::string portFile = (folder / "port").string();
  Process player({RIDGECAST_SERVER, "replay", recordings.string(), "--serve", "--port", "0", "--port-file", portFile, "--quiet"});
  int pipe = -1;
  ASSERT_TRUE(await([&] { return (pipe = ::open(second.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC)) >= 0 || !player.running(); }));
  ASSERT_GE(pipe, 0) << player.output();
  EXPECT_FALSE(fs::exists(portFile));
  fs::remove(second);
  std::ofstream(second).flush();  // a part that was only begun
  ::close(pipe);
  ASSERT_TRUE(await([&] { return !readText(portFile).empty() || !player.running(); })) << player.output();
  wire::Hello hello;
  hello.clock = true;
  const auto url = core::parseUrl("127.0.0.1:" + std::to_string(std::stoul(readText(portFile)))).value();
  const auto onlooker = link::Connection::open(url, hello, {.reconnects = false, .timeout = kTimeout}).value();
  EXPECT_EQ(onlooker->world().camera, 2u);
  ASSERT_TRUE(onlooker->waitForClock(0, kTimeout));
  EXPECT_GT(onlooker->clock().said().end, 0u);
}

TEST_F(RecordingEndToEnd, WhatIsExportedOfADamagedRecordingIsSaidToBeShort) {
  const fs::path part = record(5);
  const std::string out = (folder / "paths").string();
  const std::string whole = readText(part);
  std::ofstream(part) << whole << whole.substr(0, whole.size() / 2);
  const Finished torn = replay({part.string(), "--export", out});
  EXPECT_EQ(torn.code, 0) << torn.output;
  EXPECT_THAT(torn.output, HasSubstr("was not written in whole"));
  std::ofstream(part) << whole << "something else";
  const Finished damaged = replay({part.string(), "--export", out});
  EXPECT_EQ(damaged.code, 1) << damaged.output;
  EXPECT_THAT(damaged.output, HasSubstr(" s is not read."));
  EXPECT_THAT(damaged.output, HasSubstr("1 path in " + out));
}

// Ticks of a processor that the process has taken, and its recording thread.
std::pair<double, double> ticks(pid_t process) {
  double all = 0, recorder = 0;
  for (const auto& task : fs::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    std::istringstream stat(readText(task.path() / "stat"));
    std::string field;
    double spent = 0;
    for (int k = 1; stat >> field; ++k)
      if (k == 14 || k == 15) spent += std::stod(field);  // utime, stime; the names of our threads have no spaces
    all += spent;
    if (readText(task.path() / "comm") == "recorder\n") recorder += spent;
  }
  return {all, recorder};
}

TEST_F(RecordingEndToEnd, TakesLittle) {
  if (!measures()) GTEST_SKIP() << "MEASURE is not set";
  constexpr int kFliers = 8, kSeconds = 60;
  ServerProcess server(RIDGECAST_SERVER, {"--record", recordings.string()});
  std::vector<std::thread> fliers;
  for (int n = 0; n < kFliers; ++n)
    fliers.emplace_back([&, n] {
      Flier flier(server.url(), coarse(), wire::Pacing::kFree);
      const auto start = std::chrono::steady_clock::now();
      for (int k = 0; k < 10 * kSeconds; ++k) {  // 50 m/s along a curve
        camera::Camera camera = at(0);
        const double t = k * 0.1;
        camera.pose.x += static_cast<lattice::Step>(12'800 * t) + n * 500'000;
        camera.pose.z += static_cast<lattice::Step>(256 * 100 * std::sin(t / 5));
        camera.pose.y += 40 * std::sin(t / 3 + n);
        camera.pose.yaw = std::sin(t / 5) - n;
        flier.send(camera);
        for (const auto next = start + k * 100ms; std::chrono::steady_clock::now() < next;) flier.take(5ms);
      }
    });
  std::this_thread::sleep_for(std::chrono::seconds(kSeconds - 2));
  const auto [all, recorder] = ticks(server.process().id());
  for (std::thread& flier : fliers) flier.join();
  server.stop();
  const Finished replayed = replay({recordings.string()});
  EXPECT_EQ(replayed.code, 0) << replayed.output;
  const double each = static_cast<double>(recordedBytes()) / kFliers / kSeconds;
  std::printf("%.0f bytes a second and camera; the recording thread takes %.2f %% of the server's time\n%s", each, 100 * recorder / all,
              replayed.output.c_str());
  EXPECT_LT(each, 1000);
  EXPECT_LT(recorder / all, 0.01);
}

TEST_F(RecordingEndToEnd, SaysWhatItWants) {
  for (const std::vector<std::string>& bad :
       {std::vector<std::string>{}, {"/nowhere"}, {(folder / "").string()}, {"/nowhere", "--from", "-1"}}) {
    const Finished refused = replay(bad);
    EXPECT_EQ(refused.code, 2) << refused.output;
    EXPECT_THAT(refused.output, testing::StartsWith("ridgecast-server replay: "));
  }
  for (const char* other : {"--until", "--export"})
    EXPECT_THAT(replay({"/nowhere", "--serve", other, "5"}).output, HasSubstr("--serve takes neither --until nor --export"));
  for (const std::vector<std::string>& shared :
       {std::vector<std::string>{"--shared", "redis://127.0.0.1"}, {"--shared=redis://127.0.0.1"}, {"--shared-ca", "/nowhere"}}) {
    std::vector<std::string> arguments{"/nowhere", "--serve"};
    arguments.insert(arguments.end(), shared.begin(), shared.end());
    const Finished refused = replay(arguments);
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.output, HasSubstr("--serve plays a recording on one server, whose clock is the recording's; leave out --shared."));
  }
  EXPECT_THAT(replay({"--help"}).output, testing::StartsWith("Usage: ridgecast-server replay FILE|DIR"));
}

}  // namespace
}  // namespace ridgecast
