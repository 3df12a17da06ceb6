// Snapshots over HTTP from the real server: what programs that share no code with it say about the files, that a live camera's file is what
// its client holds, and that nobody is disturbed, neither by snapshots nor by those who ask nonsense.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "client/evaluation/ssim.h"
#include "client/render/picture.h"
#include "tests/e2e/gltf_validator.h"
#include "tests/support/flier.h"
#include "tests/support/glb_file.h"
#include "tests/support/mesh_check.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using testing::HasSubstr;
using testing::StartsWith;

constexpr char kPose[] = "x=0&z=0&altitude=120&yaw=30&pitch=-10&width=640&height=360&threshold=1.5";
constexpr char kBox[] = "x0=-60.5&z0=100&x1=340&z1=420&error=0.8";

struct Response {
  std::string head, body;
};

class Snapshot : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    server_ =
        std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{"--timeout", "2", "--max-snapshot-seconds", "300"});
  }
  static void TearDownTestSuite() {
    EXPECT_EQ(server_->stop(), 0) << server_->process().output();
    server_.reset();
  }
  void TearDown() override { EXPECT_TRUE(server_->healthy()); }

  // Waits as long as it takes.
  static Response ask(const std::string& target, const std::string& more = "", const std::string& method = "GET") {
    SocketClient client(server_->port());
    client.send(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + more + "\r\n");
    std::string all;
    for (int k = 0; k < 4 && all.find("\r\n\r\n") == std::string::npos; ++k) all += client.answer(method != "HEAD");
    const auto end = all.find("\r\n\r\n");
    return end == std::string::npos ? Response{} : Response{all.substr(0, end + 2), all.substr(end + 4)};
  }
  static std::string glb(const std::string& query) { return "/v1/sessions/default/snapshot.glb?" + query; }
  static std::string header(const Response& r, const std::string& name) {
    const auto at = r.head.find("\r\n" + name + ": ");
    if (at == std::string::npos) return {};
    const auto from = at + name.size() + 4;
    return r.head.substr(from, r.head.find("\r\n", from) - from);
  }

  static std::unique_ptr<ServerProcess> server_;
};
std::unique_ptr<ServerProcess> Snapshot::server_;

class Camera {
 public:
  explicit Camera(const std::string& url, double threshold = 2) {
    wire::Settings settings;
    settings.threshold = threshold;
    flier = std::make_unique<Flier>(url, settings);
    path = std::make_unique<PathCamera>(RIDGECAST_PATHS "/alpine.json", flier->world());
  }
  std::unique_ptr<Flier> flier;
  std::unique_ptr<PathCamera> path;
};

TEST_F(Snapshot, ALiveCameraIsExactlyWhatItsClientHolds) {
  Camera camera(server_->url());
  const std::string query = "camera=" + std::to_string(camera.flier->world().camera);
  EXPECT_THAT(ask(glb(query)).head, StartsWith("HTTP/1.1 404"));  // it holds nothing yet
  for (int k = 0; k < 6; ++k) {
    for (int s = 0; s < 4; ++s) camera.flier->step(camera.path->at(k * 2 + s * 0.1));
    const Response r = ask(glb(query + (k % 2 ? "&compression=draco" : "")));
    ASSERT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
    const GlbFile file = readGlb(r.body);
    std::vector<mesh::LeafMesh> held;
    for (const auto& [address, leaf] : camera.flier->scene().leaves()) {
      held.push_back(*leaf.mesh);
      mesh::canonicalize(held.back());
    }
    EXPECT_TRUE(file.meshes() == held);
    const auto& extras = file.json["asset"]["extras"];
    EXPECT_EQ(extras["camera"]["iteration"], camera.flier->scene().iteration());
    char hash[17];
    std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(camera.flier->scene().hash()));
    EXPECT_EQ(extras["camera"]["meshHash"], hash);
    EXPECT_EQ(extras["error"]["asked"], 2.0);
    EXPECT_EQ(file.json["cameras"].size(), 1u);
  }
}

TEST_F(Snapshot, MetadataAlone) {
  const Response r = ask(std::string("/v1/sessions/default/snapshot.json?") + kPose);
  EXPECT_EQ(header(r, "Content-Type"), "application/json");
  EXPECT_EQ(nlohmann::json::parse(r.body), readGlb(ask(glb(kPose)).body).json["asset"]["extras"]);
}

TEST_F(Snapshot, OtherProgramsFindNoFault) {
  Camera camera(server_->url());
  for (int s = 0; s < 4; ++s) camera.flier->step(camera.path->at(s * 0.1));
  ScratchFolder folder;
  std::vector<std::string> all;
  const std::pair<const char*, std::string> questions[] = {{"pose", kPose},
                                                           {"box", kBox},
                                                           {"camera", "camera=" + std::to_string(camera.flier->world().camera)},
                                                           {"bare", std::string(kBox) + "&normals=0&colours=0"},
                                                           {"materials", std::string(kBox) + "&materials=1&colours=0&normals=0"},
                                                           {"texture", std::string(kBox) + "&texture=256&materials=1&origin=centre"}};
  for (const auto& [name, query] : questions)
    for (const bool draco : {false, true}) {
      if (draco && name == std::string("texture")) continue;  // a texture goes with plain files
      const Response r = ask(glb(query + (draco ? "&compression=draco" : "")));
      ASSERT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
      all.push_back(folder / (std::string(name) + (draco ? "-draco.glb" : ".glb")));
      std::ofstream(all.back(), std::ios::binary) << r.body;
      const MeshReport report = checkMesh(readGlb(r.body).meshes());
      EXPECT_TRUE(report.clean()) << all.back() << ": " << report.text();
    }
  validateGltf(all);
}

// What a viewer makes of a plain and of a compressed file looks the same, through the file's own camera.
TEST_F(Snapshot, ThreeJsDrawsBothAlike) {
  const char* chromium = std::getenv("CHROMIUM");
  if (!chromium) chromium = "/usr/bin/chromium";
  if (!std::getenv("TESTS_NODE_TOOLS") || !programExists("node") || !std::filesystem::exists(chromium))
    GTEST_SKIP() << "no Chromium at " << chromium << ", or no node, or TESTS_NODE_TOOLS names no folder with three.js: nothing was drawn";
  ScratchFolder folder;
  std::vector<std::string> command{"node", RIDGECAST_TOOLS "/screenshot-gltf.mjs"};
  std::size_t bytes[2][2];
  for (int k = 0; k < 2; ++k)
    for (int draco = 0; draco < 2; ++draco) {
      const Response r = ask(glb(std::string(k ? kBox : kPose) + (draco ? "&compression=draco" : "")));
      ASSERT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
      bytes[k][draco] = r.body.size();
      command.push_back(folder / (std::to_string(k) + std::to_string(draco) + ".glb"));
      std::ofstream(command.back(), std::ios::binary) << r.body;
    }
  const Finished drawn = runProgram(command);
  ASSERT_EQ(drawn.code, 0) << drawn.output;
  for (std::size_t k = 0; k < 2; ++k) {
    const auto plain = render::readPng(command[2 + 2 * k] + ".png"), draco = render::readPng(command[3 + 2 * k] + ".png");
    ASSERT_TRUE(plain && draco);
    const std::set<std::uint8_t> shades(plain->rgb.begin(), plain->rgb.end());
    EXPECT_GT(shades.size(), 60u);  // something is there
    EXPECT_GE(evaluation::similarity(*draco, *plain).mean, 0.99);
  }
  EXPECT_LE(bytes[1][1], bytes[1][0] / 4);
}

// Who asks for it hears how far the work has come, before the same answer that others get.
TEST_F(Snapshot, HowFarItIsIsToldToWhoAsks) {
  const auto request = [](const std::string& box) {
    return "GET " + glb(box) + " HTTP/1.1\r\nHost: localhost\r\nPrefer: progress\r\nConnection: close\r\n\r\n";
  };
  {
    SocketClient client(server_->port());
    client.send(request("x0=0&z0=0&x1=20000&z1=20000&error=6"));  // takes a minute, and longer than anybody here waits
    for (int k = 0; k < 3; ++k) {
      const std::string word = client.answer(false);
      EXPECT_THAT(word, StartsWith("HTTP/1.1 102 Processing\r\nProgress: "));
      EXPECT_THAT(word, testing::AnyOf(HasSubstr(" triangles\r\n\r\n"), HasSubstr(" %\r\n\r\n"), HasSubstr(" in the queue\r\n\r\n")));
    }
  }
  SocketClient client(server_->port());
  client.send(request(kBox));
  std::string answer;
  do answer = client.answer();
  while (answer.starts_with("HTTP/1.1 102"));
  const Response usual = ask(glb(kBox));
  ASSERT_THAT(usual.head, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, testing::EndsWith("\r\n\r\n" + usual.body));
}

TEST_F(Snapshot, TheSameFromTheCommandLine) {
  ScratchFolder folder;
  const std::string file = folder / "a.glb";
  const auto shoot = [&](std::vector<std::string> more) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "snapshot", server_->url(), "--out", file};
    command.insert(command.end(), more.begin(), more.end());
    return runProgram(command);
  };
  Finished done = shoot({"--box", "-60.5,100,340,420", "--error", "0.8", "--draco"});
  EXPECT_EQ(done.code, 0) << done.output;
  EXPECT_THAT(done.output, testing::AllOf(HasSubstr("Receiving"), HasSubstr(file)));
  EXPECT_EQ(readText(file), ask(glb(std::string(kBox) + "&compression=draco")).body);
  done = shoot({"--altitude", "120", "--yaw", "30", "--size", "640x360", "--threshold", "1.5"});
  EXPECT_EQ(done.code, 0) << done.output;
  EXPECT_EQ(readText(file), ask(glb(kPose)).body);
  done = shoot({"--box", "7000,0,8500,1500", "--error", "0.5"});  // takes a second, and nobody has asked for it before
  EXPECT_EQ(done.code, 0) << done.output;
  EXPECT_THAT(done.output, testing::AllOf(HasSubstr("at work"), HasSubstr("Receiving"), HasSubstr(file)));
  // Numbers that would be written with an exponent, whose + is a blank in a URL.
  done = shoot({"--x", "100000", "--z", "-1e12", "--altitude", "120", "--size", "640x360", "--threshold", "20"});
  EXPECT_EQ(done.code, 0) << done.output;
  std::filesystem::remove(file);
  done = shoot({"--camera", "12345"});
  EXPECT_EQ(done.code, 1);
  EXPECT_THAT(done.output, HasSubstr("no camera 12345"));
  EXPECT_EQ(shoot({"--camera", "1", "--x", "3"}).code, 2);
  EXPECT_EQ(shoot({"--box", "0,0,1,nan"}).code, 1);
  EXPECT_FALSE(std::filesystem::exists(file));
}

// The same flight with and without a snapshot in the making, turn by turn: it goes on. What counts with MEASURE=1, on a machine that does
// nothing else, is the server's own time for an iteration.
TEST_F(Snapshot, OtherCamerasHardlyNotice) {
  Camera camera(server_->url(), 1);
  camera.flier->settle(camera.path->at(0));
  std::vector<double> ratios;
  for (int round = 0; round < 6; ++round) {
    double taken[2] = {0, 0};
    for (const bool busy : {false, true}) {
      std::unique_ptr<SocketClient> asker;
      if (busy) {
        asker = std::make_unique<SocketClient>(server_->port());
        asker->send("GET " + glb("x0=0&z0=0&x1=20000&z1=20000&error=6") + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
        std::this_thread::sleep_for(100ms);
      }
      for (int there = 0; there < 2; ++there)
        for (int k = 0; k < 10; ++k) {
          const wire::IterationStats f = camera.flier->step(camera.path->at((there ? 10 - k : k) * 0.1)).figures;
          taken[busy] += f.selectMs + f.generateMs + f.refineMs + f.triangulateMs + f.encodeMs;
        }
      asker.reset();
      std::this_thread::sleep_for(100ms);
    }
    ratios.push_back(taken[1] / taken[0]);
  }
  std::sort(ratios.begin(), ratios.end());
  const double median = (ratios[2] + ratios[3]) / 2;
  std::cout << "an iteration takes " << median << " times as long while a snapshot is made\n";
  RecordProperty("slowdown", std::to_string(median));
  if (measures()) {
    EXPECT_LT(median, 1.1);
  }
}

// Four cameras take all there is; snapshots have a share all the same.
TEST(BusyServer, MakesSnapshotsToo) {
  ServerProcess server(RIDGECAST_SERVER, {});
  std::atomic<bool> over{false};
  std::atomic<int> iterations{0};
  std::vector<std::jthread> pilots;
  for (int k = 0; k < 4; ++k)
    pilots.emplace_back([&] {
      Camera camera(server.url(), 0.5);
      for (int step = 0; !over; ++step, ++iterations) camera.flier->step(camera.path->at(0.05 * (step % 200)));
    });
  EXPECT_TRUE(await([&] { return iterations > 20; }));
  SocketClient client(server.port());
  client.send("GET /v1/sessions/default/snapshot.glb?" + std::string(kPose) + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(client.answer(), StartsWith("HTTP/1.1 200"));
  over = true;
}

// The same code as the server's: the same bytes.
TEST_F(Snapshot, ATerrainNeedsNoServer) {
  ScratchFolder folder;
  const std::string file = folder / "a.glb", map = folder / "map.r16";
  const auto shoot = [&](std::vector<std::string> more) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "snapshot"};
    command.insert(command.end(), more.begin(), more.end());
    return runProgram(command);
  };
  Finished done = shoot({"--terrain", "alpine", "--box", "-60.5,100,340,420", "--error", "0.8", "--out", file});
  EXPECT_EQ(done.code, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr(file));
  EXPECT_EQ(readText(file), ask(glb(kBox)).body);
  // What takes a second says how far it is.
  done = shoot({"--terrain", "alpine", "--box", "0,0,1500,1500", "--error", "0.3", "--out", folder / "large.glb"});
  EXPECT_THAT(done.output, testing::AnyOf(HasSubstr("meshing"), HasSubstr("checking")));
  for (const std::string ending : {"ply", "obj"}) {
    const std::string other = folder / ("a." + ending);
    done = shoot({"--terrain", "alpine", "--box", "-60.5,100,340,420", "--error", "0.8", "--out", other});
    EXPECT_EQ(done.code, 0) << done.output;
    EXPECT_EQ(readText(other), ask("/v1/sessions/default/snapshot." + ending + "?" + kBox).body);
  }
  std::string samples;
  for (int k = 0; k < 64 * 64; ++k) samples.append({static_cast<char>(k % 64 * 3), '\0'});
  std::ofstream(map, std::ios::binary) << samples;
  done = shoot({"--terrain", map, "--raster", "pitch=10", "--box", "all", "--error", "0.5", "--origin", "centre", "--out", file});
  EXPECT_EQ(done.code, 0) << done.output;
  const auto extras = readGlb(readText(file)).json["asset"]["extras"];
  EXPECT_EQ(extras["box"], (nlohmann::json{{"x0", -320.0}, {"z0", -320.0}, {"x1", 310.0}, {"z1", 310.0}}));
  EXPECT_EQ(extras["origin"], (nlohmann::json{{"x", -5.0}, {"z", -5.0}}));

  for (const auto& [wrong, sentence] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--terrain", "alpine", "--box", "all", "--out", file}, "never ends"},
           {{"--terrain", "none.tif", "--box", "all", "--out", file}, "there is no file none.tif"},
           {{"--terrain", "alpine", "--box", "1,2,3", "--out", file}, "it must be X0,Z0,X1,Z1"},
           {{"--terrain", "alpine", "--box", "0,0,9,9", "--out", folder / "a.stl"},
            "must end in .glb, .ply, .obj, .tif, .pmtiles or .json"},
           {{"--terrain", "alpine", "--box", "0,0,9,9", "--metadata", "--out", file}, "let --out end in .json"},
           {{"--terrain", "alpine", "--box", "0,0,9,9", "--server", "/no/program", "--out", file}, "cannot start /no/program"}}) {
    done = shoot(wrong);
    EXPECT_EQ(done.code, 2) << done.output;
    EXPECT_THAT(done.output, HasSubstr(sentence));
  }
}

}  // namespace
}  // namespace ridgecast
