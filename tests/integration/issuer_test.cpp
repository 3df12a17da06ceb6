// An issuer of tokens at a URL of its own, over loopback and TLS: its keys change, it falls, it answers nonsense.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <mutex>
#include <string>
#include <vector>

#include "server/access/crypto.h"
#include "server/net/fetch.h"
#include "tests/integration/access_fixture.h"
#include "tests/support/authority.h"

namespace ridgecast {
namespace {

using testing::HasSubstr;
using testing_support::Authority;
using testing_support::await;

std::string bearer(const std::string& token) { return "Authorization: Bearer " + token + "\r\n"; }

// A key for RS256, by the openssl program.
class SigningKey {
 public:
  explicit SigningKey(std::string kid) : kid_(std::move(kid)) {
    openssl({"genpkey", "-algorithm", "RSA", "-pkeyopt", "rsa_keygen_bits:2048", "-out", folder_ / "private"});
    const std::string said = openssl({"rsa", "-in", folder_ / "private", "-noout", "-modulus"});
    const auto at = said.find("Modulus=");
    for (auto k = at + 8; at != said.npos && k + 1 < said.size() && std::isxdigit(static_cast<unsigned char>(said[k])); k += 2)
      modulus_ += static_cast<char>(std::stoi(said.substr(k, 2), nullptr, 16));
    EXPECT_EQ(modulus_.size(), 256u) << said;
  }
  std::string jwk() const {
    return R"({"kty":"RSA","use":"sig","alg":"RS256","kid":")" + kid_ + R"(","e":"AQAB","n":")" + access::base64url(modulus_) + "\"}";
  }
  std::string sign(const std::string& claims) const {
    const std::string content = access::base64url(R"({"alg":"RS256","kid":")" + kid_ + "\"}") + "." + access::base64url(claims);
    std::ofstream(folder_ / "content") << content;
    openssl({"dgst", "-sha256", "-sign", folder_ / "private", "-out", folder_ / "signature", folder_ / "content"});
    return content + "." + access::base64url(testing_support::readText(folder_ / "signature"));
  }

 private:
  static std::string openssl(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "openssl");
    const auto finished = testing_support::runProgram(arguments);
    EXPECT_EQ(finished.code, 0) << finished.output;
    return finished.output;
  }
  const std::string kid_;
  testing_support::ScratchFolder folder_;
  std::string modulus_;
};

class IssuerTest : public AccessTest {
 protected:
  void SetUp() override {
    if (!testing_support::programExists("openssl")) GTEST_SKIP() << "no openssl";
    AccessTest::SetUp();
    const auto issued = authority.issue("DNS:localhost");
    net::Settings its;
    its.host = "localhost";
    its.port = 0;
    its.tlsCertificate = issued.certificate;
    its.tlsKey = issued.key;
    issuerExecutor = std::make_unique<scheduling::Executor>(1);
    auto shared = std::make_shared<session::Resources>();
    shared->executor = issuerExecutor.get();
    shared->makeMesh = [](auto, const auto&, auto) { return std::make_unique<StillMesh>(); };
    const auto route = [this](const http::Request& request) -> std::optional<http::Reply> {
      if (request.path() != "/keys.json") return std::nullopt;
      const std::lock_guard lock(mutex);
      ++fetches;
      return http::json(published);
    };
    auto made = net::Server::listen(its, std::make_shared<directory::Directory>(shared, terrain::create("alpine", 1).value()), {route});
    ASSERT_TRUE(made) << made.error().message;
    issuer = std::move(*made);
    settings.tokens.keyUrl = "https://localhost:" + std::to_string(issuer->port()) + "/keys.json";
    settings.tokens.keyAuthorities = authority.certificate();
    settings.tokens.jwt = {"terrain", "us", 60s};
  }
  void TearDown() override {
    AccessTest::TearDown();
    if (issuer) issuer->shutdown();
    issuerExecutor.reset();
    issuer.reset();
  }
  void publish(const std::string& text) {
    const std::lock_guard lock(mutex);
    published = text;
  }
  static std::string claims(const std::string& more = R"(,"scope":"openid view")") {
    return R"({"iss":"us","aud":["terrain","other"],"sub":"ann","exp":)" + std::to_string((now() + 1h).time_since_epoch().count()) + more +
           "}";
  }

  Authority authority;
  std::unique_ptr<net::Server> issuer;
  std::unique_ptr<scheduling::Executor> issuerExecutor;
  std::mutex mutex;
  std::string published = R"({"keys":[]})";
  int fetches = 0;
};

TEST_F(IssuerTest, ItsKeysAreFetchedAndFetchedAgainWhenTheyChange) {
  const SigningKey first("2026-11"), second("2026-12");
  publish(R"({"keys":[)" + first.jwk() + "]}");
  start();
  EXPECT_EQ(status("/v1/sessions", bearer(first.sign(claims()))), 200);
  EXPECT_EQ(status("/v1/sessions", bearer(first.sign(claims(R"(,"roles":["query"])")))), 403);
  EXPECT_EQ(status("/v1/sessions", bearer(first.sign(claims(R"(,"scope":"view","iss":"them")")))), 401);
  EXPECT_EQ(status("/v1/stream", bearer(first.sign(claims()))), 101);
  EXPECT_EQ(fetches, 1);
  // A token of a key that nobody knows, within the minute: it is refused, and the issuer is left alone.
  const std::string early = get("/v1/sessions", bearer(second.sign(claims())));
  EXPECT_THAT(early, HasSubstr("HTTP/1.1 401"));
  EXPECT_EQ(fetches, 1);
  // Told to: the new key counts, the old one no longer, and its streams end.
  SocketClient stream(server->port());
  ASSERT_TRUE(stream.upgrade("/v1/stream", bearer(first.sign(claims()))));
  publish(R"({"keys":[)" + second.jwk() + "]}");
  ASSERT_FALSE(server->reload());
  EXPECT_EQ(fetches, 2);
  EXPECT_EQ(status("/v1/sessions", bearer(second.sign(claims()))), 200);
  EXPECT_EQ(status("/v1/sessions", bearer(first.sign(claims()))), 401);
  EXPECT_EQ(stream.awaitClose(), 1008);
  // It falls, or speaks nonsense: the keys stay.
  publish("<html>");
  EXPECT_FALSE(server->reload());
  EXPECT_EQ(status("/v1/sessions", bearer(second.sign(claims()))), 200);
  issuer->shutdown();
  EXPECT_FALSE(server->reload());
  EXPECT_EQ(status("/v1/sessions", bearer(second.sign(claims()))), 200);
}

TEST_F(IssuerTest, AServerThatCannotFetchThemDoesNotStart) {
  const auto complaint = [&] {
    resources = std::make_shared<session::Resources>();
    scheduling::Executor threads(1);
    resources->executor = &threads;
    auto made = net::Server::listen(settings, std::make_shared<directory::Directory>(resources, terrain::create("alpine", 1).value()));
    return made ? "it listens" : made.error().message;
  };
  EXPECT_THAT(complaint(), HasSubstr("The answer of the tokens' issuer cannot be used: it has no key for RS256 or ES256."));
  publish(std::string(access::kMaxKeyBytes + 1, ' '));
  EXPECT_THAT(complaint(), HasSubstr("has more than 65536 bytes"));
  const std::string url = settings.tokens.keyUrl;
  settings.tokens.keyUrl = url + "/none";
  EXPECT_THAT(complaint(), HasSubstr("Cannot fetch " + url + "/none: the answer is HTTP 404."));
  settings.tokens.keyUrl = "https://127.0.0.1:" + std::to_string(issuer->port()) + "/keys.json";
  EXPECT_THAT(complaint(), HasSubstr("certificate is not for '127.0.0.1'"));
  settings.tokens.keyUrl = url;
  settings.tokens.keyAuthorities.clear();  // the system does not trust this one
  EXPECT_THAT(complaint(), HasSubstr("certificate is not to be trusted"));
  settings.tokens.keyAuthorities = authority.certificate();
  issuer->shutdown();
  EXPECT_THAT(complaint(), HasSubstr("Cannot fetch " + url + ": "));
}

TEST(HttpsUrl, IsReadOrRefused) {
  const auto read = [](std::string_view text) {
    const auto url = net::HttpsUrl::parse(text);
    return url ? url->host + " " + url->port + " " + url->target : "refused";
  };
  EXPECT_EQ(read("https://issuer.example/.well-known/jwks.json"), "issuer.example 443 /.well-known/jwks.json");
  EXPECT_EQ(read("https://issuer.example"), "issuer.example 443 /");
  EXPECT_EQ(read("https://issuer.example:8443?v=2"), "issuer.example 8443 /?v=2");
  EXPECT_EQ(read("https://[::1]:7/k"), "::1 7 /k");
  for (const char* wrong :
       {"", "https://", "http://issuer.example/", "issuer.example", "https://a:b@issuer.example/", "https://issuer.example:0/",
        "https://issuer.example:70000/", "https://issuer.example:/", "https://[::1/", "https://issuer.example/ x",
        "https://issuer.example/\r\nx: y", "https://issuer.example/#k", "https://iss\xc3\xbcr.example/", "https://[::1]x/"})
    EXPECT_EQ(read(wrong), "refused") << wrong;
}

}  // namespace
}  // namespace ridgecast
