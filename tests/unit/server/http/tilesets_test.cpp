#include "server/http/tilesets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/http/request_filter.h"
#include "server/http/snapshots.h"
#include "tests/support/edit.h"
#include "tests/support/replies.h"

namespace ridgecast::http {
namespace {

using testing::HasSubstr;
using testing_support::Replied;
using Json = nlohmann::json;

class TilesetRouteTest : public testing::Test {
 protected:
  TilesetRouteTest() {
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    makeAnew();
  }
  // A session of that name and world, which nobody has edited.
  void makeAnew() {
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
    route = tilesetRoute(directory, maker);
  }
  std::optional<Replied> ask(const std::string& file, std::string_view method = "GET") {
    const std::string target = "/v1/sessions/default/3dtiles/" + file;
    Request request;
    request.method = method;
    request.target = target;
    return route(request);
  }
  static Answer made(const std::optional<Replied>& a) { return a->made(); }
  static std::string header(const Answer& a, std::string_view name) {
    for (const auto& [key, value] : a.headers)
      if (key == name) return value;
    return {};
  }
  scheduling::Executor executor{1};
  std::shared_ptr<session::Resources> resources = std::make_shared<session::Resources>();
  Maker maker{std::make_shared<snapshot::Snapshots>(snapshot::Limits{}, 1), std::make_shared<AnswerCache>(4 << 20)};
  std::shared_ptr<directory::Directory> directory;
  Route route;
};

TEST_F(TilesetRouteTest, TheRootNamesFilesThatThereAre) {
  const auto a = ask("tileset.json?at=11.5,47.25,600&reach=5000&compression=draco&token=a.b-c_d");
  ASSERT_TRUE(a && a->later);
  EXPECT_FALSE(a->later->queue == Queue::kPatient);
  const Answer root = made(a);
  EXPECT_EQ(root.type, "application/json");
  EXPECT_EQ(root.etag, a->etag);
  EXPECT_EQ(header(root, "Access-Control-Allow-Origin"), "*");
  EXPECT_EQ(header(root, "Cache-Control"), "");  // asked for again each time: the ground may be another one
  const Json set = Json::parse(root.body);
  EXPECT_EQ(set["root"]["transform"].size(), 16u);
  const std::string uri = set["root"]["children"][0]["content"]["uri"];
  EXPECT_THAT(uri, HasSubstr(".json?token=a.b-c_d&content="));
  EXPECT_THAT(uri, HasSubstr("&compression=draco"));
  const Answer below = made(ask(uri));
  ASSERT_EQ(below.status, 200u) << below.body;
  EXPECT_EQ(header(below, "Cache-Control"), "private, max-age=86400, immutable");
  std::string tile = Json::parse(below.body)["root"]["content"]["uri"];
  ASSERT_THAT(tile, testing::StartsWith("../../"));
  const Answer content = made(ask(tile.substr(6)));
  EXPECT_EQ(content.type, "model/gltf-binary");
  EXPECT_THAT(content.body, HasSubstr("KHR_draco_mesh_compression"));
  EXPECT_EQ(header(content, "Cache-Control"), "private, max-age=86400, immutable");
}

TEST_F(TilesetRouteTest, WhatWasMadeIsAnsweredAtOnce) {
  for (const char* file : {"tileset.json", "4/0/-1.json", "2/-3/5.glb"}) {
    const auto first = ask(file);
    ASSERT_TRUE(first && first->later) << file;
    EXPECT_EQ(first->later->queue == Queue::kTiles, std::string(file).ends_with(".glb"));
    const Answer was = made(first);
    const auto again = ask(file);
    EXPECT_FALSE(again->later) << file;
    EXPECT_EQ(again->body, was.body);
    EXPECT_EQ(again->etag, was.etag);
    EXPECT_EQ(again->headers, was.headers);
  }
  // A token is in what is answered and not in what is kept.
  EXPECT_THAT(ask("tileset.json?token=secret")->body, HasSubstr("?token=secret&content="));
  EXPECT_EQ(ask("tileset.json?v=7&key=abc&session=1")->status, 200) << "viewers add these";
  EXPECT_EQ(ask("tileset.json")->body.find("token"), std::string::npos);
  // Snapshots share it.
  Request request;
  request.method = "GET";
  request.target = "/v1/sessions/default/snapshot.glb?x0=0&z0=0&x1=40&z1=40&error=2";
  const Route snapshots = snapshotRoute(directory, maker);
  const Answer box = Replied(*snapshots(request)).made();
  EXPECT_EQ(Replied(*snapshots(request)).body, box.body);
}

// Work waits in a queue; the ground may change meanwhile.
TEST_F(TilesetRouteTest, AreOfTheGroundThatTheirETagNames) {
  for (const char* name : {"tileset.json", "4/0/0.json", "0/0/0.glb", "3/0/0.glb"}) {
    const std::string file = name;
    makeAnew();
    const std::string root = made(ask("tileset.json")).body, content = root.substr(root.find("content=") + 8, 16);
    const auto before = ask(file + "?content=" + content);
    testing_support::makeCrater(*directory->find("default"), 16, 16, 12, 4);
    const auto after = ask(file);
    const Answer unedited = made(before), edited = made(after);
    EXPECT_NE(before->etag, after->etag) << file;
    EXPECT_EQ(unedited.etag, before->etag);
    EXPECT_EQ(edited.etag, after->etag);
    EXPECT_EQ(header(made(ask(file + "?content=" + content)), "Cache-Control"), "") << file;
    if (file.ends_with(".json")) {
      EXPECT_THAT(unedited.body, HasSubstr("content=" + content));
    }
    makeAnew();
    EXPECT_TRUE(made(ask(file)).body == unedited.body) << "kept";
    maker.cache = std::make_shared<AnswerCache>(4 << 20);
    makeAnew();
    EXPECT_TRUE(made(ask(file)).body == unedited.body) << file;
    EXPECT_TRUE(edited.body != unedited.body) << file;
  }
}

TEST_F(TilesetRouteTest, RefusesTheRestInPlainWords) {
  for (const char* other : {"", "tileset", "1/2/3", "1/2/3.gltf"}) EXPECT_FALSE(ask(other)) << other;
  for (const char* none : {"other.json", "13/0/0.glb", "-1/0/0.glb", "1/2.glb", "1/2/3/4.glb", "01/0/0.json", "1/0x1/0.glb",
                           "12/99999999/0.glb", "0/1e3/0.glb", "tileset.glb"})
    EXPECT_EQ(ask(none)->status, 404u) << none;
  for (const char* bad : {"at=1", "at=1,2,3,4", "at=361,0", "at=0,91", "at=0,nan", "at=0,0,1e8", "reach=99", "reach=1000001", "x=5e12",
                          "z=a", "compression=zip", "colours=2", "token=%22%3E", "camera=1", "at=0,0&at=1,1"}) {
    const auto a = ask(std::string("tileset.json?") + bad);
    EXPECT_EQ(a->status, 400u) << bad;
    EXPECT_EQ(header(*a, "Access-Control-Allow-Origin"), "*");
  }
  EXPECT_THAT(ask("tileset.json?at=0")->body, HasSubstr("'at' is '0'; it must be LON,LAT or LON,LAT,HEIGHT"));
  EXPECT_EQ(ask("tileset.json", "POST")->status, 405u);
  EXPECT_EQ(ask("tileset.json", "OPTIONS")->status, 204u);
}

TEST_F(TilesetRouteTest, TakesTheRightToSnapshots) {
  EXPECT_EQ(needed("GET", "/v1/sessions/a/3dtiles/tileset.json").right, access::Right::kSnapshot);
  EXPECT_EQ(needed("HEAD", "/v1/sessions/a/3dtiles/1/2/3.glb").right, access::Right::kSnapshot);
  EXPECT_FALSE(needed("OPTIONS", "/v1/sessions/a/3dtiles/1/2/3.glb").right);
  EXPECT_EQ(routeOf("/v1/sessions/a/3dtiles/1/2/3.glb"), "/v1/sessions/{session}/3dtiles/{level}/{i}/{j}.glb");
  EXPECT_EQ(routeOf("/v1/sessions/a/3dtiles/tileset.json"), "/v1/sessions/{session}/3dtiles/tileset.json");
}

Answer answerOfSize(const std::string& etag, std::size_t bytes) {
  Answer a;
  a.etag = etag;
  a.body.assign(bytes, 'x');
  return a;
}

TEST(AnswerCache, HoldsSoManyBytesAndTheLastWanted) {
  AnswerCache cache(40 << 10);
  for (const char* etag : {"a", "b", "c", "d"}) cache.keep(answerOfSize(etag, 9 << 10));
  EXPECT_EQ(cache.bytes(), 40u << 10);
  EXPECT_TRUE(cache.find("a"));
  cache.keep(answerOfSize("e", 1));
  EXPECT_TRUE(cache.find("a"));
  EXPECT_FALSE(cache.find("b"));  // wanted longest ago
  EXPECT_TRUE(cache.find("e"));
  EXPECT_LE(cache.bytes(), 40u << 10);
  cache.keep(answerOfSize("large", 10 << 10));
  EXPECT_FALSE(cache.find("large"));
  Answer refusal = answerOfSize("refusal", 1);
  refusal.status = 503;
  cache.keep(refusal);
  cache.keep(answerOfSize("", 1));
  EXPECT_FALSE(cache.find("refusal"));
  EXPECT_FALSE(cache.find(""));
  AnswerCache none(0);
  none.keep(answerOfSize("a", 0));
  EXPECT_FALSE(none.find("a"));
}

}  // namespace
}  // namespace ridgecast::http
