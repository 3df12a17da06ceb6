#include "common/text/text.h"
#include "common/text/file.h"

#include <gtest/gtest.h>

#include <fstream>

namespace ridgecast::text {
namespace {

TEST(Text, TakesListsApart) {
  std::string_view rest = " a,,b ";
  EXPECT_EQ(trimmed(takePart(rest, ',')), "a");
  EXPECT_EQ(takePart(rest, ','), "");
  EXPECT_EQ(trimmed(takePart(rest, ',')), "b");
  EXPECT_TRUE(rest.empty());
  EXPECT_EQ(trimmed(" \t\r "), "");
}

TEST(Text, KnowsLettersAndDigits) {
  EXPECT_TRUE(hasOnly("aZ09-", "-"));
  EXPECT_FALSE(hasOnly("aZ09-", "_"));
  EXPECT_FALSE(hasOnly("\xc3\xa9", ""));
}

TEST(Text, ANumberIsTheWholeTextAndFinite) {
  EXPECT_EQ(number<double>("-1.5e3"), -1500);
  EXPECT_EQ(number<std::uint32_t>("4294967295"), 4294967295u);
  for (const char* wrong : {"", " 1", "1 ", "1x", "+1", "nan", "inf", "1e999"}) EXPECT_FALSE(number<double>(wrong)) << wrong;
  for (const char* wrong : {"-1", "4294967296", "1.0"}) EXPECT_FALSE(number<std::uint32_t>(wrong)) << wrong;
}

TEST(Text, WritesNumbers) {
  EXPECT_EQ(rounded(0.1, 17), "0.10000000000000001");
  EXPECT_EQ(rounded(1234.5, 3), "1.23e+03");
  EXPECT_EQ(hexadecimal(0xabc), "0000000000000abc");
}

TEST(Text, DecodesUrls) {
  EXPECT_EQ(percentDecoded("a%20b%2F+"), "a b/+");
  for (const char* wrong : {"%", "%4", "%4g", "% 4", "%-1", "a%"}) EXPECT_FALSE(percentDecoded(wrong)) << wrong;
}

TEST(Text, ReadsAFileUpToItsLimit) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "text_test";
  std::ofstream(file) << "12345";
  EXPECT_EQ(readFile(file, 5), "12345");
  EXPECT_EQ(readFile(file, 3), "1234");
  std::filesystem::remove(file);
  EXPECT_FALSE(readFile(file, 5));
  EXPECT_FALSE(readFile(testing::TempDir(), 5)) << "a folder";
}

TEST(Text, TellsNoFolders) {
  EXPECT_EQ(withoutFolders("/srv/terrains/a.glsl:3:5: it is wrong"), "a.glsl:3:5: it is wrong");
  EXPECT_EQ(withoutFolders("there is no file '/srv/my.dem/b.tif'"), "there is no file 'b.tif'");
  EXPECT_EQ(withoutFolders("cannot store in /root/.cache/x; give --terrain-cache=/tmp/y"), "cannot store in x; give --terrain-cache=y");
  for (const char* same : {"", "/", "a / b", "1/2 of a/b.tif", "// a comment", "https://example.org/a", "x //"})
    EXPECT_EQ(withoutFolders(same), same);
}

}  // namespace
}  // namespace ridgecast::text
