// What a server holds: memory, open files, children and a processor after many sessions have come and gone; and how much as many greedy
// cameras take as there are places. MEMORY_ROUNDS=1200 is an hour in minutes, MEMORY_CAMERAS=256 a server of 4 GiB; with MEMORY_STEPS=400
// they use all that was granted.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "common/wire/wire.h"
#include "tests/support/flier.h"
#include "tests/support/sanitized.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;

std::uint32_t fromEnvironment(const char* name, std::uint32_t otherwise) {
  const char* given = std::getenv(name);
  return given ? static_cast<std::uint32_t>(std::strtoul(given, nullptr, 10)) : otherwise;
}

std::uint64_t kilobytes(pid_t process, const std::string& line) {  // of /proc/PID/status
  std::ifstream in("/proc/" + std::to_string(process) + "/status");
  for (std::string name; in >> name;)
    if (std::uint64_t value = 0; name == line + ":" && in >> value) return value;
  return 0;
}

double processorSeconds(pid_t process) {
  clockid_t clock{};
  timespec used{};
  EXPECT_TRUE(clock_getcpuclockid(process, &clock) == 0 && clock_gettime(clock, &used) == 0);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

struct Held {
  std::uint64_t resident = 0;  // KiB
  std::size_t files = 0, threads = 0, children = 0;
};

Held heldBy(pid_t process) {
  const std::filesystem::path proc = "/proc/" + std::to_string(process);
  Held held{.resident = kilobytes(process, "VmRSS")};
  held.files = static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(proc / "fd"), {}));
  for (const auto& task : std::filesystem::directory_iterator(proc / "task")) {
    ++held.threads;
    std::ifstream children(task.path() / "children");
    held.children += static_cast<std::size_t>(std::distance(std::istream_iterator<pid_t>(children), {}));
  }
  return held;
}

class Guests : public testing::Test {
 protected:
  Guests() {
    std::ofstream out(folder_ / "map.r16", std::ios::binary);  // a roof, 16 bits a sample
    for (std::size_t k = 0; k < kSamples * kSamples; ++k) {
      const std::size_t height = std::min(k % kSamples, kSamples - k % kSamples);
      out << static_cast<char>(height % 256) << static_cast<char>(height / 256);
    }
    out.close();
    server_ = std::make_unique<ServerProcess>(
        RIDGECAST_SERVER, std::vector<std::string>{"--terrain", (folder_ / "map.r16").string(), "--terrain-dir",
                                                   RIDGECAST_PATHS "/../../../common/terrain/tutorial", "--terrain-cache",
                                                   (folder_ / "cache").string(), "--session-idle", "1", "--timeout", "2", "--cache-memory",
                                                   "1"});  // full, and no longer growing, at the first look
  }
  static std::string get(const std::string& target) {
    return "GET " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
  }
  std::string answer(const std::string& target) {
    SocketClient client(server_->port());
    client.send(get(target));
    return client.answer();
  }
  std::size_t sessions() {
    const std::string text = answer("/v1/sessions");
    return nlohmann::json::parse(text.substr(text.find("\r\n\r\n") + 4)).at("sessions").size();
  }
  Held held() { return heldBy(server_->process().id()); }

  // Who comes, flies, and hangs up in good order.
  void fly(const std::string& world) {
    wire::Settings settings;
    settings.threshold = 10;
    Flier flier(server_->url() + world, settings);
    camera::Camera camera;
    camera.pose.y = 900;
    for (int step = 0; step < 5; ++step) {
      camera.pose.x += 100;
      flier.step(camera);
    }
  }
  // Is gone in the middle of a message.
  void die() {
    SocketClient client(server_->port());
    EXPECT_TRUE(client.upgrade());
    client.message(wire::encode(wire::ClientMessage{wire::Hello{}}));
    const std::string pose = wire::encode(wire::ClientMessage{wire::PoseMessage{1, {}}});
    client.message(pose);
    client.frame(2, pose.substr(0, pose.size() / 2), true, pose.size());
  }
  // Hangs up while its world is compiled.
  void leaveTheCompiler(const std::string& world) {
    SocketClient client(server_->port());
    client.send("GET /v1/stream" + world +
                " HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
    EXPECT_TRUE(await([&] { return held().children > 0; })) << "nothing is compiled";
  }
  void round(std::uint32_t k) {
    const std::string number = std::to_string(k);
    fly("?session=map" + number + "&terrain=map&seed=" + number);
    fly("?session=dunes" + number + "&terrain=dunes&param=tallest=" + std::to_string(100 + 0.01 * k));
    leaveTheCompiler("?session=left" + number + "&terrain=dunes&param=tallest=" + std::to_string(300 + 0.01 * k));
    EXPECT_THAT(answer("/v1/sessions/default/snapshot.glb?x=" + number + "&z=0&altitude=300&yaw=30&pitch=-10&threshold=8"),
                testing::StartsWith("HTTP/1.1 200"));
    SocketClient(server_->port())
        .send(get("/v1/sessions/default/snapshot.glb?x=0&z=" + number + "&altitude=300&yaw=30&pitch=-10&threshold=2"));
    die();
  }
  // When all guests have left: the least over two seconds, since the allocator returns memory after one. Nobody asks for anything
  // meanwhile.
  Held atRest() {
    EXPECT_TRUE(await([&] { return sessions() == 1 && held().children == 0; }));
    Held least = held();
    const double used = processorSeconds(server_->process().id());
    for (const auto end = std::chrono::steady_clock::now() + 2s; std::chrono::steady_clock::now() < end;
         std::this_thread::sleep_for(50ms)) {
      const Held now = held();
      least = {std::min(least.resident, now.resident), std::min(least.files, now.files), std::min(least.threads, now.threads),
               now.children};
    }
    EXPECT_LT(processorSeconds(server_->process().id()) - used, 0.2) << "seconds of a processor, for nobody";
    return least;
  }

  static constexpr std::size_t kSamples = 1024;
  ScratchFolder folder_;
  std::unique_ptr<ServerProcess> server_;
};

TEST_F(Guests, LeaveNothingBehind) {
  const std::uint32_t rounds = std::max(fromEnvironment("MEMORY_ROUNDS", 10), 10u), warm = std::max(rounds / 10, 3u);
  Held first, last;
  for (std::uint32_t k = 1; k <= rounds; ++k) {
    ASSERT_NO_THROW(round(k)) << server_->process().output();
    if (k != warm && k != rounds / 2 && k != rounds) continue;
    last = atRest();
    if (first.files == 0) first = last;
    std::printf("after %u rounds: %.1f MiB, %zu files, %zu threads, %zu children\n", k, static_cast<double>(last.resident) / 1024,
                last.files, last.threads, last.children);
    std::fflush(stdout);
  }
  EXPECT_TRUE(kSanitized || last.resident <= first.resident + first.resident / 10) << first.resident << " KiB, then " << last.resident;
  EXPECT_LE(last.files, first.files);
  EXPECT_LE(last.threads, first.threads);
  EXPECT_EQ(last.children, 0u);
  EXPECT_TRUE(server_->healthy());
}

// Members with edits and lists, of which nobody reads anything, beside a history of stamps: what the first five take is the threads' own,
// and the next take nothing.
TEST(Memory, ThatNobodyReadsTakeNoRoom) {
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", "alpine"});
  std::string stamp = R"({"op":"stamp","x":0,"z":0,"columns":256,"samples":[0)";
  for (int k = 1; k < 256 * 256; ++k) stamp += ",0";
  stamp += "]}";
  SocketClient editor(server.port());
  for (int made = 0; made < 200;) {
    editor.send("POST /v1/sessions/default/edits HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: " +
                std::to_string(stamp.size()) + "\r\n\r\n" + stamp);
    const std::string answer = editor.answer();
    made += answer.find(" 201 ") != answer.npos;
    if (answer.find(" 429 ") != answer.npos) std::this_thread::sleep_for(50ms);
    ASSERT_THAT(answer, testing::AnyOf(testing::HasSubstr(" 201 "), testing::HasSubstr(" 429 ")));
  }
  std::vector<std::unique_ptr<SocketClient>> deaf;
  wire::Hello hello;
  hello.edits = true;
  const auto most = [&](std::uint64_t least) {  // resident, KiB, while five more come
    for (int k = 0; k < 5; ++k) {
      deaf.push_back(std::make_unique<SocketClient>(server.port()));
      EXPECT_TRUE(deaf.back()->upgrade());
      EXPECT_TRUE(deaf.back()->message(wire::encode(wire::ClientMessage(hello))));
      deaf.push_back(std::make_unique<SocketClient>(server.port()));
      EXPECT_TRUE(deaf.back()->send("GET /v1/sessions/default/edits?limit=1000 HTTP/1.1\r\nHost: localhost\r\n\r\n"));
    }
    for (int k = 0; k < 30; ++k, std::this_thread::sleep_for(100ms)) least = std::max(least, kilobytes(server.process().id(), "VmRSS"));
    return least;
  };
  const std::uint64_t begin = kilobytes(server.process().id(), "VmRSS"), first = most(begin), second = most(first);
  std::printf("200 stamps: %llu KiB, beside five members and five lists that nobody reads %llu KiB, beside ten %llu KiB\n",
              static_cast<unsigned long long>(begin), static_cast<unsigned long long>(first), static_cast<unsigned long long>(second));
  EXPECT_TRUE(kSanitized || first <= begin + (48u << 10));
  EXPECT_TRUE(kSanitized || second <= first + (12u << 10));
  EXPECT_TRUE(server.healthy());
}

// Memory is for a few large meshes, and everybody asks for one: all fly, with smaller budgets, and the next is refused in one sentence.
TEST(Memory, EverybodyFliesOnASmallServerAndTheNextIsRefused) {
  const std::uint32_t cameras = fromEnvironment("MEMORY_CAMERAS", 12);
  const std::uint32_t steps = fromEnvironment("MEMORY_STEPS", 4);
  const std::uint64_t limit = (std::uint64_t{16} << 20) * cameras, triangles = limit / 2 / 160;  // as --max-total-triangles has by default
  ServerProcess server(RIDGECAST_SERVER, {"--max-cameras", std::to_string(cameras), "--max-members", std::to_string(cameras + 1),
                                          "--max-connections-per-address", "0", "--max-total-triangles", std::to_string(triangles)});
  wire::Settings greedy;
  greedy.threshold = 0.05;
  greedy.triangleBudget = 2'000'000;
  std::vector<std::unique_ptr<Flier>> fliers;
  std::uint64_t granted = 0, drawn = 0;
  for (std::uint32_t k = 0; k < cameras; ++k) {
    fliers.push_back(std::make_unique<Flier>(server.url(), greedy));
    granted += fliers.back()->world().settings.triangleBudget;
    EXPECT_GE(fliers.back()->world().settings.triangleBudget, 10'000u) << k;
  }
  EXPECT_LE(granted, triangles);
  for (const auto& flier : fliers) {
    camera::Camera camera;
    camera.pose.y = 2500;
    camera.pose.pitch = -0.4;
    std::uint64_t held = 0;
    for (std::uint32_t step = 1; step <= steps && held < flier->world().settings.triangleBudget * 0.95; ++step) {
      if (step <= 4) camera.pose.x += 200;
      held = flier->step(camera).figures.triangles;
      EXPECT_GT(held, 0u);
    }
    drawn += held;
  }
  const std::uint64_t resident = kilobytes(server.process().id(), "VmHWM");
  std::printf("%u cameras: granted %llu triangles, drawn %llu, at most %.0f of %.0f MiB\n", cameras,
              static_cast<unsigned long long>(granted), static_cast<unsigned long long>(drawn), static_cast<double>(resident) / 1024,
              static_cast<double>(limit) / (1 << 20));
  EXPECT_TRUE(kSanitized || resident * 1024 <= limit) << resident << " KiB";
  try {
    Flier next(server.url(), greedy);
    ADD_FAILURE() << "one more was let in";
  } catch (const std::exception& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("This server is full: it has " + std::to_string(cameras) + " cameras; try again later."));
  }
  EXPECT_TRUE(server.healthy());
}

}  // namespace
}  // namespace ridgecast
