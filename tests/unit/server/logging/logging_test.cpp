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

TEST(Logging, MachinesHaveFieldsForWhatHappened) {
  const About refused{.session = "race",
                      .peer = "192.0.2.1:5004",
                      .holder = "lab",
                      .event = "refused",
                      .reason = "right",
                      .path = "/v1/rays",
                      .status = 403,
                      .repeated = 7};
  EXPECT_EQ(line(Format::kText, Level::kInfo, refused, "is refused", kTime),
            "12:30:01 info session=race peer=192.0.2.1:5004 holder=lab repeated=7 is refused");
  const json object = json::parse(line(Format::kJson, Level::kInfo, refused, "is refused", kTime));
  EXPECT_EQ(object["event"], "refused");
  EXPECT_EQ(object["reason"], "right");
  EXPECT_EQ(object["path"], "/v1/rays");
  EXPECT_EQ(object["status"], 403);
  EXPECT_EQ(object["repeated"], 7);
  const json ended = json::parse(
      line(Format::kJson, Level::kInfo, {.event = "ended", .reason = "left", .stay = About::Stay{12.5, 3000, 140}}, "is gone", kTime));
  EXPECT_EQ(ended["seconds"], 12.5);
  EXPECT_EQ(ended["bytes"], 3000);
  EXPECT_EQ(ended["iterations"], 140);
}

TEST(Logging, WhatRepeatsIsWrittenOnceAMinuteAndCounted) {
  Repeats repeats;
  const auto from = [](std::string_view peer) { return About{.peer = peer, .reason = "token"}; };
  EXPECT_EQ(repeats.take(from("192.0.2.1:5004"), "no", 0), 0u);
  for (int k = 1; k <= 100; ++k) EXPECT_EQ(repeats.take(from("192.0.2.1:" + std::to_string(k)), "no", k * 500), std::nullopt);
  EXPECT_EQ(repeats.take(from("192.0.2.2:5004"), "no", 1000), 0u);   // another client
  EXPECT_EQ(repeats.take(from("192.0.2.1:5004"), "why", 1000), 0u);  // another refusal
  EXPECT_EQ(repeats.take(from("192.0.2.1:5004"), "no", Repeats::kEvery), 100u);
  EXPECT_EQ(repeats.take(from("192.0.2.1:5004"), "no", Repeats::kEvery + 1), std::nullopt);
  // Whoever varies his requests shares one line with all others that do, until the minute is over.
  int written = 0;
  for (int k = 0; k < 5000; ++k) written += repeats.take(from("192.0.2.3:1"), std::to_string(k), Repeats::kEvery + 2).has_value();
  EXPECT_LE(written, static_cast<int>(Repeats::kMaxKinds));
  EXPECT_EQ(repeats.take(from("192.0.2.4:1"), "no", 3 * Repeats::kEvery), 0u);
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
