#include "client/evaluation/results.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ridgecast::evaluation {
namespace {

TEST(Results, WhatWasNotMeasuredIsNullOrMissing) {
  const auto json = nlohmann::json::parse(asJson(FlightSummary()));
  EXPECT_TRUE(json.at("ssim_settled").is_null());
  EXPECT_TRUE(json.at("ssim_frames").empty());
  for (const char* key : {"ssim_mean_corrected", "corrected_frame_ms", "popping_off", "popping_frames"})
    EXPECT_FALSE(json.contains(key)) << key;
  EXPECT_FALSE(nlohmann::json::parse(asJson(IterationResult())).contains("upload_ms"));
}

}  // namespace
}  // namespace ridgecast::evaluation
