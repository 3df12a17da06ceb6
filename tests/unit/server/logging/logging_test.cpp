#include "server/logging/logging.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

namespace ridgecast::logging {
namespace {

using nlohmann::json;

constexpr std::int64_t kTime = 1'795'264'201'123;

TEST(Logging, SaysWhatItIsAbout) {
  const About about{"default", 3, "192.0.2.1:5004", "lab"};
  const std::string text = line(Format::kText, Level::kInfo, about, "says hello", kTime);
  EXPECT_EQ(text, "12:30:01 info session=default camera=3 peer=192.0.2.1:5004 holder=lab says hello");
  const json object = json::parse(line(Format::kJson, Level::kWarning, about, "says hello", kTime));
  EXPECT_EQ(object, json({{"time", "2026-11-21T12:30:01.123Z"},
                          {"level", "warning"},
                          {"message", "says hello"},
                          {"session", "default"},
                          {"camera", 3},
                          {"peer", "192.0.2.1:5004"},
                          {"holder", "lab"}}));
  EXPECT_EQ(line(Format::kText, Level::kError, {}, "x", kTime), "12:30:01 error x");
}

TEST(Logging, ALineIsOneLineAndJsonParses) {
  const std::string hostile[] = {"\n{\"level\":\"error\"}",
                                 "\"}",
                                 "\\",
                                 "\\\"",
                                 std::string("a\0b", 3),
                                 "\xff\xfe",
                                 "\xc0\xaf",
                                 "\xed\xa0\x80",
                                 "\xf4\x90\x80\x80",
                                 "\xe2\x80\xa8",
                                 "\xc2\x85",
                                 "\x1b[2J",
                                 "\x7f",
                                 "\xc3\xa4\xe6\xbc\xa2\xf0\x9f\x8f\x94",
                                 "\xe6\xbc",
                                 "\r\n"};
  for (const std::string& s : hostile) {
    const json object = json::parse(line(Format::kJson, Level::kInfo, {s, 1, s, s}, s, kTime));
    EXPECT_EQ(object["session"], object["message"]);
    const std::string text = line(Format::kText, Level::kInfo, {s, 1, s, s}, s, kTime);
    for (const char c : text) EXPECT_FALSE(static_cast<unsigned char>(c) < 0x20 || c == 0x7f) << text;
  }
  EXPECT_EQ(json::parse(line(Format::kJson, Level::kInfo, {}, "\"\\\n\x01", kTime))["message"], "\"\\\n\x01");
  EXPECT_EQ(json::parse(line(Format::kJson, Level::kInfo, {}, "\xc3\xa4\xff", kTime))["message"], "\xc3\xa4\xef\xbf\xbd");
}

TEST(Logging, AnyBytesParse) {
  std::mt19937 random(7);
  for (int k = 0; k < 20'000; ++k) {
    std::string bytes(random() % 12, '\0');
    for (char& c : bytes) c = static_cast<char>(random() % 3 ? random() % 256 : 0xe0 + random() % 32);
    const std::string text = line(Format::kJson, Level::kInfo, {bytes}, bytes, kTime);
    ASSERT_FALSE(json::parse(text, nullptr, false).is_discarded()) << text;
    ASSERT_EQ(text.find('\n'), std::string::npos);
  }
}

}  // namespace
}  // namespace ridgecast::logging
