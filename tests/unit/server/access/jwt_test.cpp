#include "server/access/jwt.h"

#include <gtest/gtest.h>

#include "server/access/crypto.h"

namespace ridgecast::access {
namespace {

const std::string kSecret = "0123456789abcdef0123456789abcdef";
const Time kNow{std::chrono::seconds(1'800'000'000)};

std::string text(const Digest& d) { return {d.begin(), d.end()}; }
std::string signedToken(const std::string& header, const std::string& claims, const std::string& secret = kSecret) {
  const std::string content = base64url(header) + "." + base64url(claims);
  return content + "." + base64url(text(hmacSha256(secret, content)));
}
const std::string kHeader = R"({"alg":"HS256","typ":"JWT"})";
const std::string kClaims = R"({"exp":1800000060,"rights":["view","query"],"session":"harbour","sub":"lab"})";

TEST(Crypto, AgreesWithPublishedValues) {
  EXPECT_EQ(hex(sha256("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");  // FIPS 180-2, B.1
  EXPECT_EQ(hex(hmacSha256("Jefe", "what do ya want for nothing?")),                                  // RFC 4231, 4.3
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
  EXPECT_EQ(base64url("\xfb\xff\xfe"), "-__-");
  for (std::string bytes; bytes.size() < 40; bytes += static_cast<char>(bytes.size() * 37))
    EXPECT_EQ(fromBase64url(base64url(bytes)), bytes);
  for (const char* wrong : {"A", "AB", "AAB", "AAAA=", "AA+A", "AA A"}) EXPECT_FALSE(fromBase64url(wrong)) << wrong;
  EXPECT_TRUE(equalInConstantTime("", ""));
  EXPECT_FALSE(equalInConstantTime("a", "b"));
  EXPECT_FALSE(equalInConstantTime("a", "ab"));
  EXPECT_NE(randomBytes(32), randomBytes(32));
}

// RFC 7515, appendix A.1: signed there with a key of 64 bytes.
TEST(Jwt, JudgesTheSignatureOfTheStandardsExample) {
  const std::string key = *fromBase64url("AyM1SysPpbyDfgZld3umj1qzKObwVMkoqQ-EstJQLr_T-1qS0gZH75aKtMN3Yj0iPS4hcgUuTwjAzZr1Z9CAow");
  const std::string token =
      "eyJ0eXAiOiJKV1QiLA0KICJhbGciOiJIUzI1NiJ9."
      "eyJpc3MiOiJqb2UiLA0KICJleHAiOjEzMDA4MTkzODAsDQogImh0dHA6Ly9leGFtcGxlLmNvbS9pc19yb290Ijp0cnVlfQ."
      "dBjftJeZ4CVP-mB92K27uhbUJU1p1r_wW1gFWFOEjXk";
  EXPECT_EQ(verifyJwt(token, key, Time(std::chrono::seconds(1'300'819'380))).error().message, "The token has expired.");
  EXPECT_EQ(verifyJwt(token, key, Time(std::chrono::seconds(1'300'819'379))).error().message, "The token names no rights.");
  EXPECT_EQ(verifyJwt(token, kSecret, kNow).error().message, "The token's signature is wrong.");
}

TEST(Jwt, GrantsWhatItSays) {
  const auto grant = verifyJwt(signedToken(kHeader, kClaims), kSecret, kNow);
  ASSERT_TRUE(grant) << grant.error().message;
  EXPECT_EQ(grant->rights, Rights(Right::kView) | Right::kQuery);
  EXPECT_EQ(grant->session, "harbour");
  EXPECT_EQ(grant->name, "lab");
  EXPECT_TRUE(grant->reaches("harbour"));
  EXPECT_FALSE(grant->reaches("default"));
  const auto wide =
      verifyJwt(signedToken(kHeader, R"({"exp":1e300,"rights":"view,create,query,snapshot,clock","sub":"evil \n name"})"), kSecret, kNow);
  ASSERT_TRUE(wide) << wide.error().message;
  EXPECT_EQ(wide->rights, Rights::all());
  EXPECT_TRUE(wide->reaches("anything"));
  EXPECT_EQ(wide->name, "");
}

TEST(Jwt, IssuesWhatItVerifies) {
  Grant grant{"lab", Rights(Right::kSnapshot) | Right::kView, "a.b", kNow + std::chrono::hours(1)};
  const std::string token = issueJwt(grant, kSecret, kNow);
  const auto back = verifyJwt(token, kSecret, kNow);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->rights, grant.rights);
  EXPECT_EQ(back->session, grant.session);
  EXPECT_EQ(back->name, grant.name);
  EXPECT_EQ(back->expires, grant.expires);
  EXPECT_TRUE(verifyJwt(token, kSecret, kNow + std::chrono::seconds(3599)));
  EXPECT_FALSE(verifyJwt(token, kSecret, kNow + std::chrono::seconds(3600)));
}

TEST(Jwt, RefusesEveryDamage) {
  const std::string token = signedToken(kHeader, kClaims);
  ASSERT_TRUE(verifyJwt(token, kSecret, kNow));
  for (std::size_t k = 0; k < token.size(); ++k)
    for (const char c : {'A', 'b', '_', '.', '=', '\0', '\xff'}) {
      std::string damaged = token;
      damaged[k] = c;
      if (damaged == token) continue;
      EXPECT_FALSE(verifyJwt(damaged, kSecret, kNow)) << k;
    }
  for (std::size_t k = 0; k < token.size(); ++k) EXPECT_FALSE(verifyJwt(token.substr(0, k), kSecret, kNow));
  EXPECT_FALSE(verifyJwt(token + "A", kSecret, kNow));
  EXPECT_FALSE(verifyJwt(token + ".", kSecret, kNow));
  EXPECT_FALSE(verifyJwt(token, kSecret + "x", kNow));
}

TEST(Jwt, RefusesOtherWaysOfSigning) {
  const std::string unsignedToken = base64url(R"({"alg":"none","typ":"JWT"})") + "." + base64url(kClaims) + ".";
  EXPECT_FALSE(verifyJwt(unsignedToken, kSecret, kNow));
  // Even where the signature is right.
  for (const char* header :
       {R"({"alg":"none"})", R"({"alg":"None"})", R"({"alg":"HS512"})", R"({"alg":"hs256"})", R"({"alg":"RS256"})", R"({"alg":["HS256"]})",
        R"({"typ":"JWT"})", R"([])", R"("HS256")", "", "{", R"({"alg":"HS256","crit":["exp"]})"})
    EXPECT_FALSE(verifyJwt(signedToken(header, kClaims), kSecret, kNow)) << header;
}

TEST(Jwt, RefusesClaimsThatAreNone) {
  const std::string deep(3000, '[');
  for (const std::string claims :
       {"", "[]", "null", "{", R"({"rights":["view"]})", R"({"exp":"1800000060","rights":["view"]})",
        R"({"exp":1800000000,"rights":["view"]})", R"({"exp":-1,"rights":["view"]})", R"({"exp":null,"rights":["view"]})",
        R"({"exp":1800000060})", R"({"exp":1800000060,"rights":[]})", R"({"exp":1800000060,"rights":"admin"})",
        R"({"exp":1800000060,"rights":["view",1]})", R"({"exp":1800000060,"rights":{"view":true}})",
        R"({"exp":1800000060,"rights":["view"],"nbf":1800000001})", R"({"exp":1800000060,"rights":["view"],"nbf":"x"})",
        R"({"exp":1800000060,"rights":["view"],"session":"a/b"})", R"({"exp":1800000060,"rights":["view"],"session":7})",
        R"({"exp":1800000060,"rights":["view"],"session":""})"})
    EXPECT_FALSE(verifyJwt(signedToken(kHeader, claims), kSecret, kNow)) << claims;
  EXPECT_FALSE(verifyJwt(signedToken(kHeader, deep), kSecret, kNow));
  EXPECT_FALSE(verifyJwt(signedToken(kHeader, std::string(kMaxTokenBytes, 'x')), kSecret, kNow));
}

}  // namespace
}  // namespace ridgecast::access
