#include <gtest/gtest.h>

#include "client/core/conversation/url.h"

namespace ridgecast::core {
namespace {

TEST(Url, Table) {
  struct Case {
    const char *text, *host, *port, *session;
  };
  for (const Case& c : std::initializer_list<Case>{
           {"", "127.0.0.1", "7070", "default"},
           {"localhost", "localhost", "7070", "default"},
           {"localhost:1", "localhost", "1", "default"},
           {"10.0.0.7:65535", "10.0.0.7", "65535", "default"},
           {"ws://10.0.0.7:7071", "10.0.0.7", "7071", "default"},
           {"http://terrain.example.org", "terrain.example.org", "80", "default"},
           {"WS://Example.org:90/", "Example.org", "90", "default"},
           {"ws://h:7070/v1/stream?session=race-1", "h", "7070", "race-1"},
           {"h?session=a.b_c", "h", "7070", "a.b_c"},
           {"h:8080?x=1&session=s&session", "h", "8080", "s"},
           {"h:8080/?token=abc", "h", "8080", "default"},
           {"h:8080/?session=s#there", "h", "8080", "s"},
           {"[::1]", "::1", "7070", "default"},
           {"[::1]:99?session=six", "::1", "99", "six"},
           {"http://[fe80::1]/", "fe80::1", "80", "default"},
       }) {
    const auto url = parseUrl(c.text);
    ASSERT_TRUE(url) << c.text << ": " << url.error().message;
    EXPECT_EQ(url->host, c.host) << c.text;
    EXPECT_EQ(url->port, c.port) << c.text;
    EXPECT_EQ(url->session, c.session) << c.text;
  }
}

TEST(Url, KeepsWhatItSaysAboutTheWorld) {
  EXPECT_EQ(parseUrl("h?session=s&terrain=canyon&token=x&seed=7&param=depth=3.5&clock=stepped")->world,
            "terrain=canyon&seed=7&param=depth=3.5&clock=stepped");
  EXPECT_EQ(parseUrl("h?session=s")->world, "");
  EXPECT_FALSE(parseUrl("h?terrain=a b"));
  EXPECT_FALSE(parseUrl("h?clock=a b"));
  EXPECT_FALSE(parseUrl("h?terrain=a\r\nX-Header:"));
}

TEST(Url, SaysWhatIsWrong) {
  for (auto [text, why] : std::initializer_list<std::pair<const char*, const char*>>{
           {"ftp://h", "scheme"},
           {"h:0", "port"},
           {"h:65536", "port"},
           {"h:", "port"},
           {"h:7070x", "port"},
           {"h:-1", "port"},
           {":7070", "host"},
           {"ws://", "host"},
           {"h h:7070", "host"},
           {"a/b@c", nullptr},
           {"user@h:7070", "user"},
           {"[::1", "]"},
           {"[::1]7", "port"},
           {"[::1]:0", "port"},
           {"[h]", "host"},
           {"::1", "port"},
           {"h?session=", "session"},
           {"h?session=a/b", "session"},
           {"h?session=a%20b", "session"},
           {"ws://h:1/?session=\n", "session"},
       }) {
    const auto url = parseUrl(text);
    if (why == nullptr) {
      EXPECT_TRUE(url) << text;
      continue;
    }
    ASSERT_FALSE(url) << text;
    EXPECT_NE(url.error().message.find(why), std::string::npos) << url.error().message;
  }
  EXPECT_FALSE(parseUrl(std::string(5000, 'h')));
  EXPECT_FALSE(parseUrl("h?session=" + std::string(65, 's')));
}

}  // namespace
}  // namespace ridgecast::core
