#include "server/access/host.h"

#include <gtest/gtest.h>

namespace ridgecast::access {
namespace {

TEST(Host, IsAskedUnderNamesThatNobodyElseCanPointHere) {
  struct Case {
    const char* header;
    bool may;
    const char* listening = "127.0.0.1";
    std::vector<std::string> allowed = {};
  };
  const std::vector<std::string> names{"terrain.example.org", "server-a", "2001:db8::7"};
  for (const Case& c : std::vector<Case>{{"", true},
                                         {"localhost", true},
                                         {"localhost:7070", true},
                                         {"LocalHost:7070", true},
                                         {"localhost.:7070", true},
                                         {"terrain.localhost:7070", true},
                                         {"127.0.0.1", true},
                                         {"127.0.0.1:7070", true},
                                         {"127.1.2.3:7070", true},
                                         {"[::1]:7070", true},
                                         {"[::1]", true},
                                         {"192.0.2.7:7070", true},  // an address is looked up nowhere
                                         {"[2001:db8::1]:7070", true},
                                         {"evil.example", false},
                                         {"evil.example:7070", false},
                                         {"x", false},
                                         {".localhost", false},
                                         {"evillocalhost:7070", false},
                                         {"localhost.evil.example", false},
                                         {"127.0.0.1.evil.example:7070", false},
                                         {"evil.example@127.0.0.1", false},
                                         {"evil.example:7070@127.0.0.1", false},
                                         {"127.0.0.1@evil.example", false},
                                         {"127.0.0.1:7070:evil.example", false},
                                         {"127.0.0.1 evil.example", false},
                                         {"localhost, evil.example", false},
                                         {"[::1", false},
                                         {"[::1]evil.example", false},
                                         {"[evil.example]:7070", false},
                                         {":7070", false},
                                         {".", false},
                                         {"2130706433", false},  // browsers write it as 127.0.0.1
                                         {"terrain.example.org", false},
                                         {"terrain.example.org", true, "127.0.0.1", names},
                                         {"Terrain.Example.org:7070", true, "127.0.0.1", names},
                                         {"terrain.example.org.:7070", true, "127.0.0.1", names},
                                         {"server-a:7070", true, "0.0.0.0", names},
                                         {"server-b:7070", false, "0.0.0.0", names},
                                         {"x.terrain.example.org", false, "0.0.0.0", names},
                                         {"example.org", false, "0.0.0.0", names},
                                         {"workshop:7070", true, "workshop"},
                                         {"WORKSHOP", true, "workshop"},
                                         {"workshop.evil.example", false, "workshop"},
                                         {"evil.example:7070", true, "127.0.0.1", {"*"}}})
    EXPECT_EQ(answersTo(c.header, c.listening, c.allowed), c.may) << "'" << c.header << "' at " << c.listening;
}

TEST(Host, TakesNamesAndSaysWhatIsNone) {
  for (const char* text : {"*", "terrain.example.org", "server-a", "under_score", "192.0.2.7", "2001:db8::7", "[2001:db8::7]"}) {
    const auto name = parseHostName(text);
    ASSERT_TRUE(name) << text;
    EXPECT_EQ(*name, text);
  }
  EXPECT_EQ(parseHostName("terrain.example.org.").value(), "terrain.example.org");
  for (const std::string& text :
       {std::string(), std::string("."), std::string(".org"), std::string("a..b"), std::string("host:7070"), std::string("127.0.0.1:7070"),
        std::string("[::1]:7070"), std::string("https://host"), std::string("host/path"), std::string("*.example.org"), std::string("a b"),
        std::string("a,b"), std::string("a\0b", 3), std::string(300, 'a')}) {
    const auto name = parseHostName(text);
    ASSERT_FALSE(name) << text;
    EXPECT_NE(name.error().message.find("--allowed-host"), std::string::npos);
  }
}

}  // namespace
}  // namespace ridgecast::access
