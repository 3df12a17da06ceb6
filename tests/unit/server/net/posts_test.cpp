// Queries that are posted, over sockets: bodies whole, in pieces, too long and cut off.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/http/queries.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast::net {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing::StartsWith;
using testing_support::SocketClient;

std::string bytesOf(const std::vector<double>& list) { return {reinterpret_cast<const char*>(list.data()), list.size() * sizeof(double)}; }
const std::string kPlaces = bytesOf({1, 2, -3.5, 4e6});

class PostsTest : public testing::Test {
 protected:
  void SetUp() override {
    logging::setUp(logging::Format::kText, logging::Level::kError);
    settings.port = 0;
    settings.trustedProxies = {access::Network::parse("127.0.0.0/8").value()};
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeTerrain = [](const session::WorldSpec& spec, const std::stop_token&) {
      return terrain::create(spec.terrain, spec.seed);
    };
    directory = std::make_shared<directory::Directory>(resources, terrain);
    start();
  }
  void TearDown() override { server->shutdown(); }
  void start() {
    server.reset();
    server = Server::listen(settings, directory, {ridgecast::http::queryRoute(directory)}).value();
  }
  static std::string head(const std::string& target, const std::string& more) {
    return "POST " + target + " HTTP/1.1\r\nHost: localhost\r\n" + more + "\r\n";
  }
  static std::string length(std::size_t bytes) {
    return "Content-Type: application/octet-stream\r\nContent-Length: " + std::to_string(bytes) + "\r\n";
  }
  static std::string post(const std::string& body, const std::string& target = "/v1/heights", const std::string& more = "") {
    return head(target, length(body.size()) + more) + body;
  }
  std::string ask(const std::string& request) {
    SocketClient client(server->port());
    client.send(request);
    return client.answer();
  }
  const std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 1).value();
  const std::string heights = [this] {  // of kPlaces, as they are answered
    const std::vector<lattice::Step> x{256, -896}, z{512, 1'024'000'000};
    std::vector<float> out(2);
    terrain->heights(x, z, out);
    return std::string(reinterpret_cast<const char*>(out.data()), out.size() * sizeof(float));
  }();
  scheduling::Executor executor{1};
  Settings settings;
  std::shared_ptr<directory::Directory> directory;
  std::unique_ptr<Server> server;
};

TEST_F(PostsTest, FollowOneAnotherOnAConnection) {
  SocketClient client(server->port());
  for (int k = 0; k < 3; ++k) {
    client.send(post(kPlaces));
    const std::string answer = client.answer();
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
    EXPECT_THAT(answer, testing::EndsWith("\r\n\r\n" + heights));
  }
  client.send(post(kPlaces) + "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(client.answer(), testing::EndsWith(heights));
  EXPECT_THAT(client.answer(), testing::EndsWith("ok\n"));
}

TEST_F(PostsTest, MayComeInPiecesAndWithoutALength) {
  SocketClient client(server->port());
  for (const char c : post(kPlaces)) client.send({&c, 1});
  EXPECT_THAT(client.answer(), testing::EndsWith(heights));
  client.send(head("/v1/heights", "Content-Type: application/octet-stream\r\nTransfer-Encoding: chunked\r\n"));
  for (std::size_t k = 0; k < kPlaces.size(); k += 8) client.send("8\r\n" + kPlaces.substr(k, 8) + "\r\n");
  client.send("0\r\n\r\n");
  EXPECT_THAT(client.answer(), testing::EndsWith(heights));
  client.send(head("/v1/heights", "Expect: 100-continue\r\n" + length(kPlaces.size())));
  EXPECT_THAT(client.answer(), StartsWith("HTTP/1.1 100 Continue"));
  client.send(kPlaces);
  EXPECT_THAT(client.answer(), testing::EndsWith(heights));
}

// With a parameter it is made by work, before the body is read.
TEST_F(PostsTest, MayMakeTheirWorld) {
  for (const char* world : {"session=a&terrain=alpine", "session=b&terrain=alpine&param=depth=5"}) {
    SocketClient client(server->port());
    client.send(post(kPlaces, std::string("/v1/heights?") + world));
    EXPECT_THAT(client.answer(), testing::EndsWith(heights)) << world;
    client.send("GET /v1/heights?at=1,2&" + std::string(world) + "&seed=2 HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(client.answer(), StartsWith("HTTP/1.1 409"));
  }
  EXPECT_EQ(directory->all().size(), 3u);
}

TEST_F(PostsTest, OfTooManyBytesAreRefusedUnread) {
  const std::string most = std::to_string(ridgecast::http::kMaxPosted * 16);
  for (const std::size_t bytes : {ridgecast::http::kMaxPosted * 16 + 1, std::size_t{100'000'000'000}}) {
    const std::string answer = ask(head("/v1/heights", "Expect: 100-continue\r\n" + length(bytes)));
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 413"));
    EXPECT_THAT(answer, HasSubstr("The body has more than " + most + " bytes; ask for at most 100000 places at a time.\n"));
  }
  EXPECT_THAT(ask(head("/v1/heights", "Content-Type: application/octet-stream\r\nTransfer-Encoding: chunked\r\n") + "FFFFFFF\r\n"),
              StartsWith("HTTP/1.1 413"));
  EXPECT_THAT(ask(head("/v1/heights", length(48).replace(14, 24, "text/csv"))), StartsWith("HTTP/1.1 415"));
  EXPECT_THAT(ask(head("/v1/nothing", length(100'000'000'000))), StartsWith("HTTP/1.1 404"));
  EXPECT_THAT(ask(head("/v1/heights", length(0))), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(ask(head("/v1/heights", "Content-Type: application/octet-stream\r\nTransfer-Encoding: chunked\r\n") + "nonsense\r\n"),
              StartsWith("HTTP/1.1 400"));
}

TEST_F(PostsTest, CutOffAnywhereLeaveTheServerWell) {
  settings.timeout = 300ms;
  start();
  const std::string whole = post(kPlaces);
  for (std::size_t length = 0; length < whole.size(); ++length) SocketClient(server->port()).send(whole.substr(0, length));
  SocketClient silent(server->port());
  silent.send(whole.substr(0, whole.size() - 1));
  EXPECT_TRUE(silent.closed()) << "nobody is waited for without end";
  EXPECT_THAT(ask(whole), testing::EndsWith(heights));
}

// Bytes that came, not those that a header promises.
TEST_F(PostsTest, OneClientHasHalfOfTheRoomForBodies) {
  const std::string large(4'500'000, ' ');
  const auto json = [](const std::string& client, const std::string& more) {
    return head("/v1/heights", "Content-Type: application/json\r\nX-Forwarded-For: " + client + "\r\n" + more);
  };
  std::vector<std::unique_ptr<SocketClient>> held;
  const auto hold = [&](const std::string& client, const std::string& some) {
    held.push_back(std::make_unique<SocketClient>(server->port()));
    held.back()->send(json(client, "Content-Length: 6000000\r\n") + some);
  };
  const auto whole = [&](const std::string& client) {
    return ask(json(client, "Content-Length: " + std::to_string(large.size()) + "\r\n") + large);
  };
  const auto brief = [&](const std::string& client) { return ask(post(kPlaces, "/v1/heights", "X-Forwarded-For: " + client + "\r\n")); };
  for (int k = 0; k < 100; ++k) hold("192.0.2.1", " ");
  // One more at a time, for those that are refused together give back their room together.
  std::string answer;
  const auto fill = [&](const std::string& client, const char* refusal) {
    return testing_support::await([&] {
      hold(client, large);
      return (answer = whole(client)).starts_with(refusal);
    });
  };
  for (const std::string client : {"192.0.2.1", "192.0.2.2"}) {
    EXPECT_THAT(whole(client), StartsWith("HTTP/1.1 400")) << "it was read, and has no places";
    ASSERT_TRUE(fill(client, "HTTP/1.1 429")) << answer;
    EXPECT_THAT(answer, HasSubstr("The address " + client + " is sending as many bytes of requests as may be open"));
    EXPECT_THAT(answer, HasSubstr("Retry-After: 1\r\n"));
    EXPECT_THAT(brief(client), testing::EndsWith(heights));
  }
  ASSERT_TRUE(fill("192.0.2.3", "HTTP/1.1 503")) << answer;
  EXPECT_THAT(brief("192.0.2.3"), testing::EndsWith(heights));
  held.clear();
  EXPECT_TRUE(testing_support::await([&] { return whole("192.0.2.1").starts_with("HTTP/1.1 400"); }));
}

TEST_F(PostsTest, LargeOnesHoldNobodyUp) {
  settings.promptJobs = {1, 64, 0};
  start();
  const std::string large =
      post(bytesOf(std::vector<double>(2 * ridgecast::http::kMaxPosted, 77)), "/v1/normals", "X-Forwarded-For: 192.0.2.1\r\n");
  // 4 million heights, of which their client's budget lets 8 million pass a second, a quarter of a second's at once.
  constexpr std::size_t kLarge = 10;
  std::atomic<std::size_t> done{0};
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < kLarge; ++k)
    threads.emplace_back([&] {
      EXPECT_THAT(ask(large), StartsWith("HTTP/1.1 200"));
      ++done;
    });
  std::size_t meanwhile = 0;
  for (; done < kLarge; ++meanwhile)
    EXPECT_THAT(ask(post(kPlaces, "/v1/heights", "X-Forwarded-For: 192.0.2.2\r\n")), testing::EndsWith(heights));
  for (auto& thread : threads) thread.join();
  EXPECT_GE(meanwhile, kLarge);
}

}  // namespace
}  // namespace ridgecast::net
