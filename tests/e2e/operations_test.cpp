// A server as those see it who run it: figures under load, logs, and floods that clients who are served do not feel.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/e2e/operator.h"
#include "tests/support/authority.h"
#include "tests/support/flier.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using nlohmann::json;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

TEST(Operations, FiguresUnderLoadAreThereAndSane) {
  ScratchFolder folder;
  ServerProcess server(RIDGECAST_SERVER, {"--state", folder / "state", "--record", folder / "recordings"});
  Flier first(server.url(), coarse()), second(server.url(), coarse());
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", first.world());
  std::uint64_t live = 0, iterations = 0;
  for (int k = 0; k < 40; ++k) {
    first.step(path.at(0.1 * k));
    live = second.step(path.at(1 + 0.1 * k)).figures.triangles;
    iterations += 2;
  }
  SocketClient lost(server.port());
  EXPECT_FALSE(lost.upgrade("/v1/stream?session=gone"));
  const double received = static_cast<double>(first.connection().bytesReceived() + second.connection().bytesReceived());
  auto now = scrape(server.port());
  // What has arrived may be counted a moment later.
  const std::string answers = "ridgecast_http_requests_total{route=", scrapes = answers + "\"/metrics\",status=\"200\"}",
                    refused = answers + "\"/v1/stream\",status=\"404\"}";
  EXPECT_TRUE(testing_support::await([&] {
    now = scrape(server.port());
    return now["ridgecast_sent_bytes_total"] >= received && now[scrapes] >= 1 && now[refused] >= 1 &&
           now["ridgecast_delivery_seconds_count"] >= static_cast<double>(iterations);
  }));
  EXPECT_EQ(now["ridgecast_cameras"], 2);
  EXPECT_EQ(now["ridgecast_streams"], 2);
  EXPECT_EQ(now["ridgecast_ready"], 1);
  EXPECT_EQ(now["ridgecast_sessions"], 1);
  EXPECT_EQ(now["ridgecast_delivery_seconds_count"], static_cast<double>(iterations));  // one for each pose
  EXPECT_GT(now["ridgecast_delivery_seconds_sum"], 0);
  EXPECT_LT(now["ridgecast_delivery_seconds_sum"], static_cast<double>(kTimeout.count()));
  EXPECT_EQ(now["ridgecast_iterations_late_total"], 0);  // in lock-step
  for (const char* what : {"triangles", "bytes", "processor"})
    EXPECT_EQ(now.at(std::string("ridgecast_cameras_withheld{short=\"") + what + "\"}"), 0) << what;
  EXPECT_EQ(now["ridgecast_hash_mismatches_total"], 0);
  EXPECT_EQ(now["ridgecast_resend_requests_total"], 0);
  EXPECT_EQ(now["ridgecast_limit{of=\"cameras\"}"], 256);
  EXPECT_GE(now["ridgecast_granted_triangles"], 2e4);
  EXPECT_LE(now["ridgecast_granted_triangles"], now["ridgecast_limit{of=\"triangles\"}"]);
  EXPECT_GE(now["ridgecast_saturation"], 2.0 / 256);
  EXPECT_LE(now["ridgecast_saturation"], 1);
  EXPECT_EQ(now["ridgecast_last_reload_successful"], 1);
  EXPECT_EQ(now["ridgecast_certificate_expiry_seconds"], 0);
  EXPECT_EQ(now[refused], 1);
  EXPECT_GE(now["ridgecast_open_connections"], 3);
  EXPECT_LE(now["ridgecast_open_connections"], 5);
  EXPECT_GE(now["ridgecast_iterations_total"], static_cast<double>(iterations));
  EXPECT_GE(now["ridgecast_iterations_sent_total"], static_cast<double>(iterations));
  EXPECT_LE(now["ridgecast_iterations_sent_total"], now["ridgecast_iterations_total"]);
  EXPECT_GT(now["ridgecast_triangles"], static_cast<double>(live));
  EXPECT_LT(now["ridgecast_triangles"], 4 * static_cast<double>(live));
  EXPECT_LE(now["ridgecast_sent_bytes_total"], received * 1.1 + 100'000);
  EXPECT_GE(now["ridgecast_received_messages_total"], 2.0 * static_cast<double>(iterations));
  EXPECT_GT(now["ridgecast_received_bytes_total"], now["ridgecast_received_messages_total"]);
  EXPECT_LT(now["ridgecast_queued_bytes"], 64.0 * (1 << 20));
  for (const char* queue : {"iterations", "answers", "snapshots", "worlds"}) {
    const std::string name = std::string("ridgecast_queue_depth{queue=\"") + queue + "\"}";
    ASSERT_TRUE(now.contains(name));
    EXPECT_LE(now[name], 4) << name;  // two cameras, nobody asks for anything else
  }
  EXPECT_GT(now["ridgecast_vertices_inserted_total"], 1000);
  EXPECT_GT(now["ridgecast_heights_total"], now["ridgecast_vertices_inserted_total"]);
  EXPECT_EQ(now["ridgecast_refusals_total{reason=\"session\"}"], 1);
  EXPECT_EQ(now["ridgecast_refusals_total{reason=\"internal\"}"], 0);
  double seconds = 0;
  for (const char* stage : {"select", "generate", "refine", "triangulate", "encode"}) {
    const std::string label = std::string("{stage=\"") + stage + "\"}";
    EXPECT_EQ(now["ridgecast_stage_seconds_count" + label], now["ridgecast_iterations_total"]) << stage;
    EXPECT_GE(now["ridgecast_stage_seconds_sum" + label], 0);
    EXPECT_EQ(now[std::string("ridgecast_stage_seconds_bucket{stage=\"") + stage + "\",le=\"+Inf\"}"],
              now["ridgecast_stage_seconds_count" + label]);
    double below = 0;
    for (const char* le : {"0.0001", "0.001", "0.01", "0.1", "1", "+Inf"}) {
      const double count = now[std::string("ridgecast_stage_seconds_bucket{stage=\"") + stage + "\",le=\"" + le + "\"}"];
      EXPECT_GE(count, below) << stage << " " << le;
      below = count;
    }
    seconds += now["ridgecast_stage_seconds_sum" + label];
  }
  EXPECT_GT(seconds, 0.001);
  EXPECT_GT(now["process_cpu_seconds_total"], 0.01);
  EXPECT_GT(now["process_resident_memory_bytes"], 1 << 20);

  EXPECT_GT(now["process_open_fds"], 5);
  EXPECT_LT(now["process_open_fds"], 200);
  EXPECT_GT(now["process_max_fds"], now["process_open_fds"]);

  // What the dashboard and the alerts name is there.
  std::set<std::string> names;
  for (const auto& [name, value] : now) names.insert(name.substr(0, name.find('{')));
  const std::string asked =
      readText(RIDGECAST_DOCKER "/grafana/dashboards/ridgecast.json") + readText(RIDGECAST_DOCKER "/prometheus/rules.yml") +
      std::regex_replace(readText(RIDGECAST_DOCKER "/kubernetes/prometheus-adapter.yaml"), std::regex("as: \\w+"), "");
  ASSERT_FALSE(json::parse(readText(RIDGECAST_DOCKER "/grafana/dashboards/ridgecast.json"), nullptr, false).is_discarded());
  const std::regex figure("(ridgecast|process)_[a-z_]+");
  int found = 0;
  for (auto at = std::sregex_iterator(asked.begin(), asked.end(), figure); at != std::sregex_iterator(); ++at, ++found)
    EXPECT_TRUE(names.count(at->str()) || at->str().starts_with("ridgecast_bus_")) << at->str();  // those: shared_test.cpp
  EXPECT_GT(found, 15);
}

TEST(Operations, EveryLineOfTheLogIsJsonWhateverClientsSay) {
  std::string output;
  {
    ServerProcess server(RIDGECAST_SERVER, {"--log-format", "json", "--log-level", "debug"});
    const std::uint16_t number = server.port();
    for (const char* name : {"%22%2C%22level%22%3A%22error", "%0A%7B%22level%22%3A%22error%22%7D", "%00", "%ff%fe", "%1b%5B2J", "%e2%80%a8",
                             "..%2F..%2Fetc", "%5C%22", "%", "a b"}) {
      SocketClient client(number);
      EXPECT_FALSE(client.upgrade(std::string("/v1/stream?session=") + name));
    }
    SocketClient raw(number);
    raw.send("GET /v1/stream?session=\"\x01\xff HTTP/1.1\r\nHost: localhost\r\n\r\n");
    raw.answer();
    wire::Settings settings = coarse();
    Flier flier(server.url(), settings);
    server.process().signal(SIGHUP);
    EXPECT_TRUE(await([&] { return server.process().output().find("reloaded") != std::string::npos; }));
    EXPECT_EQ(server.stop(), 0);
    output = server.process().output();
  }
  std::istringstream lines(output);
  int count = 0, refused = 0, ofCamera = 0, ended = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    const json object = json::parse(line, nullptr, false);
    ASSERT_TRUE(object.is_object()) << line;
    for (const char* key : {"time", "level", "message"}) EXPECT_TRUE(object.contains(key) && object[key].is_string()) << line;
    EXPECT_NE(object["level"], "error") << line;
    refused += object.contains("session") && object["message"].get<std::string>().starts_with("is refused");
    if (object["message"].get<std::string>().starts_with("is refused")) {
      EXPECT_EQ(object.value("event", ""), "refused") << line;
      EXPECT_EQ(object.value("path", ""), object.value("reason", "") == "request" ? "" : "/v1/stream") << line;
      EXPECT_GE(object.value("status", 0), 400) << line;
    }
    if (object.value("event", "") == "ended") {
      ++ended;
      EXPECT_GT(object.value("bytes", 0), 100) << line;
      EXPECT_GE(object.value("seconds", -1.0), 0) << line;
      EXPECT_GE(object.value("iterations", -1), 0) << line;
      EXPECT_EQ(object.value("reason", ""), "draining") << line;
    }
    ofCamera += object.contains("camera") && object["camera"].is_number_integer() && object["session"] == "default";
  }
  EXPECT_GT(refused, 6) << output;
  EXPECT_GT(ofCamera, 0) << output;
  EXPECT_EQ(ended, 1) << output;
  EXPECT_GT(count, 12);
}

// Four cameras at once want more than one thread can do; then nobody wants anything.
TEST(Operations, SaturationRisesAndFallsWithTheProcessor) {
  ServerProcess server(RIDGECAST_SERVER, {"--threads", "1"});
  const std::string withheld = "ridgecast_cameras_withheld{short=\"processor\"}";
  {
    wire::Settings fine;
    fine.threshold = 0.1;
    fine.triangleBudget = 2'000'000;
    std::vector<std::unique_ptr<Flier>> fliers;
    for (int k = 0; k < 4; ++k) fliers.push_back(std::make_unique<Flier>(server.url(), fine, wire::Pacing::kFree));
    const PathCamera path(RIDGECAST_PATHS "/alpine.json", fliers[0]->world());
    double time = 0;
    std::map<std::string, double> now;
    EXPECT_TRUE(await([&] {
      for (int poses = 0; poses < 20; ++poses) {
        time += 0.5;
        for (std::size_t k = 0; k < fliers.size(); ++k) fliers[k]->send(path.looped(time + 10.0 * static_cast<double>(k)));
        for (const auto& flier : fliers)
          while (flier->take(10ms)) continue;
      }
      now = scrape(server.port());
      return now["ridgecast_saturation"] > 0.9 && now[withheld] > 0;
    })) << now["ridgecast_saturation"]
        << ", " << now[withheld];
    EXPECT_NEAR(now["ridgecast_saturation"], now["ridgecast_processor_usage"], 0.1);  // a moment later
  }
  EXPECT_TRUE(await([&] {
    auto now = scrape(server.port());
    return now["ridgecast_saturation"] < 0.1 && now[withheld] == 0;
  }));
}

TEST(Operations, TheAdminPortTakesNeitherTokenNorTls) {
  Authority authority;
  const auto issued = authority.issue("DNS:localhost,IP:127.0.0.1");
  ScratchFolder folder;
  const std::string tokens = folder / "tokens";
  ASSERT_EQ(runProgram({RIDGECAST_SERVER, "token", "--token-file", tokens, "--holder", "lab"}).code, 0);
  const std::string admin = std::to_string(freePort());
  ServerProcess server(RIDGECAST_SERVER, {"--tls-cert", issued.certificate, "--tls-key", issued.key, "--token-file", tokens, "--admin-port",
                                          admin, "--max-connections", "1"});
  const auto port = static_cast<std::uint16_t>(std::stoul(admin));
  SocketClient only(server.port());  // the one connection that the server takes
  EXPECT_EQ(get(port, "/healthz"), "ok\n");
  EXPECT_EQ(get(port, "/readyz"), "ready\n");
  EXPECT_THAT(get(port, "/metrics"), testing::StartsWith("# HELP "));
  EXPECT_THAT(get(port, "/version"), HasSubstr("ridgecast-server"));
  for (const char* elsewhere : {"/", "/v1/sessions", "/v1/heights?at=0,0", "/v1/stream"})
    EXPECT_EQ(get(port, elsewhere), "The admin port has only /healthz, /readyz, /metrics and /version.\n") << elsewhere;
  EXPECT_EQ(runProgram({RIDGECAST_SERVER, "healthy", "--admin-port", admin}).code, 0);
  const auto figures = scrape(port);
  for (const char* reason : {"tls", "token", "host"})
    EXPECT_EQ(figures.at(std::string("ridgecast_refusals_total{reason=\"") + reason + "\"}"), 0) << reason;
}

// One client asks for 10,000 sessions that are not there, and comes and goes 150 times; another asks once.
TEST(Operations, AFloodOfRefusalsIsMergedInTheLogAndCounted) {
  constexpr int kConnections = 10, kEach = 1000, kVisits = 150;
  ServerProcess server(RIDGECAST_SERVER, {"--log-format", "json", "--log-level", "info"});
  for (int c = 0; c < kConnections; ++c) {
    SocketClient client(server.port());
    for (int k = 0; k < kEach; ++k) {
      const std::string name = "none" + std::to_string(c * kEach + k);
      ASSERT_TRUE(client.send("GET /v1/heights?at=0,0&session=" + name + " HTTP/1.1\r\nHost: localhost\r\n\r\n"));
      ASSERT_THAT(client.answer(), testing::StartsWith("HTTP/1.1 404"));
    }
  }
  for (int k = 0; k < kVisits; ++k) {
    SocketClient client(server.port());
    ASSERT_TRUE(client.upgrade());
  }
  EXPECT_TRUE(await([&] { return scrape(server.port())["ridgecast_streams"] == 0; }));
  SocketClient other(server.port(), "127.0.0.2");
  other.send("GET /v1/heights?at=0,0&session=other HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(other.answer(), testing::StartsWith("HTTP/1.1 404"));
  EXPECT_EQ(server.stop(), 0);
  std::uint64_t refusals = 0, ends = 0, others = 0;
  std::istringstream lines(server.process().output());
  for (std::string line; std::getline(lines, line);) {
    const json object = json::parse(line);
    const std::string event = object.value("event", ""), peer = object.value("peer", "");
    const std::uint64_t counted = object.value("repeated", std::uint64_t{1});
    if (event == "ended") ends += counted;
    if (event == "refused" && peer.starts_with("127.0.0.1")) refusals += counted;
    if (event == "refused" && peer.starts_with("127.0.0.2")) others += counted;
  }
  EXPECT_EQ(refusals, std::uint64_t{kConnections} * kEach);
  EXPECT_EQ(ends, std::uint64_t{kVisits});
  EXPECT_EQ(others, 1u);
  EXPECT_LT(server.process().output().size(), 50'000u);  // without: 2.5 MB
}

TEST(Operations, AnOperatorEndsSessionsAndSendsMembersAway) {
  ServerProcess server(RIDGECAST_SERVER, {"--log-level", "info", "--log-format", "json"});
  const std::string race = "/v1/sessions/race";
  const auto remove = [&](const std::string& target) {
    SocketClient client(server.port());
    client.send("DELETE " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    return std::stoi(client.answer().substr(std::string("HTTP/1.1 ").size()));
  };
  Flier first(server.url() + "?session=race&terrain=canyon", coarse()), second(server.url() + "?session=race", coarse()),
      elsewhere(server.url(), coarse());
  const PathCamera path(RIDGECAST_PATHS "/canyon.json", first.world()), alpine(RIDGECAST_PATHS "/alpine.json", elsewhere.world());
  EXPECT_EQ(remove(race + "/members/99"), 404);
  EXPECT_EQ(remove(race + "/members/" + std::to_string(elsewhere.world().camera)), 404);
  EXPECT_EQ(remove(race + "/members/x"), 404);
  EXPECT_EQ(remove("/v1/sessions/none"), 404);
  EXPECT_EQ(remove("/v1/sessions/default"), 409);
  EXPECT_EQ(remove(race + "/members/" + std::to_string(first.world().camera)), 200);
  EXPECT_ANY_THROW({
    for (int k = 0; k < 100; ++k) first.step(path.at(0.1 * k));
  });
  EXPECT_NO_THROW(second.step(path.at(0)));
  EXPECT_EQ(remove(race), 200);
  EXPECT_ANY_THROW({
    for (int k = 1; k < 100; ++k) second.step(path.at(0.1 * k));
  });
  EXPECT_EQ(get(server.port(), "/v1/sessions").find("race"), std::string::npos);
  EXPECT_NO_THROW(elsewhere.step(alpine.at(0)));
  Flier again(server.url() + "?session=race&terrain=alpine", coarse());  // its name is free
  EXPECT_NO_THROW(again.step(alpine.at(0)));
  EXPECT_EQ(scrape(server.port())["ridgecast_refusals_total{reason=\"removed\"}"], 2);
  EXPECT_THAT(server.process().output(), HasSubstr("\"reason\":\"removed\""));
}

TEST(Operations, FiguresTellOfEditsAndRecordings) {
  ScratchFolder folder;
  ServerProcess server(RIDGECAST_SERVER, {"--state", folder / "state", "--record", folder / "recordings"});
  const std::string edits = "POST /v1/sessions/default/edits";
  constexpr int kEdits = 5;
  for (int k = 0; k < kEdits; ++k)
    EXPECT_THAT(ask(server.port(), edits, R"({"op":"crater","x":5,"z":5,"radius":6,"depth":1})"), HasSubstr(" 201 "));
  EXPECT_THAT(ask(server.port(), edits, R"({"op":"undo","edit":77})"), HasSubstr(" 422 "));
  std::map<std::string, double> now;
  EXPECT_TRUE(await([&] {
    now = scrape(server.port());
    return now["ridgecast_edits_total"] == kEdits && now["ridgecast_recordings_bytes"] > 0;
  }));
  EXPECT_EQ(now["ridgecast_edit_commit_seconds_count"], kEdits);
  EXPECT_GT(now["ridgecast_edit_commit_seconds_sum"], 0);
  EXPECT_EQ(now["ridgecast_edit_refusals_total{reason=\"wrong\"}"], 1);
  EXPECT_EQ(now["ridgecast_edit_logs_failing"], 0);
  EXPECT_GT(now["ridgecast_edit_bytes"], 64.0 * kEdits);
  EXPECT_LT(now["ridgecast_edit_bytes"], 1000.0 * kEdits);
  EXPECT_EQ(now["ridgecast_limit{of=\"edit_bytes\"}"], 1 << 30);
  EXPECT_EQ(now["ridgecast_recordings_failed_total"], 0);
  EXPECT_GT(now["ridgecast_limit{of=\"recording_bytes\"}"], now["ridgecast_recordings_bytes"]);
  for (const char* of : {"state", "recordings"}) {
    const std::string label = std::string("{of=\"") + of + "\"}";
    const auto disk = std::filesystem::space(folder / of);
    EXPECT_EQ(now["ridgecast_disk_bytes" + label], static_cast<double>(disk.capacity)) << of;
    EXPECT_NEAR(now["ridgecast_disk_free_bytes" + label], static_cast<double>(disk.available), 4e9) << of;
    EXPECT_GT(now["ridgecast_disk_free_bytes" + label], 0) << of;
  }
}

TEST(Operations, HealthyAsksTheServerWithTheSameSettings) {
  ServerProcess server(RIDGECAST_SERVER);
  const std::string port = std::to_string(server.port());
  EXPECT_EQ(runProgram({RIDGECAST_SERVER, "healthy"}, {{"RIDGECAST_PORT", port}, {"RIDGECAST_HOST", "0.0.0.0"}}).code, 0);
  const Finished tls = runProgram({RIDGECAST_SERVER, "healthy", "--port", port, "--tls-cert", "c", "--tls-key", "k"});
  EXPECT_EQ(tls.code, 1);
  EXPECT_THAT(tls.output, HasSubstr("--admin-port"));
  ASSERT_EQ(server.stop(), 0);
  const Finished gone = runProgram({RIDGECAST_SERVER, "healthy", "--port", port});
  EXPECT_EQ(gone.code, 1);
  EXPECT_EQ(gone.output, "ridgecast-server: No server answers at 127.0.0.1, port " + port + ".\n");
}

TEST(Operations, FiguresTellOfRepairsReloadsAndWork) {
  Authority authority;
  const auto issued = authority.issue("DNS:localhost,IP:127.0.0.1", 30);
  const std::uint16_t admin = freePort();
  ScratchFolder folder;
  const std::string key = folder / "key";
  std::filesystem::copy_file(issued.key, key);
  ServerProcess server(RIDGECAST_SERVER, {"--tls-cert", issued.certificate, "--tls-key", key, "--admin-port", std::to_string(admin)});
  auto now = scrape(admin);
  const double days = (now["ridgecast_certificate_expiry_seconds"] - static_cast<double>(std::time(nullptr))) / 86400;
  EXPECT_GT(days, 29);
  EXPECT_LT(days, 31);
  std::ofstream(key) << "nonsense";
  server.process().signal(SIGHUP);
  EXPECT_TRUE(await([&] { return scrape(admin)["ridgecast_last_reload_successful"] == 0; }));
  std::filesystem::copy_file(issued.key, key, std::filesystem::copy_options::overwrite_existing);
  server.process().signal(SIGHUP);
  EXPECT_TRUE(await([&] { return scrape(admin)["ridgecast_last_reload_successful"] == 1; }));

  ServerProcess plain(RIDGECAST_SERVER);
  Flier flier(plain.url(), coarse());
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", flier.world());
  flier.step(path.at(0));
  flier.connection().resend({});
  flier.step(path.at(0.1));
  EXPECT_EQ(scrape(plain.port())["ridgecast_resend_requests_total"], 1);
  SocketClient asker(plain.port());
  asker.send(snapshotOf("x0=0&z0=0&x1=64&z1=64&error=1"));
  EXPECT_THAT(asker.answer(), testing::StartsWith("HTTP/1.1 200"));
  const std::string snapshot = "/v1/sessions/{session}/snapshot.glb";
  EXPECT_TRUE(await([&] {
    now = scrape(plain.port());
    return now["ridgecast_http_requests_total{route=\"" + snapshot + "\",status=\"200\"}"] == 1;
  }));
  for (const char* name : {"ridgecast_queue_wait_seconds_count", "ridgecast_work_seconds_count"})
    EXPECT_EQ(now[std::string(name) + "{queue=\"snapshots\"}"], 1) << name;
}

// Sockets of our own, many at once.
class Many {
 public:
  explicit Many(std::uint16_t port) {
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address_.sin_port = htons(port);
  }
  ~Many() { closeAll(); }
  bool open(std::string_view bytes) {
    const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (socket < 0) return false;
    if (connect(socket, reinterpret_cast<const sockaddr*>(&address_), sizeof address_) != 0) {
      close(socket);
      return false;
    }
    if (!bytes.empty()) (void)!::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    sockets_.push_back(socket);
    return true;
  }
  void sendAll(std::string_view bytes) {
    for (const int socket : sockets_) (void)!::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  }
  void closeAll() {
    for (const int socket : sockets_) {
      const linger now{1, 0};  // no lingering state for each of thousands
      setsockopt(socket, SOL_SOCKET, SO_LINGER, &now, sizeof now);
      close(socket);
    }
    sockets_.clear();
  }
  std::size_t count() const { return sockets_.size(); }

 private:
  sockaddr_in address_{};
  std::vector<int> sockets_;
};

// Floods are refused, and leave neither memory nor places behind: the second time takes no more than the first. That others do not feel
// them is for fairness_test.cpp.
TEST(Operations, FloodsAreRefusedAndLeaveNothingBehind) {
  ServerProcess server(RIDGECAST_SERVER, {"--timeout", "2", "--max-connections", "600", "--max-connections-per-address", "600"});
  const auto refused = [&](const std::string& reason) {
    return scrape(server.port())["ridgecast_refusals_total{reason=\"" + reason + "\"}"];
  };
  Many many(server.port());
  double memory = 1e18;
  for (int round = 0; round < 2; ++round) {
    for (int k = 0; k < 500; ++k) many.open("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n");
    many.closeAll();
    for (int k = 0; k < 200; ++k) many.open("GET / HTTP/1.1\r\n");
    for (int k = 0; k < 15; ++k) {
      many.sendAll("X");
      std::this_thread::sleep_for(100ms);
    }
    many.closeAll();
    const double before = refused("header");
    const std::string header = "GET / HTTP/1.1\r\n" + std::string(60'000, 'h');
    for (int k = 0; k < 200; ++k) many.open(header);
    EXPECT_TRUE(await([&] { return refused("header") > before + 100; }));
    many.closeAll();
    std::size_t attempts = 0;
    for (int k = 0; k < 10'000; ++k) {
      attempts += many.open("");
      if (many.count() >= 800) many.closeAll();  // more than the server takes
    }
    many.closeAll();
    EXPECT_GE(attempts, 10'000u);
    // More at a time than there are places: refused, once the server comes to see them together.
    const double turned = refused("connections") + refused("address");
    EXPECT_TRUE(await([&] {
      for (int k = 0; k < 800; ++k) many.open("");
      std::this_thread::sleep_for(200ms);
      many.closeAll();
      return refused("connections") + refused("address") > turned + 500;
    }));
    std::map<std::string, double> after;
    EXPECT_TRUE(await([&] {
      after = scrape(server.port());
      return after["ridgecast_open_connections"] <= 3 && after["process_resident_memory_bytes"] < memory + (16 << 20);
    })) << after["ridgecast_open_connections"]
        << " connections, " << after["process_resident_memory_bytes"] << " bytes for " << memory;
    memory = after["process_resident_memory_bytes"];
  }
  EXPECT_EQ(server.stop(), 0);
}

}  // namespace
}  // namespace ridgecast
