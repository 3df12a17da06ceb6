// From where a server is asked: pages' origins, names for the machine, addresses and proxies.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "tests/integration/access_fixture.h"

namespace ridgecast {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

TEST_F(AccessTest, OnlyPagesThatMayConnect) {
  settings.allowedOrigins = {"https://friend.example"};
  start();
  const std::string port = std::to_string(server->port());
  const auto answer = [&](const std::string& origin, const std::string& host, const std::string& target) {
    SocketClient client(server->port());
    client.send("GET " + target + " HTTP/1.1\r\nHost: " + host + "\r\nOrigin: " + origin +
                "\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
                "dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
    return client.answer(target != "/v1/stream");
  };
  const auto from = [&](const std::string& origin, const std::string& host, const std::string& target = "/v1/stream") {
    return std::stoi(answer(origin, host, target).substr(9, 3));
  };
  EXPECT_EQ(from("http://127.0.0.1:" + port, "127.0.0.1:" + port), 101);
  EXPECT_EQ(from("http://localhost:" + port, "LOCALHOST:" + port), 101);
  EXPECT_EQ(from("https://friend.example", "127.0.0.1:" + port), 101);
  EXPECT_EQ(from("https://foe.example", "127.0.0.1:" + port), 403);
  EXPECT_EQ(from("null", "127.0.0.1:" + port), 403);
  EXPECT_EQ(from("http://127.0.0.1:1", "127.0.0.1:" + port), 403);
  EXPECT_EQ(from("https://friend.example.foe.example", "127.0.0.1:" + port), 403);
  EXPECT_EQ(from("https://foe.example", "127.0.0.1:" + port, "/v1/sessions"), 403);
  EXPECT_EQ(refusals(metrics::Refusal::kOrigin), 5u);

  const std::string hint = "proxy_set_header Host $http_host.\n";
  EXPECT_THAT(answer("https://127.0.0.1:8443", "127.0.0.1", "/v1/sessions"), AllOf(StartsWith("HTTP/1.1 403"), HasSubstr(hint)));
  EXPECT_THAT(answer("https://127.0.0.1:8443", "127.0.0.1:" + port, "/v1/sessions"), Not(HasSubstr(hint)))
      << "another port of this machine";
  EXPECT_THAT(answer("https://foe.example:8443", "127.0.0.1", "/v1/sessions"), Not(HasSubstr(hint)));
}

// An <img> of another site sends no Origin.
TEST_F(AccessTest, OtherSitesStartNoWork) {
  start();
  const auto from = [&](const std::string& site, const std::string& target, const std::string& method = "GET") {
    SocketClient client(server->port());
    client.send(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\n" + (site.empty() ? "" : "Sec-Fetch-Site: " + site + "\r\n") +
                "\r\n");
    return std::stoi(client.answer(false).substr(9, 3));
  };
  for (const std::string target : {"/v1/sessions", "/v1/heights?at=1,2", "/v1/sessions/default/snapshot.json?x0=0&z0=0&x1=9&z1=9&error=1"})
    EXPECT_EQ(from("cross-site", target), 403) << target;
  EXPECT_EQ(from("cross-site", "/v1/heights", "POST"), 403);
  for (const std::string site : {"", "same-origin", "same-site", "none"}) EXPECT_EQ(from(site, "/v1/sessions"), 200) << site;
  EXPECT_EQ(from("cross-site", "/healthz"), 200);
  EXPECT_EQ(from("cross-site", "/about"), 200) << "a link to the page";
}

// DNS rebinding: a page whose own name was made to point here. Its browser takes the server for the page's own.
TEST_F(AccessTest, NobodyElsesNamesForThisMachine) {
  struct Route {
    std::string target;
    int status;  // under a name of its own
  };
  const std::vector<Route> routes{{"/", 200},          {"/about", 200},       {"/version", 200},
                                  {"/metrics", 200},   {"/v1/sessions", 200}, {"/v1/stream?session=default", 101},
                                  {"/v1/stream", 101}, {"/nothing", 404}};
  const auto ask = [&](const std::string& target, const std::string& host, const std::string& origin) {
    SocketClient client(server->port());
    client.send("GET " + target + " HTTP/1.1\r\n" + (host.empty() ? "" : "Host: " + host + "\r\n") +
                (origin.empty() ? "" : "Origin: " + origin + "\r\n") +
                (target.starts_with("/v1/stream") ? "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                                                    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
                                                  : "Connection: close\r\n\r\n"));
    return client.answer(!target.starts_with("/v1/stream"));
  };
  const auto statusOf = [](const std::string& answer) { return answer.size() > 12 ? std::stoi(answer.substr(9, 3)) : 0; };
  const std::vector<std::string> foreign{"evil.example", "evil.example:PORT", "127.0.0.1.evil.example:PORT", "localhost.evil.example:PORT",
                                         "friend.example:PORT"};
  const auto at = [&](std::string host) {
    if (const auto k = host.find("PORT"); k != std::string::npos) host.replace(k, 4, std::to_string(server->port()));
    return host;
  };

  start();
  std::uint64_t refused = 0;
  for (const Route& route : routes) {
    for (const std::string& host :
         std::vector<std::string>{"localhost", "127.0.0.1:PORT", "LOCALHOST:PORT", "[::1]:PORT", "192.0.2.7", "a.localhost:PORT"})
      EXPECT_EQ(statusOf(ask(route.target, at(host), "")), route.status) << host << " " << route.target;
    if (route.status != 101) {
      EXPECT_EQ(statusOf(ask(route.target, "", "")), route.status) << "no browser asks so: " << route.target;
    }
    EXPECT_EQ(statusOf(ask(route.target, at("127.0.0.1:PORT"), at("http://127.0.0.1:PORT"))), route.status) << route.target;
    for (const std::string& host : foreign)
      for (const std::string& origin : {std::string(), "http://" + at(host), std::string("http://127.0.0.1")}) {
        const std::string answer = ask(route.target, at(host), origin);
        EXPECT_EQ(statusOf(answer), 421) << host << " " << origin << " " << route.target;
        ++refused;
      }
  }
  EXPECT_THAT(ask("/v1/sessions", "evil.example", ""), HasSubstr("--allowed-host"));
  EXPECT_EQ(refusals(metrics::Refusal::kHost), refused + 1);
  for (const char* target : {"/healthz", "/readyz"}) EXPECT_EQ(statusOf(ask(target, "evil.example", "")), 200) << "for who watches it";

  // A name that was allowed is the server's own, for pages as well; other names still are not.
  settings.allowedHosts = {"friend.example"};
  start();
  EXPECT_EQ(statusOf(ask("/v1/stream", at("friend.example:PORT"), at("http://friend.example:PORT"))), 101);
  EXPECT_EQ(statusOf(ask("/v1/sessions", "Friend.example", "")), 200);
  EXPECT_EQ(statusOf(ask("/v1/sessions", "friend.example", "http://evil.example")), 403) << "another page";
  EXPECT_EQ(statusOf(ask("/v1/sessions", "evil.example", "")), 421);

  // Tokens do the same: no other page has them.
  settings.allowedHosts.clear();
  settings.tokens.secrets = {file("secret", kSecret)};
  start();
  EXPECT_EQ(statusOf(ask("/v1/sessions", "evil.example", "")), 401);
  EXPECT_EQ(status("/v1/sessions", "Authorization: Bearer " + jwt(access::Rights::all()) + "\r\n"), 200);
}

TEST_F(AccessTest, ConnectionsOfOneAddressAndOfThoseBehindAProxy) {
  settings.maxConnectionsPerAddress = 3;
  start();
  {
    std::vector<std::unique_ptr<SocketClient>> held;
    for (int k = 0; k < 3; ++k) {
      held.push_back(std::make_unique<SocketClient>(server->port()));
      ASSERT_TRUE(held.back()->upgrade());
    }
    EXPECT_THAT(get("/healthz"), AllOf(StartsWith("HTTP/1.1 429"), HasSubstr("3 connections")));
  }
  EXPECT_TRUE(testing_support::await([&] { return get("/healthz").starts_with("HTTP/1.1 200"); }));

  settings.trustedProxies = {access::Network::parse("127.0.0.0/8").value()};
  start();
  std::vector<std::unique_ptr<SocketClient>> held;
  const auto enters = [&](const std::string& client) {
    held.push_back(std::make_unique<SocketClient>(server->port()));
    return held.back()->upgrade("/v1/stream", "X-Forwarded-For: " + client + "\r\n");
  };
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(enters("192.0.2.1"));
  EXPECT_FALSE(enters("192.0.2.1"));
  EXPECT_THAT(held.back()->refusal(), StartsWith("HTTP/1.1 429"));
  EXPECT_FALSE(enters("192.0.2.9, 192.0.2.1")) << "what a client says of itself counts for nothing";
  EXPECT_FALSE(enters("192.0.2.9\r\nX-Forwarded-For: 192.0.2.1")) << "also in a line of its own, before the proxy's";
  EXPECT_TRUE(enters("192.0.2.2"));
}

}  // namespace
}  // namespace ridgecast
