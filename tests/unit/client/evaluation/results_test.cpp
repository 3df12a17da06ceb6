#include "client/evaluation/results.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "client/evaluation/text_file.h"

namespace ridgecast::evaluation {
namespace {

class Results : public testing::Test {
 protected:
  void SetUp() override {
    run_.folder = std::filesystem::temp_directory_path() / ("ridgecast-results-" + std::to_string(getpid()));
    std::filesystem::create_directories(run_.folder);
  }
  void TearDown() override { std::filesystem::remove_all(run_.folder); }
  evaluation::Run run_;
};

TEST_F(Results, WhatWasWrittenIsRead) {
  FlightSummary summary;
  summary.frames = {2, 0.5, {0.5, 0.75}, {1, 2.5}, {"0001", "0002"}};
  summary.settled = {0.9, 0.8, 0.7, 0.6};
  summary.isSettled = true;
  summary.popping = {0.2, 0.1, {{"off", {0, 0.2}}, {"on", {0.1}}}};
  summary.settings.server = "a \"server\"";
  IterationResult one;
  one.number = 7;
  one.figures.visibleLeaves = 3;
  one.uploadMs = 1.5;
  ASSERT_TRUE(writeText(run_.folder / "summary.json", asJson(summary)));
  ASSERT_TRUE(writeText(run_.folder / "iterations.jsonl", asJson(one) + "torn"));
  ASSERT_TRUE(writeText(run_.folder / "machine.json", "{\"others\": 0.25}"));
  const auto read = readResults(run_);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(asJson(read->summary), asJson(summary));
  EXPECT_EQ(read->summary.frames.names, summary.frames.names);
  EXPECT_EQ(read->summary.popping.frames, summary.popping.frames);
  ASSERT_EQ(read->iterations.size(), 1u);
  EXPECT_EQ(asJson(read->iterations[0]), asJson(one));
  EXPECT_EQ(read->iterations[0].uploadMs, 1.5);
  EXPECT_EQ(read->others, 0.25);
}

TEST_F(Results, WhatWasNotMeasuredIsNullOrMissing) {
  const auto json = nlohmann::json::parse(asJson(FlightSummary()));
  EXPECT_TRUE(json.at("ssim_settled").is_null());
  EXPECT_TRUE(json.at("ssim_frames").empty());
  for (const char* key : {"ssim_mean_corrected", "corrected_frame_ms", "popping_off", "popping_frames"})
    EXPECT_FALSE(json.contains(key)) << key;
  EXPECT_FALSE(nlohmann::json::parse(asJson(IterationResult())).contains("upload_ms"));
}

TEST_F(Results, NumbersOfEverySummaryHaveTheSameKeys) {
  FlightSummary other;
  other.popping.off = 1;
  const auto a = numbersOf({}), b = numbersOf(other);
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.size(), 30u);
  for (std::size_t k = 0; k < a.size(); ++k) EXPECT_EQ(a[k].first, b[k].first);
}

TEST_F(Results, SaysWhichFileIsBroken) {
  ASSERT_TRUE(writeText(run_.folder / "summary.json", "{"));
  EXPECT_NE(readResults(run_).error().message.find("summary.json is broken"), std::string::npos);
  EXPECT_NE(writeText(run_.folder / "no" / "file", "").error().message.find("cannot write"), std::string::npos);
}

}  // namespace
}  // namespace ridgecast::evaluation
