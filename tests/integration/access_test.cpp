// Who may do what: tokens on the WebSocket and on every HTTP route, TLS with an authority of our own, limits, leaving.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <latch>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/link/connection.h"
#include "common/wire/wire.h"
#include "server/access/crypto.h"
#include "server/access/jwt.h"
#include "server/access/tokens.h"
#include "server/net/server.h"
#include "tests/integration/access_fixture.h"
#include "tests/support/authority.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using testing::AnyOf;
using testing::HasSubstr;
using testing::StartsWith;

TEST_F(AccessTest, TokensOnTheWebSocketAndOnEveryRoute) {
  using access::Right;
  const access::NewToken listed = access::makeToken({"lab", access::Rights::all(), "", {}});
  const access::NewToken expired = access::makeToken({"late", access::Rights::all(), "", now() - 1h});
  settings.tokens.tokens = file("tokens", listed.line + "\n" + expired.line + "\n");
  settings.tokens.secrets = {file("secret", kSecret + "\n")};
  start();

  // Every route that shows or does something, and the right that it asks for.
  struct Guarded {
    std::string method, target;
    Right right;
    bool everySession;
  };
  const std::vector<Guarded> guarded{{"GET", "/v1/stream?session=default", Right::kView, false},
                                     {"GET", "/v1/stream", Right::kView, false},
                                     {"GET", "/v1/sessions", Right::kView, true},
                                     {"HEAD", "/v1/sessions", Right::kView, true},
                                     {"POST", "/v1/sessions", Right::kCreate, true},
                                     {"GET", "/metrics", Right::kView, true},
                                     {"GET", "/v1/heights?session=default&x=0&z=0", Right::kQuery, false},
                                     {"GET", "/v1/normals?session=default", Right::kQuery, false},
                                     {"GET", "/v1/materials", Right::kQuery, false},
                                     {"GET", "/v1/rays", Right::kQuery, false},
                                     {"POST", "/v1/query", Right::kQuery, false},
                                     {"POST", "/v1/heights?session=default", Right::kQuery, false},
                                     {"POST", "/v1/rays?reach=9", Right::kQuery, false},
                                     {"GET", "/v1/sessions/default/snapshot.glb", Right::kSnapshot, false},
                                     {"GET", "/v1/sessions/default/heights/3/1/2.png?at=0,0", Right::kQuery, false},
                                     {"GET", "/v1/sessions/default/colours/3/1/2.jpg?at=0,0", Right::kQuery, false},
                                     {"HEAD", "/v1/sessions/default/snapshot.json?session=elsewhere", Right::kSnapshot, false},
                                     {"GET", "/v1/sessions/default/3dtiles/tileset.json", Right::kSnapshot, false},
                                     {"HEAD", "/v1/sessions/default/3dtiles/1/2/3.glb?x=1", Right::kSnapshot, false},
                                     {"GET", "/v1/sessions/default/whatever", Right::kView, false},
                                     {"DELETE", "/v1/sessions/default", Right::kAdmin, false},
                                     {"DELETE", "/v1/sessions/default/members/7", Right::kAdmin, false},
                                     {"GET", "/v1/whatever/comes/later", Right::kView, false}};
  const std::vector<Right> rights{Right::kView, Right::kCreate, Right::kQuery, Right::kSnapshot, Right::kClock, Right::kAdmin};
  const auto bearer = [](const std::string& token) { return "Authorization: Bearer " + token + "\r\n"; };
  const std::string good = jwt(access::Rights::all());
  std::string tampered = good;
  tampered[good.find('.') + 5] ^= 1;
  std::string resigned = good;
  resigned.back() = resigned.back() == 'A' ? 'B' : 'A';
  const std::string unsignedToken =
      access::base64url(R"({"alg":"none"})") + good.substr(good.find('.'), good.rfind('.') - good.find('.') + 1);
  const std::string otherSecret = access::issueJwt({"x", access::Rights::all(), "", now() + 1h}, kSecret + "!", now());
  struct Bad {
    std::string what, headers;
  };
  const std::vector<Bad> bad{{"missing", ""},
                             {"empty", "Authorization: Bearer \r\n"},
                             {"another scheme", "Authorization: Basic " + access::base64url("lab:" + listed.token) + "\r\n"},
                             {"unknown", bearer(listed.token.substr(0, listed.token.size() - 1))},
                             {"its hash", bearer(listed.line.substr(listed.line.find("sha256:") + 7))},
                             {"expired, listed", bearer(expired.token)},
                             {"expired", bearer(jwt(access::Rights::all(), "", -1s))},
                             {"tampered", bearer(tampered)},
                             {"tampered signature", bearer(resigned)},
                             {"alg:none", bearer(unsignedToken)},
                             {"another secret", bearer(otherSecret)},
                             {"in the query only", ""},
                             {"a subprotocol of no token", "Sec-WebSocket-Protocol: ridgecast.v1, bearer.nothing\r\n"}};
  for (const Guarded& g : guarded) {
    SCOPED_TRACE(g.method + " " + g.target);
    for (const Bad& b : bad) {
      const std::string more =
          b.what == "in the query only" ? std::string(g.target.find('?') == std::string::npos ? "?" : "&") + "token=" + listed.token : "";
      EXPECT_EQ(status(g.target + more, b.headers, g.method), 401) << b.what;
    }
    for (const Right right : rights) {
      const int answered = status(g.target, bearer(jwt(right)), g.method);
      if (right == g.right)
        EXPECT_THAT(answered, testing::Not(AnyOf(401, 403))) << access::name(right);
      else
        EXPECT_EQ(answered, 403) << access::name(right);
    }
    EXPECT_EQ(status(g.target, bearer(jwt(access::Rights::all(), "elsewhere")), g.method), 403) << "wrong session";
    const int own = status(g.target, bearer(jwt(access::Rights::all(), "default")), g.method);
    if (g.everySession)
      EXPECT_EQ(own, 403);
    else
      EXPECT_THAT(own, testing::Not(AnyOf(401, 403)));
    EXPECT_THAT(status(g.target, bearer(listed.token), g.method), testing::Not(AnyOf(401, 403)));
    EXPECT_THAT(status(g.target, "Sec-WebSocket-Protocol: ridgecast.v1, bearer." + good + "\r\n", g.method), testing::Not(AnyOf(401, 403)));
  }
  // What is open to all, and tells nothing.
  for (const char* target : {"/", "/about", "/healthz", "/readyz", "/version"}) EXPECT_EQ(status(target, ""), 200) << target;
  EXPECT_THAT(get("/about"), testing::Not(HasSubstr("alpine, seed")));
  // To make a session takes the right to.
  EXPECT_EQ(status("/v1/stream?session=new&terrain=canyon", bearer(jwt(Right::kView))), 403);
  EXPECT_EQ(status("/v1/stream?session=new&terrain=canyon", bearer(jwt(access::Rights(Right::kView) | Right::kCreate))), 101);
  EXPECT_EQ(status("/v1/stream?session=new", bearer(jwt(Right::kView))), 101);
  // The session is the decoded one, however it is written, and the first of two.
  EXPECT_EQ(status("/v1/stream?session=n%65w", bearer(jwt(Right::kView, "new"))), 101);
  EXPECT_EQ(status("/v1/stream?session=default&session=new", bearer(jwt(Right::kView, "new"))), 403);
  EXPECT_GT(refusals(metrics::Refusal::kToken), 100u);
  EXPECT_GT(refusals(metrics::Refusal::kRight), 20u);
}

// Viewers of 3D Tiles cannot set headers.
TEST_F(AccessTest, ATokenInTheUrlOfATilesetExpiresSoon) {
  using access::Right;
  const access::NewToken endless = access::makeToken({"lab", access::Rights::all(), "", {}});
  const access::NewToken brief = access::makeToken({"guest", Right::kSnapshot, "", now() + 1h});
  settings.tokens.tokens = file("tokens", endless.line + "\n" + brief.line + "\n");
  settings.tokens.secrets = {file("secret", kSecret + "\n")};
  start();
  const std::string tile = "/v1/sessions/default/3dtiles/1/2/3.glb?compression=draco&token=";
  EXPECT_EQ(status(tile + brief.token, ""), 404);  // judged and let through; no route is here
  EXPECT_EQ(status(tile + jwt(Right::kSnapshot, "default", 23h), ""), 404);
  EXPECT_EQ(status(tile + jwt(Right::kSnapshot, "", 25h), ""), 401);
  EXPECT_EQ(status(tile + endless.token, ""), 401);
  EXPECT_THAT(get(tile + endless.token), HasSubstr("must expire within a day"));
  EXPECT_EQ(status(tile + jwt(Right::kSnapshot, "", -1s), ""), 401);
  EXPECT_EQ(status(tile + jwt(Right::kView), ""), 403);
  EXPECT_EQ(status(tile + jwt(Right::kSnapshot, "elsewhere"), ""), 403);
  EXPECT_EQ(status(tile + "nonsense", "Authorization: Bearer " + endless.token + "\r\n"), 404);  // the header counts
  for (const char* other : {"/v1/sessions/default/snapshot.glb?token=", "/v1/sessions?x=/3dtiles/&token=", "/v1/sessions/3dtiles/x?token=",
                            "/v1/heights?at=0,0&token=", "/metrics?token="})
    EXPECT_EQ(status(other + jwt(access::Rights::all()), ""), 401) << other;
}

TEST_F(AccessTest, AStreamEndsWithItsTokenAndAsksNothingWithoutTheRight) {
  settings.tokens.secrets = {file("secret", kSecret)};
  start();
  std::unique_ptr<SocketClient> client;
  bool entered = false;
  for (const auto lasts : {2s, 5s, 20s, 60s}) {  // a slow machine may need longer than that to come in
    client = std::make_unique<SocketClient>(server->port());
    entered = client->upgrade("/v1/stream", "Authorization: Bearer " + jwt(access::Right::kView, "", lasts) + "\r\n");
    if (entered) break;
  }
  ASSERT_TRUE(entered);
  client->message(wire::encode(wire::ClientMessage(wire::Hello{})));
  EXPECT_EQ(client->awaitClose(), 1008);
  EXPECT_EQ(refusals(metrics::Refusal::kExpired), 1u);
  SocketClient curious(server->port());
  ASSERT_TRUE(curious.upgrade("/v1/stream", "Authorization: Bearer " + jwt(access::Right::kView) + "\r\n"));
  curious.message(wire::encode(wire::ClientMessage(wire::Hello{})));
  wire::Query query;
  query.x = {0};
  query.z = {0};
  curious.message(wire::encode(wire::ClientMessage(query)));
  EXPECT_EQ(curious.awaitClose(), 1008);
  EXPECT_EQ(refusals(metrics::Refusal::kRight), 1u);
}

TEST_F(AccessTest, TheClockTakesARight) {
  settings.tokens.secrets = {file("secret", kSecret)};
  start();
  for (const int kind : {0, 1, 2}) {
    const auto say = [&](link::Connection& c) {
      if (kind == 0) c.setClock({true, wire::ClockMode::kStepped, 0});
      if (kind == 1) c.step({1, false});
      if (kind == 2) c.passOver(1);
    };
    const auto viewer = connect(server->url(), "", jwt(access::Right::kView));
    ASSERT_TRUE(viewer) << viewer.error().message;
    (*viewer)->stepDone({1});
    say(**viewer);
    ASSERT_TRUE(testing_support::await([&] { return (*viewer)->clock().notice() == "The token lacks the right 'clock'."; }));
    EXPECT_FALSE((*viewer)->error());
    EXPECT_EQ((*viewer)->clock().said().owner, 0u) << "whoever may view may take the clock";
  }
  const auto owner = connect(server->url(), "", jwt(access::Rights(access::Right::kView) | access::parseRights("clock").value()));
  ASSERT_TRUE(owner);
  (*owner)->setClock({true, wire::ClockMode::kStepped, 0});
  ASSERT_TRUE((*owner)->waitForClock(0, testing_support::kTimeout));
  EXPECT_EQ((*owner)->clock().said().owner, (*owner)->world().camera);
}

// A time that nanoseconds cannot count to once ended streams at their first moment.
TEST_F(AccessTest, TokensMayEndInTheFarFuture) {
  const access::NewToken far = access::makeToken({"a", access::Right::kView, "", access::parseTime("9999-12-31T23:59:59Z")});
  settings.tokens.tokens = file("tokens", far.line + "\n");
  settings.tokens.secrets = {file("secret", kSecret)};
  start();
  const std::string forEver =
      access::issueJwt({"b", access::Right::kView, "", access::Time(std::chrono::seconds(90'000'000'000))}, kSecret, now());
  for (const std::string& token : {far.token, forEver}) {
    const auto stream = connect(server->url(), "", token);
    ASSERT_TRUE(stream) << stream.error().message;
    wire::PoseMessage pose;
    pose.sequence = 1;
    (*stream)->send(pose);
    EXPECT_TRUE((*stream)->receive(testing_support::kTimeout));
  }
}

TEST_F(AccessTest, ReloadingTakesTokensAwayAndAMistakeChangesNothing) {
  const access::NewToken first = access::makeToken({"a", access::Right::kView, "", {}}),
                         second = access::makeToken({"b", access::Right::kView, "", {}});
  settings.tokens.tokens = file("tokens", first.line);
  start();
  const auto may = [&](const access::NewToken& t) { return status("/v1/sessions", "Authorization: Bearer " + t.token + "\r\n") == 200; };
  EXPECT_TRUE(may(first) && !may(second));
  file("tokens", second.line);
  EXPECT_FALSE(server->reload());
  EXPECT_TRUE(!may(first) && may(second));
  file("tokens", "nonsense");
  const auto error = server->reload();
  ASSERT_TRUE(error);
  EXPECT_THAT(error->message, HasSubstr("Line 1"));
  EXPECT_TRUE(may(second));
}

TEST_F(AccessTest, ReloadingEndsTheStreamsOfWithdrawnTokens) {
  const access::NewToken stays = access::makeToken({"a", access::Right::kView, "", {}}),
                         goes = access::makeToken({"b", access::Right::kView, "", {}}),
                         narrows = access::makeToken({"c", access::Right::kView, "", {}});
  settings.tokens.tokens = file("tokens", stays.line + "\n" + goes.line + "\n" + narrows.line);
  start();
  auto kept = connect(server->url(), "", stays.token), lost = connect(server->url(), "", goes.token),
       narrowed = connect(server->url(), "", narrows.token);
  ASSERT_TRUE(kept && lost && narrowed);
  const auto hash = narrows.line.substr(narrows.line.find("sha256:"));
  file("tokens", stays.line + "\nc view elsewhere never " + hash);
  EXPECT_FALSE(server->reload());
  for (const auto& ended : {&lost, &narrowed}) {
    EXPECT_TRUE(testing_support::await([&] { return (**ended)->error().has_value(); }));
    EXPECT_THAT((**ended)->error()->message, HasSubstr("token"));
  }
  wire::PoseMessage pose;
  pose.sequence = 1;
  (*kept)->send(pose);
  EXPECT_TRUE((*kept)->receive(testing_support::kTimeout));
}

// Its world is being made while the tokens are reloaded: the stream does not exist yet when all others are judged again.
TEST_F(AccessTest, ReloadingEndsAStreamThatIsStillBeingOpened) {
  const access::NewToken goes = access::makeToken({"b", access::Rights::all(), "", {}}),
                         stays = access::makeToken({"a", access::Rights::all(), "", {}});
  settings.tokens.tokens = file("tokens", stays.line + "\n" + goes.line);
  settings.worldJobs.threads = 2;
  start();
  std::latch begun(2), reloaded(1);
  resources->makeTerrain = [&](const session::WorldSpec& spec, const std::stop_token&) {
    begun.count_down();
    reloaded.wait();
    return terrain::create("alpine", spec.seed);
  };
  const auto open = [&](const std::string& token, const std::string& name) {
    return std::async(std::launch::async, [=, this] { return connect(server->url() + "/?session=" + name + "&terrain=slow", "", token); });
  };
  auto lost = open(goes.token, "lost"), kept = open(stays.token, "kept");
  begun.wait();
  file("tokens", stays.line);
  EXPECT_FALSE(server->reload());
  reloaded.count_down();
  const auto refused = lost.get(), flying = kept.get();
  ASSERT_FALSE(refused) << "it flies with a withdrawn token";
  EXPECT_THAT(refused.error().message, HasSubstr("The token was withdrawn."));
  ASSERT_TRUE(flying) << flying.error().message;
  EXPECT_EQ(refusals(metrics::Refusal::kToken), 1u);
}

TEST_F(AccessTest, TlsIsVerifiedByTheClientAndReloaded) {
  testing_support::Authority authority, stranger;
  auto issued = authority.issue("DNS:localhost,IP:127.0.0.1");
  settings.tlsCertificate = folder / "server.pem";
  settings.tlsKey = folder / "server.key";
  const auto install = [&](const testing_support::Authority::Issued& i) {
    std::filesystem::copy_file(i.certificate, settings.tlsCertificate, std::filesystem::copy_options::overwrite_existing);
    std::filesystem::copy_file(i.key, settings.tlsKey, std::filesystem::copy_options::overwrite_existing);
  };
  install(issued);
  settings.tokens.secrets = {file("secret", kSecret)};
  settings.timeout = 2s;
  start();
  EXPECT_THAT(server->url(), StartsWith("https://"));
  const std::string port = std::to_string(server->port());
  const std::string token = jwt(access::Right::kView);

  auto stream = connect("wss://localhost:" + port, authority.certificate(), token);
  ASSERT_TRUE(stream) << stream.error().message;
  EXPECT_EQ((*stream)->world().terrainName, "alpine");
  wire::PoseMessage pose;
  pose.sequence = 1;
  (*stream)->send(pose);
  EXPECT_TRUE((*stream)->receive(testing_support::kTimeout));
  EXPECT_TRUE(connect("https://127.0.0.1:" + port, authority.certificate(), token));
  const auto complaint = [&](const std::string& address, const std::string& ca, const std::string& t) {
    const auto refused = connect(address, ca, t);
    return refused ? std::string("it was accepted") : refused.error().message;
  };
  EXPECT_THAT(complaint("wss://localhost:" + port, stranger.certificate(), token), HasSubstr("not to be trusted"));
  EXPECT_THAT(complaint("wss://localhost:" + port, "", token), HasSubstr("--ca"));
  EXPECT_THAT(complaint("wss://localhost:" + port, "/no/such/file", token), HasSubstr("/no/such/file"));
  EXPECT_THAT(complaint("wss://localhost:" + port, authority.certificate(), ""), HasSubstr("401"));
  EXPECT_THAT(complaint("ws://localhost:" + port, "", token), HasSubstr("TLS"));
  EXPECT_THAT(get("/healthz"), AllOf(StartsWith("HTTP/1.1 400"), HasSubstr("https://")));

  install(authority.issue("DNS:elsewhere.example"));
  EXPECT_FALSE(server->reload());
  EXPECT_THAT(complaint("wss://localhost:" + port, authority.certificate(), token), HasSubstr("not for 'localhost'"));
  EXPECT_FALSE((*stream)->error()) << "who is there stays";
  // A key that is another's: refused, and what there was stays.
  std::filesystem::copy_file(issued.key, settings.tlsKey, std::filesystem::copy_options::overwrite_existing);
  const auto error = server->reload();
  ASSERT_TRUE(error);
  EXPECT_THAT(error->message, HasSubstr("is not that of the certificate"));
  install(issued);
  EXPECT_FALSE(server->reload());
  EXPECT_TRUE(connect("wss://localhost:" + port, authority.certificate(), token));
  // A mistake in the tokens: the certificate stays as well.
  install(authority.issue("DNS:elsewhere.example"));
  file("secret", "too short");
  EXPECT_TRUE(server->reload());
  EXPECT_TRUE(connect("wss://localhost:" + port, authority.certificate(), token));
  // Bytes that begin like TLS and are none.
  SocketClient junk(server->port());
  junk.send("\x16\x03\x01 this is no handshake");
  EXPECT_TRUE(junk.closed());
  EXPECT_GE(refusals(metrics::Refusal::kTls), 2u);
}

TEST_F(AccessTest, PlacesAreRefusedWithoutTlsAndTokens) {
  const auto complaint = [&] {
    auto made = net::Server::listen(settings, directory);
    return made ? std::string("it listens") : made.error().message;
  };
  start();
  testing_support::Authority authority;
  const auto issued = authority.issue("DNS:localhost");
  settings.host = "0.0.0.0";
  EXPECT_THAT(complaint(), AllOf(HasSubstr("without TLS and tokens"), HasSubstr("--allow-insecure")));
  settings.tokens.secrets = {file("secret", kSecret)};
  EXPECT_THAT(complaint(), HasSubstr("without TLS:"));
  settings.tlsCertificate = issued.certificate;
  EXPECT_THAT(complaint(), HasSubstr("--tls-key"));
  settings.tlsKey = issued.key;
  EXPECT_EQ(complaint(), "it listens");
  settings.tokens.secrets.clear();
  EXPECT_THAT(complaint(), HasSubstr("without tokens"));
  settings.allowInsecure = true;
  EXPECT_EQ(complaint(), "it listens");
  settings.tlsKey = file("no.key", "nonsense");
  EXPECT_THAT(complaint(), HasSubstr("no.key"));
}

TEST_F(AccessTest, MessagesHaveASizeAndPingsARate) {
  settings.maxMessageBytes = 2000;
  settings.maxMessagesPerSecond = 20;
  start();
  SocketClient large(server->port());
  ASSERT_TRUE(large.upgrade());
  large.message(std::string(2001, 'x'));
  EXPECT_EQ(large.awaitClose(), 1009);
  SocketClient pings(server->port());
  ASSERT_TRUE(pings.upgrade());
  for (int k = 0; k < 600; ++k) pings.frame(9, "");
  EXPECT_EQ(pings.awaitClose(), 1008);
  EXPECT_EQ(refusals(metrics::Refusal::kMessageSize), 1u);
  EXPECT_EQ(refusals(metrics::Refusal::kMessageRate), 1u);
}

// In lock-step each message waits for the server's answer: who flies as fast as it answers has done nothing wrong.
TEST_F(AccessTest, WhoSaysMoreThanIsReadInASecondWaits) {
  settings.maxMessagesPerSecond = 40;
  start();
  wire::Hello hello;
  hello.pacing = wire::Pacing::kLockstep;
  auto stream =
      link::Connection::open(core::parseUrl("ws://127.0.0.1:" + std::to_string(server->port()) + "/v1/stream").value(), hello).value();
  const auto began = std::chrono::steady_clock::now();
  for (wire::PoseMessage pose; pose.sequence < 60;) {
    ++pose.sequence;
    stream->send(pose);
    const auto received = stream->receive(testing_support::kTimeout);
    ASSERT_TRUE(received) << (stream->error() ? stream->error()->message : "no answer");
    stream->acknowledge({received->iteration.number, received->iteration.meshHash});
  }
  EXPECT_GT(std::chrono::steady_clock::now() - began, 2s) << "of 120 messages and hello, 10 are on credit";
  EXPECT_EQ(refusals(metrics::Refusal::kMessageRate), 0u);
}

TEST_F(AccessTest, LeavingTellsClientsWhereToGo) {
  settings.reconnectUrl = "ws://192.0.2.1:7070";
  start();
  const std::string address = "ws://127.0.0.1:" + std::to_string(server->port());
  auto stream = connect(address, "");
  ASSERT_TRUE(stream);
  EXPECT_EQ(status("/readyz", ""), 200);
  server->drain();
  EXPECT_EQ(status("/readyz", ""), 503);
  EXPECT_EQ(status("/healthz", ""), 200);
  EXPECT_EQ(status("/v1/stream", ""), 503);
  EXPECT_TRUE(testing_support::await([&] { return (*stream)->error().has_value(); }));
  EXPECT_EQ((*stream)->sentTo(), "ws://192.0.2.1:7070");
  server->undrain();
  EXPECT_EQ(status("/readyz", ""), 200);
  auto again = connect(address, "");
  ASSERT_TRUE(again);
  server->shutdown();
  EXPECT_EQ((*again)->sentTo(), "ws://192.0.2.1:7070");
}

}  // namespace
}  // namespace ridgecast
