// Queries, boxes and edits in coordinates of a person's own, on a map that says where it lies. (In metres of the world: tests/integration.)

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <random>

#include "server/earth/earth.h"
#include "server/http/edits.h"
#include "server/http/queries.h"
#include "server/http/snapshots.h"
#include "tests/support/replies.h"

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

class OnEarth : public testing::Test {
 protected:
  OnEarth() { serve("EPSG:32632"); }
  void serve(const std::string& crs, bool sendsTerrain = true) {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor_;
    resources->makeMesh = session::pipelineMeshes();
    resources->limits.sendsTerrain = sendsTerrain;
    const auto directory = std::make_shared<directory::Directory>(resources, std::make_shared<Slope>(crs));
    const Maker maker{std::make_shared<snapshot::Snapshots>(snapshot::Limits(), 1u), std::make_shared<AnswerCache>(1 << 20)};
    routes_ = {queryRoute(directory), editsRoute(directory), snapshotRoute(directory, maker)};
  }
  Answer ask(std::string_view target, std::string body = "", std::string_view type = "application/json") {
    Request request;
    request.method = body.empty() ? "GET" : "POST";
    request.target = target;
    request.contentType = type;
    std::optional<Reply> reply;
    for (const Route& route : routes_)
      if (!reply) reply = route(request);
    return testing_support::Replied(*reply).made({}, std::move(body));
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
  std::vector<Route> routes_;
};

std::string spelt(std::initializer_list<double> numbers) {
  std::ostringstream out;
  out.precision(17);
  for (const double v : numbers) out << (out.tellp() == 0 ? "" : ",") << v;
  return out.str();
}

TEST_F(OnEarth, PlacesAreDegreesOrMetresOfAnyGrid) {
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

TEST_F(OnEarth, WhatCannotBePlacedIsRefused) {
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
  EXPECT_THAT(refusal("/v1/rays?ray=170,-95,0,0,-1,0&crs=lonlat"), HasSubstr("The CRS of the map does not reach ray number 1."));
  EXPECT_THAT(refusal("/v1/sessions/default/snapshot.json?error=1&crs=lonlat&box=13.1,47.2,13,47.3"), HasSubstr("begin in the south-west"));
  EXPECT_THAT(refusal("/v1/sessions/default/snapshot.json?error=1&crs=lonlat&box=13,47,14"), HasSubstr("WEST,SOUTH,EAST,NORTH with crs"));
  EXPECT_THAT(refusal("/v1/sessions/default/snapshot.json?error=1&crs=lonlat&box=all"), HasSubstr("leave crs out"));
  EXPECT_THAT(refusal("/v1/sessions/default/snapshot.json?error=1&crs=lonlat&x0=0&z0=0&x1=9&z1=9"),
              HasSubstr("'crs', which does not belong here"));
  for (const auto& [crs, sends] : {std::pair{"", true}, {"EPSG:32632", false}}) {
    serve(crs, sends);
    EXPECT_THAT(refusal("/v1/heights?at=1,2&crs=lonlat"), HasSubstr("does not say where on Earth it lies")) << crs;
  }
}

TEST_F(OnEarth, RaysGoEastNorthAndUpAndHitWhereTheySay) {
  const earth::Grid* const grid = earth::Grid::of("EPSG:32632", kMiddle);
  const auto at = grid->degrees(kMiddle);
  const auto hit = [&](std::string_view crs, const std::array<double, 2>& from, double height, double east, double north, double up) {
    const Answer a = ask("/v1/rays?crs=" + std::string(crs) + "&ray=" + spelt({from[0], from[1], height, east, north, up}));
    EXPECT_EQ(a.status, 200u) << a.body;
    return Json::parse(a.body)["rays"][0];
  };
  const Json below = hit("lonlat", *at, 100, 0, 0, -1);
  EXPECT_NEAR(below["distance"], 100, 1e-3);
  EXPECT_NEAR(below["at"][0], (*at)[0], 1e-9);
  EXPECT_NEAR(below["at"][1], (*at)[1], 1e-9);
  // The grid is turned by 3 degrees here: 61 m due north, of the ellipsoid or of the grid.
  const Json north = hit("lonlat", *at, 500'000, 0, 1, 0);
  ASSERT_FALSE(north.is_null());
  EXPECT_NEAR(north["distance"], 61, 0.2);
  EXPECT_NEAR(north["at"][0], (*at)[0], 1e-8);
  EXPECT_NEAR((double(north["at"][1]) - (*at)[1]) * 111'180, 61, 0.3);
  EXPECT_EQ(north["at"][2], 500'000);
  const Json up = hit("EPSG:32632", {kMiddle.easting, kMiddle.northing}, 500'000, 0, 1, 0);
  EXPECT_NEAR(up["at"][0], kMiddle.easting, 1e-6);
  EXPECT_NEAR(up["at"][1], kMiddle.northing + double(up["distance"]), 1e-6);
  const Json east = hit("lonlat", *at, 20'000, 1, 0, 0), west = hit("lonlat", *at, 20'000, -1, 0, 0);
  const Json& side = east.is_null() ? west : east;
  ASSERT_FALSE(side.is_null());
  EXPECT_NEAR(side["at"][1], (*at)[1], 1e-7);
  EXPECT_GT(std::abs(double(side["at"][0]) - (*at)[0]), 1e-5);
}

TEST_F(OnEarth, ABoxOfAnyCrsIsTheLeastOneAroundIt) {
  const earth::Grid* const grid = earth::Grid::of("EPSG:32632", kMiddle);
  const Slope slope("EPSG:32632");
  const auto at = *grid->degrees(kMiddle);
  const double west = at[0] - 0.01, south = at[1] - 0.004, east = at[0] + 0.008, north = at[1] + 0.007;
  const auto question = snapshot::parse("crs=lonlat&error=1&box=" + spelt({west, south, east, north}), {}, &slope);
  ASSERT_TRUE(question) << question.error().message;
  const auto box = std::get<snapshot::OfBox>(question->of);
  double gaps[4] = {1e9, 1e9, 1e9, 1e9};
  std::mt19937 random(3);
  const auto share = [&] { return std::uniform_int_distribution(0, 8)(random) / 8.0; };
  for (int k = 0; k < 2000; ++k) {
    const auto there = grid->at(west + share() * (east - west), south + share() * (north - south));
    const double x = there->easting - kMiddle.easting, z = kMiddle.northing - there->northing;
    const double gap[4] = {x - lattice::metres(box.low.x), z - lattice::metres(box.low.z), lattice::metres(box.high.x) - x,
                           lattice::metres(box.high.z) - z};
    for (std::size_t s = 0; s < 4; ++s) gaps[s] = std::min(gaps[s], gap[s]);
  }
  for (const double gap : gaps) {
    EXPECT_GE(gap, -0.004);
    EXPECT_LT(gap, 0.02);
  }
  const auto own = snapshot::parse("crs=EPSG:32632&error=1&box=799900,5239900,800100,5240200", {}, &slope);
  EXPECT_EQ(snapshot::canonical(*own), snapshot::canonical(*snapshot::parse("error=1&x0=-100&z0=-200&x1=100&z1=100", {}, &slope)));
  EXPECT_EQ(snapshot::canonical(*own), snapshot::canonical(*snapshot::parse("error=1&box=-100,-200,100,100", {}, &slope)));
}

TEST_F(OnEarth, EditsLieAtTheirPlace) {
  const earth::Grid* const grid = earth::Grid::of("EPSG:32632", kMiddle);
  const auto at = [&](double x, double z) { return *grid->degrees({kMiddle.easting + x, kMiddle.northing - z}); };
  const std::string edits = "/v1/sessions/default/edits";
  const auto made = [&](const Json& edit) { EXPECT_EQ(ask(edits, edit.dump()).status, 201u) << edit; };
  made({{"op", "crater"}, {"crs", "lonlat"}, {"at", at(40, -60)}, {"radius", 12}, {"depth", 4}});
  made({{"op", "road"}, {"crs", "lonlat"}, {"line", {at(0, 0), at(64, 8)}}, {"width", 6}});
  made({{"op", "level"}, {"crs", "EPSG:32632"}, {"polygon", {{800000, 5240000}, {800010, 5240000}, {800010, 5239990}}}, {"height", 5}});
  made({{"op", "smooth"}, {"at", {7, 9}}, {"radius", 3}});
  const Json list = Json::parse(ask(edits).body)["edits"];
  ASSERT_EQ(list.size(), 4u);
  EXPECT_EQ(list[0]["edit"]["x"], 40);
  EXPECT_EQ(list[0]["edit"]["z"], -60);
  EXPECT_EQ(list[1]["edit"]["line"][0][0], 0);
  EXPECT_EQ(list[1]["edit"]["line"].back()[0], 64);
  EXPECT_EQ(list[1]["edit"]["line"].back()[1], 8);
  EXPECT_EQ(list[2]["edit"]["polygon"], (Json{{0, 0}, {10, 0}, {10, 10}}));
  EXPECT_EQ(list[3]["edit"]["x"], 7);
  const auto refusal = [&](const Json& edit) {
    const Answer a = ask(edits, edit.dump());
    EXPECT_EQ(a.status, 422u) << edit;
    return a.body;
  };
  const Json crater{{"op", "crater"}, {"radius", 12}, {"depth", 4}};
  const auto with = [&](Json more) {
    more.update(crater);
    return more;
  };
  EXPECT_THAT(refusal(with({{"crs", "lonlat"}, {"x", 13}, {"z", 47}})), HasSubstr("\"at\" must be a place"));
  EXPECT_THAT(refusal(with({{"crs", "lonlat"}, {"at", {13, 47, 5}}})), HasSubstr("\"at\" must be a place"));
  EXPECT_THAT(refusal(with({{"crs", "lonlat"}, {"at", {13, -95}}})), HasSubstr("The CRS of the map does not reach"));
  EXPECT_THAT(refusal(with({{"crs", "Mars"}, {"at", {13, 47}}})), HasSubstr("crs is lonlat"));
  EXPECT_THAT(refusal(with({{"crs", ""}, {"at", {13, 47}}})), HasSubstr("crs is lonlat"));
  EXPECT_THAT(refusal(with({{"crs", 4326}, {"at", {13, 47}}})), HasSubstr("\"crs\" must be a text"));
  EXPECT_THAT(refusal(with({{"at", {13, 47}}, {"x", 1}})), HasSubstr("has no \"x\""));
  serve("EPSG:32632", false);
  EXPECT_THAT(refusal(with({{"crs", "lonlat"}, {"at", at(1, 1)}})), HasSubstr("does not say where on Earth it lies"));
}

}  // namespace
}  // namespace ridgecast::http
