// A flight against servers that lie about the mesh, send nonsense, or go away in the middle.
#include "client/evaluation/fly.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "client/exit/exit.h"
#include "client/render/context.h"
#include "common/terrain/terrain.h"
#include "common/wire/wire.h"
#include "tests/unit/client/link/raw_world.h"

namespace ridgecast::evaluation {
namespace {

using test::RawConnection;
using test::RawServer;

std::string worldBytes(std::uint64_t contentHashOffset = 0) {
  const auto terrain = *terrain::create("alpine", 3);
  wire::World world = test::rawWorld();
  world.terrainSource = std::string(terrain->source());
  world.seed = 3;
  world.contentHash = terrain::contentHash(*terrain) + contentHashOffset;
  return wire::encode(wire::ServerMessage(world));
}

class Fly : public testing::Test {
 protected:
  void SetUp() override {
    if (auto context = render::HeadlessContext::create(); !context) GTEST_SKIP() << "no OpenGL here: " << context.error().message;
    std::filesystem::create_directories(folder_);
    std::ofstream(folder_ / "path.json") << R"({"terrain": "alpine", "seed": 3, "keyframes": [
      {"t": 0, "x": 0, "z": 0, "altitude": 100, "yaw": 0, "pitch": -10},
      {"t": 1, "x": 10, "z": 0, "altitude": 100, "yaw": 0, "pitch": -10}]})";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  FlyOptions options(const RawServer& server) const {
    FlyOptions o;
    o.url.port = server.port();
    o.path = folder_ / "path.json";
    o.out = folder_ / "out";
    o.rate = 5;
    o.width = o.height = 32;
    o.framesEvery = 100;
    o.settleLimit = 20;
    return o;
  }
  nlohmann::json summary() const {
    std::ifstream in(folder_ / "out" / "summary.json");
    return nlohmann::json::parse(in);
  }
  const std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("ridgecast-fly-" + std::to_string(getpid()));
};

// Answers every pose with what `answer` makes of the iteration's number; counts what is asked again. Ends with the client, or when
// the answer is to have no number.
void converse(RawConnection& peer, const std::function<wire::Iteration(std::uint64_t)>& answer, std::atomic<int>* resends = nullptr,
              std::uint64_t contentHashOffset = 0) {
  peer.upgrade();
  std::uint64_t number = 0;
  for (std::string frame = peer.readFrame(); !frame.empty(); frame = peer.readFrame()) {
    const auto message = wire::decodeClient({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()});
    ASSERT_TRUE(message) << message.error().message;
    if (std::holds_alternative<wire::Hello>(*message)) {
      EXPECT_EQ(std::get<wire::Hello>(*message).pacing, wire::Pacing::kLockstep);
      peer.sendFrame(worldBytes(contentHashOffset));
    } else if (const auto* pose = std::get_if<wire::PoseMessage>(&*message)) {
      wire::Iteration iteration = answer(++number);
      if (iteration.number == 0) return;
      iteration.poseSequence = pose->sequence;
      peer.sendFrame(wire::encode(wire::ServerMessage(iteration)));
    } else if (std::holds_alternative<wire::ResendLeaves>(*message) && resends) {
      ++*resends;
    }
  }
}

// An iteration that leaves nothing to hold: the mesh of no leaves has hash 0.
wire::Iteration honest(std::uint64_t number) {
  wire::Iteration iteration;
  iteration.number = number;
  iteration.settled = number > 8;
  return iteration;
}

TEST_F(Fly, AsksAgainAndCountsWhenTheMeshDiffers) {
  std::atomic<int> resends = 0;
  {
    RawServer server([&](RawConnection& peer) {
      converse(
          peer,
          [](std::uint64_t number) {
            wire::Iteration iteration = honest(number);
            if (number == 2) iteration.meshHash = 77;                                     // a mesh that was never sent
            if (number == 4) iteration.whole.push_back({{0, 0, 0}, 3, 1, {1, 2, 3, 4}});  // no leaf at all
            return iteration;
          },
          &resends);
    });
    EXPECT_EQ(fly(options(server)), kSuccess);
  }
  EXPECT_EQ(resends, 2);
  const auto figures = summary();
  EXPECT_EQ(figures["hash_mismatches"], 2);
  EXPECT_EQ(figures["settled"], true);
  EXPECT_EQ(figures["triangles"], 0);
  EXPECT_EQ(figures["iterations"], 9);
  EXPECT_EQ(figures["seed"], 3);
  EXPECT_EQ(figures["frames"], 1);
  std::ifstream lines(folder_ / "out" / "iterations.jsonl");
  int wrong = 0, count = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    const auto object = nlohmann::json::parse(line);
    EXPECT_EQ(object["iteration"], count + 1);
    wrong += object["hash_ok"] == false;
  }
  EXPECT_EQ(count, 9);
  EXPECT_EQ(wrong, 2);
  for (const char* name : {"0006-mesh.png", "0006-raymarch.png", "settled-mesh.png", "settled-raymarch.png"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / "out" / name)) << name;
}

TEST_F(Fly, GivesUpOnAServerThatAlwaysLies) {
  RawServer server([](RawConnection& peer) {
    converse(peer, [](std::uint64_t number) {
      wire::Iteration iteration = honest(number);
      iteration.meshHash = 1;
      return iteration;
    });
  });
  EXPECT_EQ(fly(options(server)), kRuntimeFailure);
}

TEST_F(Fly, SaysWhenTheServerGoesAwayInTheMiddle) {
  RawServer server(
      [](RawConnection& peer) { converse(peer, [](std::uint64_t number) { return number < 3 ? honest(number) : wire::Iteration{}; }); });
  testing::internal::CaptureStderr();
  EXPECT_EQ(fly(options(server)), kRuntimeFailure);
  EXPECT_NE(testing::internal::GetCapturedStderr().find("ridgecast-client: "), std::string::npos);
}

// A terrain that this client does not have: its text is drawn with when that is allowed, else there is nothing to compare the mesh with.
TEST_F(Fly, DrawsATerrainThatIsNotItsOwnFromItsTextOrNeutrally) {
  for (const bool allowed : {true, false}) {
    std::filesystem::remove_all(folder_ / "out");
    RawServer server([](RawConnection& peer) { converse(peer, honest, nullptr, 1); });
    FlyOptions o = options(server);
    o.remoteShaders = allowed;
    testing::internal::CaptureStderr();
    EXPECT_EQ(fly(o), kSuccess);
    EXPECT_EQ(testing::internal::GetCapturedStderr().find("--no-remote-shaders") == std::string::npos, allowed);
    EXPECT_TRUE(std::filesystem::exists(folder_ / "out" / "settled-mesh.png"));
    EXPECT_EQ(std::filesystem::exists(folder_ / "out" / "settled-raymarch.png"), allowed);
    EXPECT_EQ(summary()["ssim_settled"].is_null(), !allowed);
  }
}

TEST_F(Fly, NamesWhatIsWrongWithPathAndFolder) {
  FlyOptions o;
  o.url.port = test::closedPort();
  o.path = folder_ / "missing.json";
  o.out = folder_ / "out";
  EXPECT_EQ(fly(o), kBadInput);
  o.path = folder_ / "path.json";
  o.out = folder_ / "path.json" / "out";
  EXPECT_EQ(fly(o), kBadInput);
  o.out = folder_ / "out";
  EXPECT_EQ(fly(o), kRuntimeFailure);  // nobody listens
}

}  // namespace
}  // namespace ridgecast::evaluation
