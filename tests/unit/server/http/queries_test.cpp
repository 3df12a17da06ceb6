// Places in coordinates of a person's own, on a map that says where it lies. (Queries in metres of the world: tests/integration.)

#include "server/http/queries.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <random>

#include "server/earth/earth.h"

namespace ridgecast::http {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

constexpr terrain::GridPlace kMiddle{800'000, 5'240'000};

// A plane, so that a height tells the place.
class Slope final : public terrain::Terrain, public terrain::Raster {
 public:
  explicit Slope(std::string crs) : crs_(std::move(crs)) {}
  std::string_view name() const override { return "slope"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  const terrain::Raster* raster() const override { return this; }
  const terrain::RasterShape& shape() const override { return shape_; }
  terrain::RasterOrigin origin() const override { return {"clamp", crs_, kMiddle.easting, kMiddle.northing, {}, {}}; }
  void tile(terrain::TileAddress, terrain::Tile& out) const override { out.fill(0); }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = static_cast<float>(lattice::metres(x[k]) - 8192 * lattice::metres(z[k]));
  }

 private:
  std::string crs_;
  terrain::RasterShape shape_{{-256'000, terrain::pitchOf(2560)}, {-256'000, terrain::pitchOf(2560)}, 201, 201, 0, 0, 7};
};

class QueriesOnEarth : public testing::Test {
 protected:
  QueriesOnEarth() { serve("EPSG:32632"); }
  void serve(const std::string& crs, bool sendsTerrain = true) {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor_;
    resources->makeMesh = session::pipelineMeshes();
    resources->limits.sendsTerrain = sendsTerrain;
    route_ = queryRoute(std::make_shared<session::Directory>(resources, std::make_shared<Slope>(crs)));
  }
  Answer ask(std::string_view target, std::string body = "", std::string_view type = "application/json") {
    Request request;
    request.method = body.empty() ? "GET" : "POST";
    request.target = target;
    request.contentType = type;
    auto answer = route_(request);
    if (answer->ofBody) answer = answer->ofBody->answer(std::move(body));
    if (!answer->later) return *answer;
    for (;;)
      if (Answer made = answer->later->work({}); !made.again) return made;
  }
  static std::vector<float> heightsOf(const Answer& answer) {
    EXPECT_EQ(answer.status, 200u) << answer.body;
    return answer.status == 200 ? Json::parse(answer.body)["heights"].get<std::vector<float>>() : std::vector<float>();
  }
  static float expected(const terrain::GridPlace& at) {
    const auto steps = [](double metres) { return std::floor(metres * 256 + 0.5) / 256; };
    return static_cast<float>(steps(at.easting - kMiddle.easting) - 8192 * steps(kMiddle.northing - at.northing));
  }
  scheduling::Executor executor_{1};
  Route route_;
};

TEST_F(QueriesOnEarth, PlacesAreDegreesOrMetresOfAnyGrid) {
  const earth::Grid* const grid = earth::Grid::of("EPSG:32632", kMiddle);
  ASSERT_TRUE(grid);
  std::mt19937 random(6);
  Json degrees = Json::array(), metres = Json::array();
  std::vector<double> bytes;
  std::vector<float> wanted;
  for (int k = 0; k < 700; ++k) {  // several turns
    const terrain::GridPlace at{kMiddle.easting + random() % 2000 - 999.9, kMiddle.northing + random() % 2000 - 999.9};
    const auto there = grid->degrees(at);
    ASSERT_TRUE(there);
    degrees.push_back({(*there)[0], (*there)[1]});
    bytes.insert(bytes.end(), {(*there)[0], (*there)[1]});
    metres.push_back({at.easting, at.northing});
    wanted.push_back(expected(at));
  }
  EXPECT_EQ(heightsOf(ask("/v1/heights?crs=lonlat", Json{{"at", degrees}}.dump())), wanted);
  EXPECT_EQ(heightsOf(ask("/v1/heights?crs=EPSG:32632", Json{{"at", metres}}.dump())), wanted);
  EXPECT_EQ(heightsOf(ask("/v1/heights?crs=EPSG:25832", Json{{"at", metres}}.dump())), wanted) << "ETRS89 is WGS84 here";
  std::string body(bytes.size() * sizeof(double), '\0');
  std::memcpy(body.data(), bytes.data(), body.size());
  const Answer raw = ask("/v1/heights?crs=lonlat", body, "application/octet-stream");
  ASSERT_EQ(raw.body.size(), wanted.size() * sizeof(float));
  EXPECT_EQ(std::memcmp(raw.body.data(), wanted.data(), raw.body.size()), 0);
  EXPECT_EQ(heightsOf(ask("/v1/heights?crs=EPSG:32632&at=800010,5239980.5")), std::vector<float>{10 - 8192 * 19.5f});
  // Zone 33 sees it from the west of its own meridian.
  const earth::Grid* const other = earth::Grid::of("EPSG:32633", {});
  const auto there = grid->degrees({800'100, 5'240'200});
  const auto at33 = other->at((*there)[0], (*there)[1]);
  std::ostringstream target;
  target.precision(17);
  target << "/v1/normals?crs=EPSG:32633&at=" << at33->easting << "," << at33->northing;
  EXPECT_EQ(ask(target.str()).status, 200u);
  target.str("");
  target << "/v1/heights?crs=EPSG:32633&at=" << at33->easting << "," << at33->northing;
  EXPECT_NEAR(heightsOf(ask(target.str())).at(0), expected({800'100, 5'240'200}), 8192.0 / 256);
}

TEST_F(QueriesOnEarth, WhatCannotBePlacedIsRefused) {
  const auto refusal = [&](std::string_view target) {
    const Answer a = ask(target);
    EXPECT_EQ(a.status, 400u) << target;
    return a.body;
  };
  for (const char* crs : {"WGS84", "EPSG:", "EPSG:-3", "EPSG:1234567", "epsg:2056", "EPSG:32632%20", "%zz"})
    EXPECT_FALSE(refusal("/v1/heights?at=1,2&crs=" + std::string(crs)).empty());
  EXPECT_THAT(refusal("/v1/heights?at=1,2&crs=LONLAT"), HasSubstr("crs is lonlat, for longitudes"));
  EXPECT_THAT(refusal("/v1/heights?at=13,47.2&at=190,47&at=170,-95&crs=lonlat"),
              HasSubstr("The CRS of the map does not reach place number 3."));
  EXPECT_THAT(refusal("/v1/heights?at=1,2&crs=EPSG:4326"), HasSubstr("EPSG:4326 is no projected CRS that PROJ knows"));
  EXPECT_THAT(refusal("/v1/rays?ray=0,0,0,0,-1,0&crs=lonlat"), HasSubstr("Rays have the axes of the world"));
  for (const auto& [crs, sends] : {std::pair{"", true}, {"EPSG:32632", false}}) {
    serve(crs, sends);
    EXPECT_THAT(refusal("/v1/heights?at=1,2&crs=lonlat"), HasSubstr("does not say where on Earth it lies")) << crs;
  }
}

}  // namespace
}  // namespace ridgecast::http
