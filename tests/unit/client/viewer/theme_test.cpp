// The window has the page's colours.
#include "client/viewer/theme.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <string>

#include "tests/support/process.h"

namespace ridgecast::viewer::theme {
namespace {

std::string asHex(const Shade& shade) {
  char text[16];
  std::snprintf(text, sizeof text, "#%06x", shade.rgb);
  return text;
}

TEST(Theme, HasThePagesColours) {
  const std::string css = testing_support::readText(RIDGECAST_SOURCE "/client/web/src/style.css");
  for (const auto& [expected, what] :
       std::initializer_list<std::pair<std::string, const char*>>{{"--ground: " + asHex(kGround), "ground"},
                                                                  {"--field: " + asHex(kField), "fields"},
                                                                  {"--accent: " + asHex(kAccent), "accent"},
                                                                  {"background: var(--ground); color: " + asHex(kText), "text"},
                                                                  {"dialog dt { color: " + asHex(kMuted), "muted text"},
                                                                  {"border-radius: .9rem; background: " + asHex(kDialog), "dialogs"},
                                                                  {"background: #d9a441", "warnings"}})
    EXPECT_NE(css.find(expected), std::string::npos) << what << ": " << expected;
  EXPECT_NE(css.find("--glass: rgba(13, 19, 26, .78)"), std::string::npos);
  EXPECT_EQ(kGlass.rgb, 13u << 16 | 19 << 8 | 26);
  EXPECT_NEAR(kGlass.alpha, .78f, 1e-6f);
  EXPECT_NE(css.find("--edge: rgba(255, 255, 255, .16)"), std::string::npos);
  EXPECT_NEAR(kEdge.alpha, .16f, 1e-6f);
  EXPECT_EQ(kWarning.rgb, 0xd9a441u);
}

TEST(Theme, PacksBytesAsRedGreenBlueAlpha) {
  EXPECT_EQ(packed({0x112233}), 0xff332211u);
  EXPECT_EQ(packed({0x112233, 0.5f}, 0.5f), 0x40332211u);
}

}  // namespace
}  // namespace ridgecast::viewer::theme
