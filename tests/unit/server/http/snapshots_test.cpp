#include "server/http/snapshots.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/http/queries.h"
#include "server/http/request_filter.h"
#include "tests/support/edit.h"
#include "tests/support/replies.h"

namespace ridgecast::http {
namespace {

using testing::HasSubstr;
using testing_support::Replied;

class SnapshotRouteTest : public testing::Test {
 protected:
  SnapshotRouteTest() {
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
    route = snapshotRoute(directory, maker);
  }
  std::optional<Replied> ask(std::string_view target, std::string_view method = "GET") {
    Request request;
    request.method = method;
    request.target = target;
    return route(request);
  }
  static std::string header(const Answer& a, std::string_view name) {
    for (const auto& [key, value] : a.headers)
      if (key == name) return value;
    return {};
  }
  scheduling::Executor executor{1};
  std::shared_ptr<session::Resources> resources = std::make_shared<session::Resources>();
  Maker maker{std::make_shared<snapshot::Snapshots>(snapshot::Limits{.triangles = 20'000}, 1), std::make_shared<AnswerCache>(4 << 20)};
  std::shared_ptr<directory::Directory> directory;
  Route route;
};

constexpr char kBox[] = "/v1/sessions/default/snapshot.glb?x0=0&z0=0&x1=40&z1=40&error=2";

TEST_F(SnapshotRouteTest, TakesItsOwnPathsAlone) {
  for (const char* other :
       {"/", "/v1/sessions", "/v1/sessions/", "/v1/sessions/default", "/v1/sessions/default/", "/v1/sessions/default/snapshot",
        "/v1/sessions/default/snapshot.gltf", "/v1/sessions/a/b/snapshot.glb", "/v1/sessions//../snapshot.glb/"})
    EXPECT_FALSE(ask(other)) << other;
}

TEST_F(SnapshotRouteTest, SnapshotsAndQueriesCountAsUse) {
  const auto session = directory->find("default");
  EXPECT_EQ(session->uses(), 0u);
  ask(kBox);
  EXPECT_EQ(session->uses(), 1u);
  Request request;
  request.method = "GET";
  request.target = "/v1/heights?at=1,2";
  EXPECT_TRUE(queryRoute(directory)(request));
  EXPECT_EQ(session->uses(), 2u);
}

TEST_F(SnapshotRouteTest, AGoodQuestionIsWorkWithAnETag) {
  const auto a = ask(kBox);
  ASSERT_TRUE(a && a->later);
  EXPECT_TRUE(a->later->queue == Queue::kPatient);
  EXPECT_EQ(a->etag.size(), 32u);
  EXPECT_TRUE(ask(kBox, "HEAD")->later);
  const Answer made = a->made();
  EXPECT_EQ(made.status, 200u);
  EXPECT_EQ(made.type, "model/gltf-binary");
  EXPECT_EQ(made.etag, a->etag);
  EXPECT_EQ(made.body.substr(0, 4), "glTF");
  EXPECT_EQ(header(made, "Content-Disposition"), "attachment; filename=\"ridgecast-alpine-box.glb\"");
  EXPECT_EQ(header(made, "Access-Control-Allow-Origin"), "*");
  EXPECT_FALSE(ask(kBox, "HEAD")->later);  // from now on it is there
  EXPECT_EQ(ask(kBox, "HEAD")->body, made.body);
}

// Work waits in a queue; the ground may change meanwhile.
TEST_F(SnapshotRouteTest, AreOfTheGroundThatTheirETagNames) {
  for (const char* file : {"snapshot.glb?x0=0&z0=0&x1=40&z1=40&error=0.5", "snapshot.json?x0=0&z0=0&x1=40&z1=40&error=0.5",
                           "snapshot.ply?x=20&z=20&altitude=30&yaw=0&pitch=-80&threshold=4"}) {
    const std::string target = std::string("/v1/sessions/default/") + file;
    const auto makeAnew = [&] {  // a session of that name and world, which nobody has edited
      directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
      route = snapshotRoute(directory, maker);
    };
    makeAnew();
    const auto before = ask(target);
    testing_support::makeCrater(*directory->find("default"), 20, 20, 12, 4);
    const auto after = ask(target);
    ASSERT_TRUE(before->later && after->later);
    EXPECT_NE(before->etag, after->etag) << file;
    const Answer unedited = before->made(), edited = after->made();
    EXPECT_EQ(unedited.etag, before->etag);
    EXPECT_EQ(edited.etag, after->etag);
    makeAnew();
    EXPECT_EQ(ask(target)->etag, before->etag);
    EXPECT_TRUE(ask(target)->body == unedited.body) << "kept";
    maker.cache = std::make_shared<AnswerCache>(4 << 20);
    makeAnew();
    EXPECT_TRUE(ask(target)->made().body == unedited.body) << file;
    EXPECT_TRUE(edited.body != unedited.body) << file;
  }
}

TEST_F(SnapshotRouteTest, RefusesTheRestInPlainWords) {
  EXPECT_EQ(ask("/v1/sessions/none/snapshot.glb?camera=1")->status, 404u);
  EXPECT_EQ(ask("/v1/sessions/%2e%2e/snapshot.glb?camera=1")->status, 400u);
  EXPECT_EQ(ask("/v1/sessions//snapshot.glb?camera=1")->status, 400u);
  EXPECT_EQ(ask("/v1/sessions/default/snapshot.glb")->status, 400u);
  EXPECT_EQ(ask(kBox, "POST")->status, 405u);
  EXPECT_EQ(ask(kBox, "OPTIONS")->status, 204u);
  EXPECT_THAT(header(*ask(kBox, "OPTIONS"), "Access-Control-Allow-Headers"), HasSubstr("Authorization"));
  EXPECT_EQ(ask("/v1/sessions/default/snapshot.glb?camera=7")->made().status, 404u);
  EXPECT_EQ(ask("/v1/sessions/default/snapshot.json?x0=0&z0=0&x1=9000&z1=9000&error=0.02")->made().status, 422u);
}

TEST_F(SnapshotRouteTest, TakesTheRightToSnapshots) {
  EXPECT_EQ(needed("GET", "/v1/sessions/a/snapshot.glb").right, access::Right::kSnapshot);
  EXPECT_EQ(needed("HEAD", "/v1/sessions/a/snapshot.json").right, access::Right::kSnapshot);
  EXPECT_FALSE(needed("OPTIONS", "/v1/sessions/a/snapshot.glb").right);
  EXPECT_FALSE(needed("GET", "/v1/sessions/a/snapshot.glb").everySession);
}

}  // namespace
}  // namespace ridgecast::http
