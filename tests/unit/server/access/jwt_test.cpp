#include "server/access/jwt.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <vector>

#include "server/access/crypto.h"
#include "server/access/keys.h"
#include "tests/support/process.h"

namespace ridgecast::access {
namespace {

Outcome<Grant> verifyJwt(std::string_view token, const std::string& secret, Time now) {
  return access::verifyJwt(token, std::vector{Key(secret)}, now);
}

const std::string kSecret = "0123456789abcdef0123456789abcdef";
const Time kToday{std::chrono::seconds(1'800'000'000)};

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
  EXPECT_EQ(verifyJwt(token, kSecret, kToday).error().message, "The token's signature is wrong.");
}

// RFC 7515, appendices A.2 and A.3.
const std::string kRsaJwk =
    R"({"kty":"RSA","n":"ofgWCuLjybRlzo0tZWJjNiuSfb4p4fAkd_wWJcyQoTbji9k0l8W26mPddxHmfHQp-Vaw-4qPCJrcS2mJPMEzP1Pt0Bm4d4QlL-yRT-)"
    R"(SFd2lZS-pCgNMs)"
    R"(D1W_YpRPEwOWvG6b32690r2jZ47soMZo9wGzjb_7OMg0LOL-bSf63kpaSHSXndS5z5rexMdbBYUsLA9e-KXBdQOS-UTo7WTBEMa2R2CapHg665xsmtdV)"
    R"(MTBQY4uDZlxvb3qCo5ZwKh9kG4LT6_I5IhlJH7aGhyxXFvUK-DWNmoudF8NAco9_h9iaGNj8q2ethFkMLs91kzk2PAcDTW9gb54h4FRWyuXpoQ","e":"AQAB"})";
const std::string kCurveJwk =
    R"({"kty":"EC","crv":"P-256","x":"f83OJ3D2xF1Bg8vub9tLe1gHMzV76e8Tus9uPHvRVEU","y":"x_FEzRu9m36HLN_tue659LNpXW6pCyStikYjKIWI5a0"})";
const std::string kRsaToken =
    "eyJhbGciOiJSUzI1NiJ9.eyJpc3MiOiJqb2UiLA0KICJleHAiOjEzMDA4MTkzODAsDQogImh0dHA6Ly9leGFtcGxlLmNvbS9pc19yb290Ijp0cnVlfQ."
    "cC4hiUPoj9Eetdgtv3hF80EGrhuB__dzERat0XF9g2VtQgr9PJbu3XOiZj5RZmh7AAuHIm4Bh-0Qc_lF5YKt_O8W2Fp5jujGbds9uJdbF9CUAr7t1dnZcAcQjb"
    "KBYNX4BAynRFdiuB--f_nZLgrnbyTyWzO75vRK5h6xBArLIARNPvkSjtQBMHlb1L07Qe7K0GarZRmB_eSN9383LcOLn6_dO--xi12jzDwusC-eOkHWEsqtFZES"
    "c6BfI7noOPqvhJ1phCnvWh6IeYI2w9QOYEUipUTI8np6LbgGY9Fs98rqVt5AXLIhWkWywlVmtVrBp0igcN_IoypGlUPQGe77Rw";
const std::string kCurveToken =
    "eyJhbGciOiJFUzI1NiJ9.eyJpc3MiOiJqb2UiLA0KICJleHAiOjEzMDA4MTkzODAsDQogImh0dHA6Ly9leGFtcGxlLmNvbS9pc19yb290Ijp0cnVlfQ."
    "DtEhU3ljbEg8L38VWAfUAqOyKAM6-Xx-F4GawxaepmXFCgfTjDxw5djxLa8ISlSApmWQxfKTUJqPP3-Kg6NU1Q";

class KeyFiles : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& content) {
    std::filesystem::path path = folder_ / ("keys" + std::to_string(++files_));
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  std::string complaint(const std::string& content) {
    const auto keys = Key::readPublic(file(content));
    return keys ? "it was read" : keys.error().message;
  }
  testing_support::ScratchFolder folder_;
  int files_ = 0;
};

TEST_F(KeyFiles, JudgeTheSignaturesOfTheStandardsExamples) {
  const auto keys =
      Key::readPublic(file(R"({"keys":[{"kty":"oct","k":"AyM1"},{"kty":"RSA","use":"enc"},)" + kRsaJwk + "," + kCurveJwk + "]}"));
  ASSERT_TRUE(keys) << keys.error().message;
  ASSERT_EQ(keys->size(), 2u);
  EXPECT_EQ((*keys)[0].algorithm(), "RS256");
  EXPECT_EQ((*keys)[1].algorithm(), "ES256");
  const Time early(std::chrono::seconds(1'300'819'379));
  for (const std::string& token : {kRsaToken, kCurveToken}) {
    EXPECT_EQ(access::verifyJwt(token, *keys, early).error().message, "The token names no rights.");
    EXPECT_EQ(access::verifyJwt(token, *keys, kToday).error().message, "The token has expired.");
    for (std::size_t k = token.rfind('.') + 1; k + 1 < token.size(); k += 7) {
      std::string damaged = token;
      damaged[k] = damaged[k] == 'A' ? 'B' : 'A';
      EXPECT_EQ(access::verifyJwt(damaged, *keys, early).error().message, "The token's signature is wrong.");
      EXPECT_EQ(access::verifyJwt(token.substr(0, k), *keys, early).error().message, "The token's signature is wrong.");
    }
  }
  const std::vector<Key> rsaAlone{(*keys)[0]};
  EXPECT_EQ(access::verifyJwt(kCurveToken, rsaAlone, early).error().message, "The token's signature is wrong.");
}

// The known attack: a public key used as an HMAC's secret.
TEST_F(KeyFiles, APublicKeyIsNoSecretAndAKeyHasOneAlgorithm) {
  const auto keys = Key::readPublic(file(R"({"keys":[)" + kRsaJwk + "]}"));
  ASSERT_TRUE(keys);
  EXPECT_EQ(access::verifyJwt(signedToken(kHeader, kClaims, kRsaJwk), *keys, kToday).error().message, "The token's signature is wrong.");
  EXPECT_EQ(verifyJwt(signedToken(R"({"alg":"RS256"})", kClaims), kSecret, kToday).error().message,
            "The token names another algorithm than its key's, HS256.");
}

TEST_F(KeyFiles, OfOpenSslAreRead) {
  const std::string folder = folder_ / "";
  const auto openssl = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "openssl");
    const auto finished = testing_support::runProgram(arguments);
    EXPECT_EQ(finished.code, 0) << finished.output;
  };
  if (!testing_support::programExists("openssl")) GTEST_SKIP() << "no openssl";
  struct Case {
    std::vector<std::string> make;
    std::string algorithm;
  };
  for (const Case& c : {Case{{"-algorithm", "RSA", "-pkeyopt", "rsa_keygen_bits:2048"}, "RS256"},
                        Case{{"-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256"}, "ES256"},
                        Case{{"-algorithm", "RSA", "-pkeyopt", "rsa_keygen_bits:1024"}, "1024 bits, and at least 2048"},
                        Case{{"-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-384"}, "neither of RSA nor of the curve P-256"},
                        Case{{"-algorithm", "ED25519"}, "neither of RSA nor of the curve P-256"}}) {
    std::vector<std::string> make{"genpkey", "-out", folder + "private"};
    make.insert(make.end(), c.make.begin(), c.make.end());
    openssl(make);
    openssl({"pkey", "-in", folder + "private", "-pubout", "-out", folder + "public"});
    const auto keys = Key::readPublic(folder + "public");
    if (!c.algorithm.ends_with("256") || c.algorithm.size() > 5) {
      EXPECT_THAT(keys.error().message, testing::HasSubstr(c.algorithm));
      EXPECT_THAT(complaint(testing_support::readText(folder + "private")), testing::HasSubstr("no public key"));
      continue;
    }
    ASSERT_TRUE(keys) << keys.error().message;
    ASSERT_EQ(keys->size(), 1u);
    EXPECT_EQ(keys->front().algorithm(), c.algorithm);
    if (c.algorithm == "ES256") continue;  // openssl writes such signatures in another form
    std::ofstream(folder + "content") << "content";
    openssl({"dgst", "-sha256", "-sign", folder + "private", "-out", folder + "signature", folder + "content"});
    EXPECT_TRUE(keys->front().verifies("content", testing_support::readText(folder + "signature")));
    EXPECT_FALSE(keys->front().verifies("Content", testing_support::readText(folder + "signature")));
    const std::string both = testing_support::readText(folder + "public") + testing_support::readText(folder + "public");
    EXPECT_EQ(Key::readPublic(file(both))->size(), 2u);
  }
}

TEST_F(KeyFiles, SayWhatIsWrong) {
  EXPECT_THAT(Key::readPublic(folder_ / "none").error().message, testing::HasSubstr("Cannot read"));
  EXPECT_THAT(complaint(""), testing::HasSubstr("no public key"));
  EXPECT_THAT(complaint(std::string(70'000, 'x')), testing::HasSubstr("64 KiB"));
  EXPECT_THAT(complaint("{"), testing::HasSubstr("not a set of keys"));
  EXPECT_THAT(complaint(R"({"keys":[]})"), testing::HasSubstr("no key for RS256 or ES256"));
  EXPECT_THAT(complaint(R"({"keys":[{"kty":"RSA","n":"AQ","e":"AQAB"}]})"),
              testing::AnyOf(testing::HasSubstr("broken"), testing::HasSubstr("bits")));
  EXPECT_THAT(complaint(R"({"keys":[{"kty":"RSA","n":7,"e":"AQAB"}]})"), testing::HasSubstr("broken"));
  std::string offCurve = kCurveJwk;
  offCurve.replace(offCurve.find("f83O"), 4, "f83P");
  EXPECT_THAT(complaint(R"({"keys":[)" + offCurve + "]}"), testing::HasSubstr("broken"));
  for (std::size_t k = 0; k < kRsaJwk.size(); k += 5) EXPECT_NE(complaint(R"({"keys":[)" + kRsaJwk.substr(0, k)), "it was read");
  std::string many;
  for (int k = 0; k < 17; ++k) many += (k ? "," : "") + kCurveJwk;
  EXPECT_THAT(complaint(R"({"keys":[)" + many + "]}"), testing::HasSubstr("more than 16"));
}

TEST(Jwt, GrantsWhatItSays) {
  const auto grant = verifyJwt(signedToken(kHeader, kClaims), kSecret, kToday);
  ASSERT_TRUE(grant) << grant.error().message;
  EXPECT_EQ(grant->rights, Rights(Right::kView) | Right::kQuery);
  EXPECT_EQ(grant->session, "harbour");
  EXPECT_EQ(grant->name, "lab");
  EXPECT_TRUE(grant->reaches("harbour"));
  EXPECT_FALSE(grant->reaches("default"));
  const auto wide =
      verifyJwt(signedToken(kHeader, R"({"exp":1e300,"rights":"view,create,query,snapshot,clock,admin,edit","sub":"evil \n name"})"),
                kSecret, kToday);
  ASSERT_TRUE(wide) << wide.error().message;
  EXPECT_EQ(wide->rights, Rights::all());
  EXPECT_TRUE(wide->reaches("anything"));
  EXPECT_EQ(wide->name, "");
}

TEST(Jwt, IssuesWhatItVerifies) {
  Grant grant{"lab", Rights(Right::kSnapshot) | Right::kView, "a.b", kToday + std::chrono::hours(1)};
  const std::string token = issueJwt(grant, kSecret, kToday);
  const auto back = verifyJwt(token, kSecret, kToday);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->rights, grant.rights);
  EXPECT_EQ(back->session, grant.session);
  EXPECT_EQ(back->name, grant.name);
  EXPECT_EQ(back->expires, grant.expires);
  EXPECT_TRUE(verifyJwt(token, kSecret, kToday + std::chrono::seconds(3599)));
  EXPECT_FALSE(verifyJwt(token, kSecret, kToday + std::chrono::seconds(3600)));
}

TEST(Jwt, RefusesEveryDamage) {
  const std::string token = signedToken(kHeader, kClaims);
  ASSERT_TRUE(verifyJwt(token, kSecret, kToday));
  for (std::size_t k = 0; k < token.size(); ++k)
    for (const char c : {'A', 'b', '_', '.', '=', '\0', '\xff'}) {
      std::string damaged = token;
      damaged[k] = c;
      if (damaged == token) continue;
      EXPECT_FALSE(verifyJwt(damaged, kSecret, kToday)) << k;
    }
  for (std::size_t k = 0; k < token.size(); ++k) EXPECT_FALSE(verifyJwt(token.substr(0, k), kSecret, kToday));
  EXPECT_FALSE(verifyJwt(token + "A", kSecret, kToday));
  EXPECT_FALSE(verifyJwt(token + ".", kSecret, kToday));
  EXPECT_FALSE(verifyJwt(token, kSecret + "x", kToday));
}

TEST(Jwt, RefusesOtherWaysOfSigning) {
  const std::string unsignedToken = base64url(R"({"alg":"none","typ":"JWT"})") + "." + base64url(kClaims) + ".";
  EXPECT_FALSE(verifyJwt(unsignedToken, kSecret, kToday));
  // Even where the signature is right.
  for (const char* header :
       {R"({"alg":"none"})", R"({"alg":"None"})", R"({"alg":"HS512"})", R"({"alg":"hs256"})", R"({"alg":"RS256"})", R"({"alg":["HS256"]})",
        R"({"typ":"JWT"})", R"([])", R"("HS256")", "", "{", R"({"alg":"HS256","crit":["exp"]})"})
    EXPECT_FALSE(verifyJwt(signedToken(header, kClaims), kSecret, kToday)) << header;
}

TEST(Jwt, MustBeForThisServerAndByItsIssuer) {
  const auto judge = [](const std::string& claims, const JwtTerms& terms) {
    const auto grant = access::verifyJwt(signedToken(kHeader, R"({"exp":1800000060,"rights":"view")" + claims + "}"),
                                         std::vector{Key(kSecret)}, kToday, terms);
    return grant ? "" : grant.error().message;
  };
  const JwtTerms ours{.audience = "terrain"}, theirs{.issuer = "https://issuer.example"};
  EXPECT_EQ(judge(R"(,"aud":"terrain")", ours), "");
  EXPECT_EQ(judge(R"(,"aud":["mail","terrain"])", ours), "");
  for (const char* wrong : {"", R"(,"aud":"mail")", R"(,"aud":[])", R"(,"aud":"terrain ")", R"(,"aud":"Terrain")",
                            R"(,"aud":{"terrain":1})", R"(,"aud":[["terrain"]])", R"(,"aud":null)"})
    EXPECT_EQ(judge(wrong, ours), "The token is not for this server, whose audience is 'terrain'.") << wrong;
  EXPECT_EQ(judge(R"(,"iss":"https://issuer.example")", theirs), "");
  for (const char* wrong : {"", R"(,"iss":"https://issuer.example/")", R"(,"iss":["https://issuer.example"])", R"(,"iss":7)"})
    EXPECT_EQ(judge(wrong, theirs), "The token is of another issuer than 'https://issuer.example'.") << wrong;
  EXPECT_EQ(judge(R"(,"aud":"mail","iss":"anybody")", {}), "");
}

TEST(Jwt, ClocksMayDifferByTheLeeway) {
  using std::chrono::seconds;
  const std::string token = signedToken(kHeader, R"({"exp":1800000060,"nbf":1800000000,"rights":"view"})");
  const auto isGood = [&](int second, int leeway) {
    return access::verifyJwt(token, std::vector{Key(kSecret)}, kToday + seconds(second), {.leeway = seconds(leeway)}).has_value();
  };
  EXPECT_TRUE(isGood(0, 0) && isGood(59, 0));
  EXPECT_FALSE(isGood(-1, 0) || isGood(60, 0));
  EXPECT_TRUE(isGood(-30, 30) && isGood(89, 30));
  EXPECT_FALSE(isGood(-31, 30) || isGood(90, 30));
  EXPECT_EQ(access::verifyJwt(token, std::vector{Key(kSecret)}, kToday, {.leeway = seconds(30)})->expires, kToday + seconds(90));
}

TEST(Jwt, RightsMayStandInScopeAndRolesOfATokenForThisServer) {
  const auto judge = [](const std::string& claims, const std::string& audience = "terrain") {
    return access::verifyJwt(signedToken(kHeader, R"({"exp":1800000060,"aud":"terrain",)" + claims + "}"), std::vector{Key(kSecret)},
                             kToday, {.audience = audience});
  };
  EXPECT_EQ(judge(R"("scope":"openid view  query")")->rights, Rights(Right::kView) | Right::kQuery);
  EXPECT_EQ(judge(R"("scope":"openid view query")")->unknown, std::vector<std::string>{"openid"});
  EXPECT_EQ(judge(R"("roles":["view","clock"])")->rights, Rights(Right::kView) | Right::kClock);
  EXPECT_EQ(judge(R"("roles":"edit","scope":"view")")->rights, Rights(Right::kView) | Right::kEdit);
  EXPECT_EQ(judge(R"("rights":"view","roles":["admin"],"scope":"edit")")->rights, Rights(Right::kView)) << "rights say it all";
  EXPECT_EQ(judge(R"("rights":["view","fly\n"])")->rights, Rights(Right::kView));
  EXPECT_EQ(judge(R"("rights":["view","fly"])")->unknown, std::vector<std::string>{"fly"});
  EXPECT_EQ(judge(R"("scope":"openid profile")").error().message, "The token names no rights that are known here.");
  EXPECT_FALSE(judge(R"("scope":["view"],"roles":[1])"));
  EXPECT_FALSE(judge(R"("roles":{"view":true})"));
  // Who names no audience takes tokens that are meant for others: their roles are not the ones here.
  EXPECT_EQ(judge(R"("roles":["admin"],"scope":"view")", "").error().message, "The token names no rights.");
  std::string many;
  for (int k = 0; k < 200; ++k) many += "x" + std::to_string(k) + " ";
  EXPECT_EQ(judge(R"("scope":")" + many + "view\"")->unknown.size(), JwtGrant::kMaxUnknown);
}

TEST(Jwt, RefusesClaimsThatAreNone) {
  const std::string deep(3000, '[');
  for (const std::string claims :
       {"", "[]", "null", "{", R"({"rights":["view"]})", R"({"exp":"1800000060","rights":["view"]})",
        R"({"exp":1800000000,"rights":["view"]})", R"({"exp":-1,"rights":["view"]})", R"({"exp":null,"rights":["view"]})",
        R"({"exp":1800000060})", R"({"exp":1800000060,"rights":[]})", R"({"exp":1800000060,"rights":"owner"})",
        R"({"exp":1800000060,"rights":["view",1]})", R"({"exp":1800000060,"rights":{"view":true}})",
        R"({"exp":1800000060,"rights":["view"],"nbf":1800000001})", R"({"exp":1800000060,"rights":["view"],"nbf":"x"})",
        R"({"exp":1800000060,"rights":["view"],"session":"a/b"})", R"({"exp":1800000060,"rights":["view"],"session":7})",
        R"({"exp":1800000060,"rights":["view"],"session":""})"})
    EXPECT_FALSE(verifyJwt(signedToken(kHeader, claims), kSecret, kToday)) << claims;
  EXPECT_FALSE(verifyJwt(signedToken(kHeader, deep), kSecret, kToday));
  EXPECT_FALSE(verifyJwt(signedToken(kHeader, std::string(kMaxTokenBytes, 'x')), kSecret, kToday));
}

}  // namespace
}  // namespace ridgecast::access
