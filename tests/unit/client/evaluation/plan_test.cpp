// What an evaluation measures: that nothing the report speaks of is left out, and nothing is measured twice.
#include "client/evaluation/plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <tuple>

namespace ridgecast::evaluation {
namespace {

using Pictured = std::map<std::string, std::map<std::string, std::set<double>>>;  // terrain -> metric -> thresholds

Pictured picturedOf(const Plan& plan) {
  Pictured out;
  for (const PlannedFlight& f : plan.flights)
    if (f.pictures) out[f.run.terrain][f.run.metric].insert(f.run.threshold);
  return out;
}

TEST(Plan, AllTerrainsBothMetricsAndSeveralThresholds) {
  const auto pictured = picturedOf(planOf({}, 4));
  ASSERT_EQ(pictured.size(), 3u);
  for (const auto& [terrain, metrics] : pictured) {
    EXPECT_GE(metrics.at("pixels").size(), 3u) << terrain;
    EXPECT_GE(metrics.at("thesis").size(), 3u) << terrain;
    EXPECT_EQ(metrics.count("area"), 1u) << terrain;
  }
}

TEST(Plan, EveryFolderIsOneFlightAndPicturesAreTakenOnce) {
  for (const bool quick : {false, true}) {
    EvaluateOptions options;
    options.quick = quick;
    const Plan plan = planOf(options, 16);
    std::set<std::string> names;
    std::set<std::tuple<std::string, std::string, double>> pictured;
    for (const PlannedFlight& f : plan.flights) {
      EXPECT_TRUE(names.insert(f.run.name).second) << f.run.name;
      EXPECT_TRUE(!f.pictures || pictured.insert({f.run.terrain, f.run.metric, f.run.threshold}).second) << f.run.name;
      EXPECT_GT(f.cost, 0) << f.run.name;
    }
  }
}

TEST(Plan, FlightsOverOneTerrainComeOneAfterTheOther) {
  std::vector<std::string> order;
  for (const PlannedFlight& f : planOf({}, 4).flights)
    if (order.empty() || order.back() != f.run.terrain) order.push_back(f.run.terrain);
  EXPECT_EQ(order, (std::vector<std::string>{"alpine", "canyon", "archipelago"}));
}

TEST(Plan, ThreadsUploadsPoppingAndRepeats) {
  const Plan plan = planOf({}, 8);
  std::map<unsigned, int> threads;  // of the first terrain's first setting
  std::map<std::string, int> frames, popping;
  for (const PlannedFlight& f : plan.flights) {
    frames[f.run.terrain] += f.frames;
    popping[f.run.terrain] += f.popping;
    EXPECT_EQ(f.popping, f.seconds == 0) << f.run.name;
    if (f.run.terrain == "alpine" && f.run.metric == "pixels" && f.run.threshold == 1 && !f.frames && !f.popping) ++threads[f.run.threads];
  }
  EXPECT_EQ(threads, (std::map<unsigned, int>{{0, 3}, {1, 3}, {2, 3}, {4, 3}}));
  for (const char* terrain : {"alpine", "canyon", "archipelago"}) {
    EXPECT_EQ(frames[terrain], 1);
    EXPECT_EQ(popping[terrain], 1);
  }
}

TEST(Plan, NineCamerasWithMoreThanFourSamplesOfTheFinestMeshAlone) {
  const Plan plan = planOf({}, 2);
  EXPECT_EQ(plan.views.size(), 9u);
  EXPECT_EQ(plan.samples, (std::vector<std::uint32_t>{1, 2, 4}));
  ASSERT_EQ(plan.meshes.size(), 3u);
  for (const MeshCase& mesh : plan.meshes) EXPECT_EQ(mesh.mostSamples >= 4, mesh.metric == "area");
}

TEST(Plan, WhatIsAskedForReplacesWhatIsThere) {
  EvaluateOptions options;
  options.refined = {{"area", 0.3}};
  options.terrains = {"canyon"};
  options.views = {"overview"};
  options.seconds = 5;
  options.repeats = 2;
  const Plan plan = planOf(options, 2);
  EXPECT_EQ(plan.meshes, options.refined);
  ASSERT_EQ(plan.views.size(), 1u);
  EXPECT_EQ(plan.views.front().view.terrain, "canyon");
  for (const PlannedFlight& f : plan.flights) {
    EXPECT_EQ(f.run.terrain, "canyon");
    EXPECT_EQ(f.run.metric, "area");
    EXPECT_EQ(f.seconds, f.popping ? 0 : 5);
  }
  EXPECT_NE(plan.words.find("--refined area:0.3"), std::string::npos) << plan.words;
  options.only = "views";
  EXPECT_TRUE(planOf(options, 2).flights.empty());
  EXPECT_NE(planOf(options, 2).words, plan.words);
  options.only = "flights";
  EXPECT_TRUE(planOf(options, 2).views.empty());
}

TEST(Plan, AnHourOrSo) {
  double cost = 0;
  for (const PlannedView& v : planOf({}, 2).views) cost += v.cost;
  for (const PlannedFlight& f : planOf({}, 2).flights) cost += f.cost;
  EXPECT_GT(cost, 20 * 60);
  EXPECT_LT(cost, 75 * 60);
}

TEST(MeshCase, IsReadFromText) {
  EXPECT_EQ(*meshCaseFrom("area:0.3"), (MeshCase{"area", 0.3}));
  EXPECT_EQ(*meshCaseFrom("thesis:2e-5"), (MeshCase{"thesis", 2e-5}));
  for (const char* wrong : {"", ":", "area", "area:", "area:0", "area:-1", "area:0.3x", "area:nan", "area:1e9", "metre:1", "area:0.3:1"}) {
    const auto read = meshCaseFrom(wrong);
    ASSERT_FALSE(read) << wrong;
    EXPECT_NE(read.error().message.find("as in area:0.3"), std::string::npos);
  }
}

}  // namespace
}  // namespace ridgecast::evaluation
