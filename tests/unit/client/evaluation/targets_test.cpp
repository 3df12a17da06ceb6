#include "client/evaluation/targets.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;

Json picture(int samples, bool filtered, double ssim, double terrain) {
  return {{"samples", samples}, {"filtered", filtered}, {"mesh", {{"ssim", ssim}, {"terrain", terrain}}}};
}

Json mesh(double triangles, double ssim, double meshMs, std::vector<double> marchMs) {
  return {{"triangles", triangles},
          {"pictures", {picture(1, true, ssim - 0.01, ssim), picture(4, true, ssim, ssim - 0.02), picture(16, false, ssim, ssim)}},
          {"times", {{"mesh_ms", {meshMs}}, {"mesh_cpu_ms", {meshMs}}, {"march_ms", marchMs}, {"march_cpu_ms", marchMs}}}};
}

Json view(const char* name, std::vector<Json> meshes) { return {{"terrain", "canyon"}, {"view", name}, {"meshes", std::move(meshes)}}; }

std::vector<std::string> rowOf(const Table& table, const std::string& what) {
  for (const auto& row : table.rows)
    if (row.front() == what) return row;
  return {};
}

using Row = std::vector<std::string>;

TEST(Targets, TheWorstViewOfTheFinestMeshThatIsAllowed) {
  const std::vector<Json> views = {view("low", {mesh(100'000, 0.5, 100, {1000}), mesh(499'000, 0.99, 100, {1000})}),
                                   view("grazing", {mesh(400'000, 0.96, 100, {1000}), mesh(600'000, 0.1, 100, {1000})})};
  const Table table = targetsOf(views, {});
  EXPECT_EQ(rowOf(table, "canyon, camera at rest, filtered, 2x2 samples"),
            (Row{"canyon, camera at rest, filtered, 2x2 samples", "at least 0.950", "0.960", "grazing", "yes"}));
  EXPECT_EQ(rowOf(table, "canyon, camera at rest, filtered, 2x2 samples, terrain alone").at(4), "no");
  EXPECT_EQ(rowOf(table, "canyon, camera at rest, unfiltered, 4x4 samples").at(2), "0.960");
  for (const auto& row : table.rows) EXPECT_EQ(row.size(), table.header.size());
}

TEST(Targets, SpeedCountsWhereThePictureIsGoodByTheMedianMarch) {
  const std::vector<Json> views = {view("low", {mesh(1, 0.9, 1000, {900, 5000}), mesh(2, 0.97, 100, {1000})})};
  const auto row = rowOf(targetsOf(views, {}), "a picture of the mesh, faster than ray marching where SSIM is at least 0.95");
  ASSERT_EQ(row.size(), 5u);
  EXPECT_EQ(row[2], "10.0");
  EXPECT_EQ(row[4], "yes");
}

TEST(Targets, FlightsPoppingAndHashes) {
  std::vector<FlightResults> flights(2);
  flights[0].run = {"canyon-area-0.3-r1", "canyon", "area", 0.3, 0, 1, {}};
  flights[0].summary.frames.count = 16;
  flights[0].summary.mean = {0.93, 0.91};
  flights[1].run = {"canyon-standing-r1", "canyon", "pixels", 1, 0, 1, {}};
  flights[1].summary.popping = {0.3, 0.15, {}};
  flights[1].summary.hashMismatches = 2;
  const Table table = targetsOf({}, flights);
  EXPECT_EQ(rowOf(table, "canyon, along the flight at 50 m/s").at(4), "yes");
  EXPECT_EQ(rowOf(table, "canyon, along the flight at 50 m/s, terrain alone").at(4), "no");
  EXPECT_EQ(rowOf(table, "canyon, along the flight at 50 m/s").at(3), "mean of 16 pictures");
  EXPECT_EQ(rowOf(table, "largest change between frames while a mesh refines, with morphing as a share of without"),
            (Row{"largest change between frames while a mesh refines, with morphing as a share of without", "at most 0.333", "0.500",
                 "canyon", "no"}));
  EXPECT_EQ(rowOf(table, "iterations after which a client's mesh differed from the server's").at(3), "canyon-standing-r1");
  EXPECT_EQ(table.rows.size(), 4u);  // what was not measured has no row
}

}  // namespace
}  // namespace ridgecast::evaluation
