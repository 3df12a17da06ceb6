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

TEST(Logging, RefusalsOfAClientAreMergedByReasonAndCounted) {
  Repeats repeats;
  const auto from = [](std::string_view peer, std::string_view reason = "session", std::string_view session = {}) {
    return About{.session = session, .peer = peer, .event = "refused", .reason = reason};
  };
  // The same once, whatever the port; of different ones kMaxRefused.
  EXPECT_TRUE(repeats.take(from("192.0.2.1:5004"), "no", 0));
  for (int k = 1; k <= 100; ++k) EXPECT_FALSE(repeats.take(from("192.0.2.1:" + std::to_string(k)), "no", k));
  std::size_t written = 1;
  for (int k = 0; k < 5000; ++k) written += repeats.take(from("192.0.2.1:1", "session", std::to_string(k)), "no", 200);
  for (int k = 0; k < 5000; ++k) written += repeats.take(from("192.0.2.1:1"), std::to_string(k), 300);
  EXPECT_EQ(written, Repeats::kMaxRefused);
  // Others are heard meanwhile.
  EXPECT_TRUE(repeats.take(from("192.0.2.2:5004"), "no", 1000));
  EXPECT_TRUE(repeats.take(from("[2001:db8::1]:5004"), "no", 1000));
  EXPECT_FALSE(repeats.take(from("[2001:db8::1]:5005"), "no", 1000));
  EXPECT_TRUE(repeats.take(from("2001:db8::1"), "no", 1000));  // behind a proxy: without a port
  EXPECT_TRUE(repeats.take(from("2001:db8::2"), "no", 1000));
  EXPECT_TRUE(repeats.take(from("192.0.2.1:5004", "token"), "no", 1000));
  // When the minute is over, each client is told of with what was left out, once.
  EXPECT_TRUE(repeats.leftOut(Repeats::kEvery - 1).empty());
  const auto said = repeats.leftOut(Repeats::kEvery);
  ASSERT_EQ(said.size(), 1u);  // the others' minute goes on
  EXPECT_EQ(said[0].client, "192.0.2.1");
  EXPECT_EQ(said[0].reason, "session");
  EXPECT_EQ(said[0].lines, 100 + 10'000 - (Repeats::kMaxRefused - 1));
  const auto rest = repeats.leftOut(Repeats::kEvery, true);
  ASSERT_EQ(rest.size(), 1u);
  EXPECT_EQ(rest[0].client, "[2001:db8::1]");
  EXPECT_EQ(rest[0].lines, 1u);
  EXPECT_TRUE(repeats.leftOut(3 * Repeats::kEvery, true).empty());
  EXPECT_TRUE(repeats.take(from("192.0.2.1:5004"), "no", 3 * Repeats::kEvery));  // again
}

TEST(Logging, WhatClientsDoAtWillIsBoundedForAllOfThem) {
  Repeats repeats;
  constexpr int kClients = 2000, kEach = 400;
  std::size_t written = 0;
  std::uint64_t counted = 0;
  for (int client = 0; client < kClients; ++client) {
    const std::string peer = "10.0." + std::to_string(client / 256) + "." + std::to_string(client % 256) + ":80";
    for (int k = 0; k < kEach; ++k) written += repeats.take({.peer = peer, .event = "hello"}, "says hello", k);
  }
  EXPECT_EQ(written, (Repeats::kMaxKinds + 1) * Repeats::kMaxOthers);  // those beyond share a kind
  for (const auto& left : repeats.leftOut(2 * Repeats::kEvery)) counted += left.lines;
  EXPECT_EQ(written + counted, std::uint64_t{kClients} * kEach);
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
