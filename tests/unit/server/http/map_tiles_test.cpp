#include "server/http/map_tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <sstream>
#include <thread>

#include "server/http/queries.h"
#include "server/http/request_filter.h"
#include "tests/support/edit.h"
#include "tests/support/replies.h"

namespace ridgecast::http {
namespace {

using testing::HasSubstr;
using testing_support::Replied;

class MapTilesTest : public testing::Test {
 protected:
  MapTilesTest() {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
    tiles = mapTileRoute(directory);
    queries = queryRoute(directory);
  }
  static std::optional<Replied> ask(const Route& route, std::string_view target, std::string_view method = "GET") {
    Request request;
    request.method = method;
    request.target = target;
    return route(request);
  }
  std::optional<Replied> ask(std::string_view target, std::string_view method = "GET") const { return ask(tiles, target, method); }
  scheduling::Executor executor{1};
  std::shared_ptr<directory::Directory> directory;
  Route tiles, queries;
};

constexpr char kTile[] = "/v1/sessions/default/heights/14/8715/5741.png?at=11.5,47.25";
constexpr char kColours[] = "/v1/sessions/default/colours/14/8715/5741.jpg?at=11.5,47.25";

// Through the library, and by the viewers' formulas; the heights by /v1/heights.
TEST_F(MapTilesTest, HeightsAreThoseOfTheQueriesWithinHalfAUnit) {
  constexpr double kRadians = std::numbers::pi / 180, kLongitude = 11.5, kLatitude = 47.25;
  const auto mercator = [](double latitude) { return std::log(std::tan(std::numbers::pi / 4 + latitude * kRadians / 2)); };
  std::mt19937 random(5);
  for (int level = 6; level <= 20; level += 2) {
    const double n = std::ldexp(1.0, level);
    const auto x = static_cast<std::uint32_t>((kLongitude + 180) / 360 * n),
               y = static_cast<std::uint32_t>((1 - mercator(kLatitude) / std::numbers::pi) / 2 * n);
    const auto answer = ask("/v1/sessions/default/heights/" + std::to_string(level) + "/" + std::to_string(x) + "/" + std::to_string(y) +
                            ".png?at=11.5,47.25");
    ASSERT_TRUE(answer && answer->later);
    const Answer made = answer->made();
    ASSERT_EQ(made.status, 200u);
    EXPECT_EQ(made.type, "image/png");
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    ASSERT_TRUE(png_image_begin_read_from_memory(&image, made.body.data(), made.body.size()));
    image.format = PNG_FORMAT_RGB;
    std::vector<std::uint8_t> rgb(PNG_IMAGE_SIZE(image));
    ASSERT_TRUE(png_image_finish_read(&image, nullptr, rgb.data(), 0, nullptr));
    ASSERT_EQ(rgb.size(), 3u * 256 * 256);
    for (int k = 0; k < 20; ++k) {
      const auto column = random() % 256, row = random() % 256;
      const double longitude = (x + (column + 0.5) / 256) / n * 360 - 180, north = std::numbers::pi * (1 - 2 * (y + (row + 0.5) / 256) / n);
      const double scale = 6'378'137 * std::cos(kLatitude * kRadians);
      std::ostringstream query;
      query.precision(17);
      query << "/v1/heights?at=" << (longitude - kLongitude) * kRadians * scale << "," << -(north - mercator(kLatitude)) * scale;
      const std::string said = ask(queries, query.str())->made().body;
      const double height = std::stof(said.substr(said.find('[') + 1));  // nine digits are one float
      const std::uint8_t* pixel = &rgb[3 * (256 * row + column)];
      EXPECT_LE(std::abs(pixel[0] * 256.0 + pixel[1] + pixel[2] / 256.0 - 32'768 - height), 0.5 / 256) << query.str() << " at " << level;
    }
  }
}

// Without a place of one's own; 204 beside the map where asked for.
TEST_F(MapTilesTest, AMapThatSaysWhereItLiesLiesThere) {
  class Map final : public terrain::Terrain, public terrain::Raster {
   public:
    std::string_view name() const override { return "map"; }
    std::string_view source() const override { return ""; }
    std::uint32_t seed() const override { return 1; }
    const terrain::Raster* raster() const override { return this; }
    const terrain::RasterShape& shape() const override { return shape_; }
    terrain::RasterOrigin origin() const override { return {"clamp", "EPSG:32632", 800'000.0, 5'240'000.0, {}, {}}; }
    void tile(terrain::TileAddress, terrain::Tile& out) const override { out.fill(0); }
    void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
      std::ranges::fill(out, 700.0f);
    }
    terrain::RasterShape shape_{{-256'000, terrain::pitchOf(2560)}, {-256'000, terrain::pitchOf(2560)}, 201, 201, 0, 0, 7};
  };
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->makeMesh = session::pipelineMeshes();
  const Route route = mapTileRoute(std::make_shared<directory::Directory>(resources, std::make_shared<Map>()));
  const std::string here = "/v1/sessions/default/heights/14/8782/5746.png", beside = "/v1/sessions/default/heights/14/8700/5741.png";
  const auto statusOf = [&](const std::string& target) { return ask(route, target)->made().status; };
  EXPECT_EQ(statusOf(here), 200u);
  EXPECT_EQ(statusOf(here + "?beyond=empty"), 200u);
  EXPECT_EQ(statusOf(beside), 200u);
  EXPECT_EQ(statusOf(beside + "?beyond=empty"), 204u);
  EXPECT_EQ(statusOf("/v1/sessions/default/heights/3/6/3.png?beyond=empty"), 204u);
  EXPECT_EQ(statusOf("/v1/sessions/default/heights/3/6/3.png"), 404u) << "UTM ends somewhere";
  EXPECT_EQ(ask(route, here + "?beyond=all")->status, 400u);
  Request list;
  list.method = "GET";
  list.target = "/v1/sessions/default/heights/tiles.json";
  list.host = "localhost";
  EXPECT_THAT(Replied(*route(list)).made().body, testing::AllOf(HasSubstr("/heights/{z}/{x}/{y}.png\"]"), HasSubstr("\"maxzoom\": 14,"),
                                                                HasSubstr("\"bounds\": [12.9"), HasSubstr(", 12.97828718, ")));
  EXPECT_NE(ask(route, here)->etag, ask(route, here + "?at=12.9,47.2")->etag);
  EXPECT_THAT(ask("/v1/sessions/default/heights/14/8782/5741.png")->body, HasSubstr("Say at=LON,LAT"));
}

TEST_F(MapTilesTest, AreListedWithTheirBounds) {
  Request request;
  request.method = "GET";
  request.host = "maps.example.org:7070";
  const auto asked = [&](const char* target, const Route& route) {
    request.target = target;
    return Replied(*route(request)).made();
  };
  const Answer own = asked("/v1/sessions/default/heights/tiles.json?at=11.5,47.25&v=3", tiles);
  EXPECT_EQ(own.status, 200u);
  EXPECT_EQ(own.body, R"({
  "tilejson": "3.0.0",
  "name": "default heights",
  "tiles": ["http://maps.example.org:7070/v1/sessions/default/heights/{z}/{x}/{y}.png?at=11.5,47.25"],
  "minzoom": 0,
  "maxzoom": 24,
  "bounds": [-180, -85.051129, 180, 85.051129],
  "center": [11.5, 47.25, 12],
  "tileSize": 256,
  "encoding": "terrarium"
}
)");
  EXPECT_EQ(asked("/v1/sessions/default/heights/tiles.json", tiles).status, 400u);
  request.isSecure = true;
  EXPECT_THAT(asked("/v1/sessions/default/colours/tiles.json?at=0,0&beyond=empty", tiles).body,
              testing::AllOf(HasSubstr("\"https://maps.example.org:7070/v1/sessions/default/colours/{z}/{x}/{y}.jpg?at=0,0&beyond=empty\""),
                             testing::Not(HasSubstr("terrarium"))));
  for (const char* const host : {"", "\"><script>", "a/b"}) {
    request.host = host;
    EXPECT_THAT(asked("/v1/sessions/default/heights/tiles.json?at=0,0", tiles).body, HasSubstr("Send a Host header")) << host;
  }
  EXPECT_EQ(routeOf("/v1/sessions/a/heights/tiles.json"), "/v1/sessions/{session}/heights/tiles.json");
  EXPECT_EQ(needed("GET", "/v1/sessions/a/heights/tiles.json").right, access::Right::kQuery);
}

TEST_F(MapTilesTest, TakeNoThreadThatShortAnswersNeed) {
  for (const char* const target : {kTile, kColours}) EXPECT_TRUE(ask(target)->later->queue == Queue::kTiles);
}

TEST_F(MapTilesTest, AnswersMayBeKeptAndReadByAnyPage) {
  const auto a = ask(kTile), colours = ask(kColours);
  ASSERT_TRUE(a && a->later && colours && colours->later);
  EXPECT_FALSE(a->later->queue == Queue::kPatient) << "a query, not a snapshot";
  EXPECT_EQ(a->etag.size(), 32u);
  EXPECT_EQ(a->etag, ask(kTile, "HEAD")->etag);
  for (const char* other : {kColours, "/v1/sessions/default/heights/14/8715/5741.png?at=11.5,47.26",
                            "/v1/sessions/default/heights/14/8715/5742.png?at=11.5,47.25"})
    EXPECT_NE(a->etag, ask(other)->etag) << other;
  EXPECT_EQ(directory->find("default")->uses(), 6u);
  const Answer made = a->made(), picture = colours->made();
  EXPECT_EQ(made.etag, a->etag);
  EXPECT_THAT(made.headers, testing::Contains(std::pair<std::string, std::string>("Access-Control-Allow-Origin", "*")));
  EXPECT_EQ(picture.type, "image/jpeg");
  EXPECT_EQ(picture.body.substr(0, 3), "\xff\xd8\xff");
  EXPECT_EQ(ask(kTile, "OPTIONS")->status, 204u);
  std::stop_source stopped;
  stopped.request_stop();
  for (const auto& one : {a, colours}) EXPECT_EQ(one->made(stopped.get_token()).status, 503u);
}

// Work waits in a queue; the ground may change meanwhile.
TEST_F(MapTilesTest, AreOfTheGroundThatTheirETagNames) {
  constexpr char kHere[] = "/v1/sessions/default/heights/20/524288/524287.png?at=0,0";
  const auto session = directory->find("default");
  const std::string unedited = ask(kHere)->made().body;
  const auto before = ask(kHere);
  testing_support::makeCrater(*session, 10, -10, 8, 4);
  const Answer made = before->made();
  EXPECT_TRUE(made.body == unedited);
  EXPECT_EQ(made.etag, before->etag);
  EXPECT_THAT(made.headers, testing::Contains(std::pair<std::string, std::string>("Ridgecast-Edit", "0")));
  EXPECT_NE(ask(kHere)->etag, before->etag);
  EXPECT_TRUE(ask(kHere)->made().body != unedited);
  // Also in the midst of an edit: of all answers with one ETag, the first and the last are of one ground.
  std::jthread editor([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) testing_support::makeCrater(*session, 10, -10, 1, 0.5);
  });
  const auto editOf = [](const Replied& answer) {
    const Answer tile = answer.made();
    const auto edit = std::ranges::find(tile.headers, "Ridgecast-Edit", [](const auto& header) { return header.first; });
    return edit == tile.headers.end() ? "none" : edit->second;
  };
  for (int changes = 0; changes < 20; ++changes) {
    const auto first = ask(kHere);
    auto last = first;
    for (auto next = first; next->etag == first->etag; next = ask(kHere)) last = next;
    ASSERT_EQ(editOf(*first), editOf(*last)) << "one ETag, two grounds";
  }
}

TEST_F(MapTilesTest, RefusesTheRestInPlainWords) {
  const std::string base = "/v1/sessions/default/heights/";
  EXPECT_EQ(ask("/v1/sessions/none/heights/1/0/0.png?at=0,0")->status, 404u);
  for (const char* path : {"25/0/0.png", "-1/0/0.png", "3/8/0.png", "3/0/8.png", "3/0/0.jpg", "3/0/x.png", "3/0", "a/0/0.png",
                           "3/0/0.png/1.png", "3/4294967296/0.png", ""}) {
    const auto a = ask(base + path + "?at=0,0");
    ASSERT_TRUE(a);
    EXPECT_EQ(a->status, 404u) << path;
    EXPECT_THAT(a->body, HasSubstr("X and Y below 2^Z"));
  }
  for (const char* at : {"", "?at=", "?at=1", "?at=181,0", "?at=0,86", "?at=nan,0", "?at=1,2,3", "?at=%zz"})
    EXPECT_EQ(ask(base + "3/0/0.png" + at)->status, 400u) << at;
  EXPECT_EQ(ask(kTile, "POST")->status, 405u);
  for (const char* other : {"/v1/heights", "/v1/sessions/default", "/v1/sessions/default/snapshot.glb", "/v1/sessions/heights"})
    EXPECT_FALSE(ask(other)) << other;
}

TEST_F(MapTilesTest, NeedTheRightOfQueries) {
  for (const char* path : {"/v1/sessions/a/heights/1/0/0.png", "/v1/sessions/a/colours/1/0/0.jpg", "/v1/sessions/a/heights/snapshot.glb"}) {
    EXPECT_EQ(needed("GET", path).right, access::Right::kQuery);
    EXPECT_FALSE(needed("GET", path).everySession);
    EXPECT_FALSE(needed("OPTIONS", path).right);
  }
  EXPECT_EQ(routeOf("/v1/sessions/a/heights/1/0/0.png"), "/v1/sessions/{session}/heights/{z}/{x}/{y}");
  EXPECT_EQ(routeOf("/v1/sessions/heights/colours/1/0/0.jpg"), "/v1/sessions/{session}/colours/{z}/{x}/{y}");
}

}  // namespace
}  // namespace ridgecast::http
