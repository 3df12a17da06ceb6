#include "server/access/tokens.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "server/access/jwt.h"
#include "tests/support/process.h"

namespace ridgecast::access {
namespace {

using testing::HasSubstr;
const Time kNow{std::chrono::seconds(1'800'000'000)};

class TokensTest : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& text) {
    std::filesystem::path path = folder / ("file" + std::to_string(++files));
    std::ofstream(path) << text;
    return path;
  }
  std::string complaint(const std::string& text) {
    const auto tokens = Tokens::load({.tokens = file(text)});
    return tokens ? "" : tokens.error().message;
  }
  testing_support::ScratchFolder folder;
  int files = 0;
};

TEST_F(TokensTest, TellsWhatAnotherFileLacksAndGoesOnWithoutIt) {
  const NewToken lab = makeToken({"lab", Right::kView, "", {}}), guest = makeToken({"guest", Right::kView, "", {}});
  const auto before = Tokens::load({.tokens = file(lab.line + "\n" + guest.line)}).value(),
             after = Tokens::load({.tokens = file(guest.line)}).value();
  EXPECT_TRUE(before->missingFrom(*before).empty());
  EXPECT_TRUE(after->missingFrom(*before).empty());
  const auto lost = before->missingFrom(*after);
  ASSERT_EQ(lost.size(), 1u);
  EXPECT_EQ(before->holderOf(lost[0]), "lab");
  EXPECT_EQ(after->holderOf(lost[0]), std::nullopt);
  EXPECT_THAT(lab.line, testing::EndsWith(lost[0]));
  const auto fewer = before->without(lost);
  EXPECT_EQ(fewer->judge(lab.token, kNow).error().message, "The token is not known here.");
  EXPECT_TRUE(fewer->judge(guest.token, kNow));
  EXPECT_EQ(after->without(lost)->count(), 1u);
}

TEST_F(TokensTest, GrantsWhatTheFileSays) {
  const NewToken lab = makeToken({"lab", Rights(Right::kView) | Right::kQuery, "", {}});
  const NewToken guest = makeToken({"guest", Right::kView, "harbour", kNow + std::chrono::seconds(10)});
  EXPECT_NE(lab.token, guest.token);
  EXPECT_THAT(lab.line, testing::Not(HasSubstr(lab.token)));
  const auto tokens = Tokens::load({.tokens = file("# who may\n\n" + lab.line + "\n  " + guest.line + "\r\n")});
  ASSERT_TRUE(tokens) << tokens.error().message;
  EXPECT_EQ((*tokens)->count(), 2u);
  const auto a = (*tokens)->judge(lab.token, kNow), b = (*tokens)->judge(guest.token, kNow);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->rights, Rights(Right::kView) | Right::kQuery);
  EXPECT_TRUE(a->reaches("anything"));
  EXPECT_EQ(b->name, "guest");
  EXPECT_FALSE(b->reaches("default"));
  EXPECT_EQ((*tokens)->judge(guest.token, kNow + std::chrono::seconds(10)).error().message, "The token has expired.");
  for (const std::string& wrong :
       {std::string(), lab.token.substr(1), lab.token + "x", lab.line, std::string(5000, 'a'), std::string("a.b.c")})
    EXPECT_FALSE((*tokens)->judge(wrong, kNow)) << wrong;
}

TEST_F(TokensTest, TakesJsonWebTokensBesideTheFile) {
  const std::string secret = "0123456789abcdef0123456789abcdef";
  const NewToken lab = makeToken({"lab", Right::kView, "", {}});
  const auto tokens = Tokens::load({.tokens = file(lab.line), .secrets = {file(secret + "\n")}});
  ASSERT_TRUE(tokens) << tokens.error().message;
  EXPECT_TRUE((*tokens)->judge(lab.token, kNow));
  EXPECT_TRUE((*tokens)->judge(issueJwt({"x", Right::kView, "", kNow + std::chrono::hours(1)}, secret, kNow), kNow));
  EXPECT_FALSE((*tokens)->judge(issueJwt({"x", Right::kView, "", kNow + std::chrono::hours(1)}, secret + "\n", kNow), kNow));
}

// So that a secret can be replaced while tokens of the old one are about.
TEST_F(TokensTest, SeveralSecretsAreValidAtATime) {
  const std::string before(32, 'b'), after(32, 'a');
  const auto tokens = Tokens::load({.secrets = {file(after), file(before)}});
  ASSERT_TRUE(tokens) << tokens.error().message;
  const auto good = [&](const std::string& secret) {
    return (*tokens)->judge(issueJwt({"x", Right::kView, "", kNow + std::chrono::hours(1)}, secret, kNow), kNow).has_value();
  };
  EXPECT_TRUE(good(before));
  EXPECT_TRUE(good(after));
  EXPECT_FALSE(good(std::string(32, 'c')));
  EXPECT_THAT(Tokens::load({.secrets = std::vector<std::filesystem::path>(17, file(after))}).error().message, HasSubstr("more than 16"));
}

TEST_F(TokensTest, SaysWhatIsWrong) {
  const std::string hash = " sha256:" + std::string(64, 'a');
  EXPECT_EQ(complaint("lab view * never" + hash), "");
  EXPECT_THAT(complaint("lab view * never" + hash + "\n\nlab view *"), HasSubstr("Line 3"));
  EXPECT_THAT(complaint("lab view *"), HasSubstr("3 words instead of 5"));
  EXPECT_THAT(complaint("lab see * never" + hash), HasSubstr("'see' is not a right"));
  EXPECT_THAT(complaint("lab view, * never" + hash), HasSubstr("is not a right"));
  EXPECT_THAT(complaint("lab view a/b never" + hash), HasSubstr("session"));
  EXPECT_THAT(complaint("lab view * tomorrow" + hash), HasSubstr("2027-01-01T00:00:00Z"));
  EXPECT_THAT(complaint("lab view * 2027-02-30T00:00:00Z" + hash), HasSubstr("2027-01-01T00:00:00Z"));
  EXPECT_THAT(complaint("lab view * never secret"), HasSubstr("sha256:"));
  EXPECT_THAT(complaint("l\"b view * never" + hash), HasSubstr("holder"));
  EXPECT_THAT(complaint(std::string(2000, 'x')), HasSubstr("1024 bytes"));
  EXPECT_THAT(Tokens::load({.tokens = folder / "none"}).error().message, HasSubstr("Cannot read"));
  EXPECT_THAT(Tokens::load({.secrets = {folder / "none"}}).error().message, HasSubstr("Cannot read"));
  EXPECT_THAT(Tokens::load({.secrets = {file("short\n")}}).error().message, HasSubstr("32"));
  EXPECT_THAT(Tokens::load({.secrets = {file(std::string(5000, 'x'))}}).error().message, HasSubstr("4096"));
}

TEST_F(TokensTest, TimesComeBack) {
  for (const long long seconds : {0ll, 951'782'400ll, 1'800'000'000ll, 4'102'444'799ll}) {
    const Time time{std::chrono::seconds(seconds)};
    EXPECT_EQ(parseTime(toText(time)), time);
  }
  EXPECT_EQ(toText(Time(std::chrono::seconds(951'782'400))), "2000-02-29T00:00:00Z");
  for (const char* wrong :
       {"", "2027-01-01", "2027-01-01T24:00:00Z", "2027-01-01T00:00:00", "2027-13-01T00:00:00Z", "x027-01-01T00:00:00Z"})
    EXPECT_FALSE(parseTime(wrong)) << wrong;
}

}  // namespace
}  // namespace ridgecast::access
