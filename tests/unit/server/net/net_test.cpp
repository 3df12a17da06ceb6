#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <random>
#include <thread>

#include "common/wire/wire.h"
#include "server/logging/logging.h"
#include "server/net/server.h"
#include "tests/support/socket_client.h"
#include "tests/support/still_mesh.h"
#include "tests/support/waiting.h"

namespace ridgecast::net {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing::StartsWith;
using testing_support::SocketClient;
using testing_support::StillMesh;

class NetTest : public testing::Test {
 protected:
  void SetUp() override {
    logging::setUp(logging::Format::kText, logging::Level::kWarning);
    settings.port = 0;
    start();
  }
  void TearDown() override {
    if (server) {
      EXPECT_TRUE(testing_support::await([this] { return alive(); }));  // once those that left are gone
      server->shutdown();
    }
    executor.reset();
    server.reset();
  }
  void start() {
    if (server) server->shutdown();
    executor.reset();
    server.reset();
    executor = std::make_unique<scheduling::Executor>(2);
    auto resources = std::make_shared<session::Resources>();
    resources->executor = executor.get();
    resources->makeMesh = [](auto, const auto&, auto) { return std::make_unique<StillMesh>(); };
    resources->limits = limits;
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 1).value());
    auto made = Server::listen(settings, directory);
    ASSERT_TRUE(made) << made.error().message;
    server = std::move(*made);
  }
  bool alive() { return get("/healthz").find("\r\n\r\nok\n") != std::string::npos; }
  std::string get(const std::string& target) {
    return request("GET " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  }
  std::string request(std::string_view bytes) {
    SocketClient client(server->port());
    client.send(bytes);
    return client.answer();
  }
  static std::string bytes(const wire::ClientMessage& message) { return wire::encode(message); }
  static std::optional<wire::ServerMessage> decoded(const std::optional<SocketClient::Frame>& frame) {
    if (!frame || frame->opcode != 2) return {};
    auto message = wire::decodeServer({reinterpret_cast<const std::uint8_t*>(frame->payload.data()), frame->payload.size()});
    if (!message) {
      ADD_FAILURE() << message.error().message;
      return {};
    }
    return std::move(*message);
  }
  // What the server says to a client that misbehaves: an error, then a close.
  static std::pair<wire::ErrorMessage, int> sentAway(SocketClient& client) {
    wire::ErrorMessage error;
    while (auto message = decoded(client.receive()))
      if (const auto* e = std::get_if<wire::ErrorMessage>(&*message)) {
        error = *e;
        break;
      }
    return {error, client.awaitClose()};
  }
  void noCamerasSoon() {
    EXPECT_TRUE(testing_support::await([this] { return directory->cameras() == 0; }));
  }

  Settings settings;
  session::Limits limits;
  std::unique_ptr<scheduling::Executor> executor;
  std::shared_ptr<directory::Directory> directory;
  std::unique_ptr<Server> server;
};

TEST_F(NetTest, AnswersHttp) {
  EXPECT_THAT(get("/healthz"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(get("/"), HasSubstr("<h1>Ridgecast</h1>"));
  EXPECT_THAT(get("/nope"), StartsWith("HTTP/1.1 404"));
  EXPECT_THAT(get("/v1/stream"), StartsWith("HTTP/1.1 426"));
  EXPECT_THAT(get("/v1/stream?session=%"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(request("POST /healthz HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\nabc"), StartsWith("HTTP/1.1 405"));
  SocketClient gone(server->port());
  EXPECT_FALSE(gone.upgrade("/v1/stream?session=gone"));
  // One connection, several requests, one of them without a body.
  SocketClient client(server->port());
  for (int k = 0; k < 3; ++k) {
    client.send("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(client.answer(), HasSubstr("ok"));
    client.send("HEAD /version HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(client.answer(false), testing::Not(HasSubstr("ridgecast-server\",")));
  }
}

TEST_F(NetTest, RefusesWhatIsNoHttp) {
  EXPECT_THAT(request("\x16\x03\x01 this is not HTTP\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(request("GET / HTTP/1.1\r\nX: " + std::string(20'000, 'x') + "\r\n\r\n"), StartsWith("HTTP/1.1 431"));
  EXPECT_THAT(request("GET / HTTP/9.9\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  std::mt19937 random(1);
  for (int k = 0; k < 50; ++k) {
    std::string noise(1 + random() % 600, '\0');
    for (char& c : noise) c = static_cast<char>(random());
    SocketClient(server->port()).send(noise);
  }
}

// What is known of a request ends with it.
TEST_F(NetTest, ARefusalIsNotCountedForTheRequestBefore) {
  SocketClient client(server->port());
  client.send("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(client.answer(), HasSubstr("ok"));
  client.send("this is not HTTP\r\n\r\n");
  EXPECT_THAT(client.answer(), StartsWith("HTTP/1.1 400"));
  std::string metrics;
  EXPECT_TRUE(testing_support::await([&] { return (metrics = get("/metrics")).find("status=\"400\"} 1") != std::string::npos; }));
  EXPECT_THAT(metrics, HasSubstr("{route=\"other\",status=\"400\"} 1"));
}

TEST_F(NetTest, AStreamFromHelloToAtRest) {
  SocketClient client(server->port());
  ASSERT_TRUE(client.upgrade());
  client.message(bytes(wire::Hello{}));
  auto message = decoded(client.receive());
  ASSERT_TRUE(message && std::holds_alternative<wire::World>(*message));
  EXPECT_EQ(std::get<wire::World>(*message).terrainName, "alpine");
  EXPECT_EQ(directory->cameras(), 1u);
  wire::PoseMessage pose;
  pose.sequence = 1;
  const std::string encoded = bytes(pose);
  client.frame(2, encoded.substr(0, 3), false);  // in two fragments, with a ping between them
  client.frame(9, "x");
  client.frame(0, encoded.substr(3));
  auto frame = client.receive();
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->opcode, 10);
  message = decoded(client.receive());
  ASSERT_TRUE(message && std::holds_alternative<wire::Iteration>(*message));
  const auto& iteration = std::get<wire::Iteration>(*message);
  EXPECT_EQ(iteration.number, 1u);
  EXPECT_TRUE(iteration.settled);
  ASSERT_EQ(iteration.whole.size(), 1u);
  client.message(bytes(wire::Acknowledge{1, iteration.meshHash}));
  client.frame(8, std::string("\x03\xe8", 2));
  EXPECT_EQ(client.awaitClose(), 1000);
  noCamerasSoon();
}

TEST_F(NetTest, MisbehavingClientsAreToldAndClosed) {
  const auto after = [&](const std::function<void(SocketClient&)>& misbehave) {
    SocketClient client(server->port());
    EXPECT_TRUE(client.upgrade());
    misbehave(client);
    return sentAway(client);
  };
  auto [error, code] = after([](auto& c) { c.message("\xff\xff\xff\xff"); });
  EXPECT_EQ(error.code, wire::ErrorCode::kMalformed);
  EXPECT_EQ(code, 1002);

  std::tie(error, code) = after([](auto& c) { c.message(std::string(wire::kMaxClientMessageBytes + 1, 'x')); });
  EXPECT_EQ(error.code, wire::ErrorCode::kLimit);
  EXPECT_EQ(code, 1009);

  // A length that nobody should believe: refused once more than the limit has come.
  std::tie(error, code) =
      after([](auto& c) { c.frame(2, std::string(wire::kMaxClientMessageBytes + 1, 'x'), true, std::uint64_t{1} << 62); });
  EXPECT_EQ(error.code, wire::ErrorCode::kLimit);

  std::tie(error, code) = after([](auto& c) { c.frame(1, "hello"); });
  EXPECT_EQ(error.code, wire::ErrorCode::kMalformed);
  EXPECT_EQ(code, 1003);

  std::tie(error, code) = after([](auto& c) {
    wire::Hello hello;
    hello.protocolVersion = 99;
    c.message(bytes(hello));
  });
  EXPECT_EQ(error.code, wire::ErrorCode::kVersion);
  EXPECT_THAT(error.message, HasSubstr("99"));
  EXPECT_EQ(code, 1002);

  std::tie(error, code) = after([](auto& c) {
    c.message(bytes(wire::Hello{}));
    c.message(bytes(wire::Acknowledge{7, 7}));
  });
  EXPECT_EQ(error.code, wire::ErrorCode::kInvalid);
  EXPECT_EQ(code, 1008);

  // Broken framing: the protocol's own answer.
  for (const int opcode : {3, 11, 0}) {
    SocketClient client(server->port());
    ASSERT_TRUE(client.upgrade());
    client.frame(opcode, "x");
    EXPECT_EQ(client.awaitClose(), 1002);
  }
  noCamerasSoon();
}

TEST_F(NetTest, BytesOfMessagesHaveABudgetForAllStreamsOfAClient) {
  using Clock = std::chrono::steady_clock;
  SocketClient one(server->port()), other(server->port());
  constexpr std::size_t kMessages = 30, kBytes = 120'000;
  const std::string unknown = "\xa2\x06\xc0\xa9\x07" + std::string(kBytes, 'x');  // field 100, which no server knows
  const auto begin = Clock::now();
  for (SocketClient* client : {&one, &other}) {
    ASSERT_TRUE(client->upgrade());
    ASSERT_TRUE(client->message(bytes(wire::Hello{})));
    for (std::uint64_t k = 1; k <= kMessages; ++k) ASSERT_TRUE(client->message(bytes(wire::PoseMessage{k, {}}) + unknown));
  }
  EXPECT_TRUE(alive()) << "the others are served meanwhile";
  for (SocketClient* client : {&one, &other})
    for (std::uint64_t pose = 0; pose < kMessages;) {
      const auto message = decoded(client->receive());
      ASSERT_TRUE(message);
      const auto* iteration = std::get_if<wire::Iteration>(&*message);
      if (!iteration) continue;
      pose = iteration->poseSequence;
      ASSERT_TRUE(client->message(bytes(wire::Acknowledge{iteration->number, iteration->meshHash})));
    }
  // The last of each may come unpaid, and the first ones are saved up.
  const double least = static_cast<double>((2 * kMessages - 2) * kBytes) / session::kMessageBytesPerSecond - 0.25;
  EXPECT_GE(std::chrono::duration<double>(Clock::now() - begin).count(), least);
}

TEST_F(NetTest, RandomBytesAndSuddenEndsLeaveTheServerAlive) {
  std::mt19937 random(9);
  for (int k = 0; k < 60; ++k) {
    SocketClient client(server->port());
    ASSERT_TRUE(client.upgrade());
    if (k % 2) client.message(bytes(wire::Hello{}));
    std::string noise(random() % 300, '\0');
    for (char& c : noise) c = static_cast<char>(random());
    if (k % 3)
      client.message(noise);
    else
      client.send(noise);
  }
  noCamerasSoon();
}

TEST_F(NetTest, SilentClientsAreClosed) {
  settings.timeout = 1s;
  settings.idle = 400ms;
  start();
  SocketClient half(server->port());
  half.send("GET / HT");
  EXPECT_TRUE(half.closed());

  SocketClient mute(server->port());
  ASSERT_TRUE(mute.upgrade());
  const auto [error, code] = sentAway(mute);
  EXPECT_THAT(error.message, HasSubstr("hello"));
  EXPECT_EQ(code, 1008);

  SocketClient deaf(server->port());  // says hello, then answers no ping
  ASSERT_TRUE(deaf.upgrade());
  deaf.message(bytes(wire::Hello{}));
  EXPECT_TRUE(deaf.closed());
  noCamerasSoon();
}

TEST_F(NetTest, ConnectionsAndCamerasAreBounded) {
  settings.maxConnections = 3;
  limits.maxCameras = 1;
  start();
  SocketClient first(server->port()), second(server->port());
  ASSERT_TRUE(first.upgrade());
  first.message(bytes(wire::Hello{}));
  ASSERT_TRUE(decoded(first.receive()));  // it has its place
  ASSERT_TRUE(second.upgrade());
  const auto [error, code] = sentAway(second);
  EXPECT_EQ(error.code, wire::ErrorCode::kLimit);
  EXPECT_THAT(error.message, HasSubstr("full"));
  EXPECT_EQ(code, 1008);

  std::vector<std::unique_ptr<SocketClient>> many;
  for (int k = 0; k < 3; ++k) {
    many.push_back(std::make_unique<SocketClient>(server->port()));
    many.back()->send("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
  }
  int refused = 0;
  for (auto& client : many) refused += client->answer().starts_with("HTTP/1.1 503");
  EXPECT_GE(refused, 1);
  many.clear();
  EXPECT_TRUE(testing_support::await([this] { return alive(); }));
}

TEST_F(NetTest, ShutdownSaysThatItGoes) {
  SocketClient client(server->port());
  ASSERT_TRUE(client.upgrade());
  client.message(bytes(wire::Hello{}));
  ASSERT_TRUE(decoded(client.receive()));
  std::thread closing([&] { server->shutdown(); });
  EXPECT_EQ(client.awaitClose(), 1001);
  closing.join();
  noCamerasSoon();
  executor.reset();
  server.reset();
}

TEST_F(NetTest, ListeningFailsInOneSentence) {
  Settings other = settings;
  other.port = server->port();
  auto again = Server::listen(other, directory);
  ASSERT_FALSE(again);
  EXPECT_THAT(again.error().message, testing::AllOf(HasSubstr("in use"), HasSubstr("--port")));
  other.port = 0;
  other.host = "0.0.0.0";
  EXPECT_THAT(Server::listen(other, directory).error().message, HasSubstr("--allow-insecure"));
  other.host = "not a host";
  EXPECT_THAT(Server::listen(other, directory).error().message, HasSubstr("127.0.0.1"));
  other.host = "203.0.113.7";  // for documentation: nobody's
  other.allowInsecure = true;
  EXPECT_THAT(Server::listen(other, directory).error().message, HasSubstr("Cannot listen"));
}

}  // namespace
}  // namespace ridgecast::net
