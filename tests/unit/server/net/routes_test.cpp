#include "server/net/routes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ridgecast::net {
namespace {

using testing::HasSubstr;
using testing::Not;

class RoutesTest : public testing::Test {
 protected:
  RoutesTest() {
    auto resources = std::make_shared<session::Resources>();
    resources->machine = &machine;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_unique<session::Directory>(resources, terrain::create("alpine", 3).value());
  }
  Answer get(std::string_view target) {
    Request request;
    request.method = "GET";
    request.target = target;
    request.host = "example.org:7070";
    return answer(request, *directory, "9.9");
  }
  Answer connect(std::string_view target, std::string_view version = "13") {
    Request request;
    request.method = "GET";
    request.target = target;
    request.upgrade = true;
    request.webSocketVersion = version;
    return answer(request, *directory, "9.9");
  }
  scheduling::Machine machine{1};
  std::unique_ptr<session::Directory> directory;
};

TEST_F(RoutesTest, AnswersWhatThereIs) {
  EXPECT_EQ(get("/healthz").body, "ok\n");
  EXPECT_EQ(get("/healthz?verbose=1").status, 200u);
  EXPECT_THAT(get("/version").body, HasSubstr(R"("version": "9.9", "protocol": 1)"));
  const auto page = get("/");
  EXPECT_EQ(page.status, 200u);
  EXPECT_THAT(page.type, HasSubstr("text/html"));
  EXPECT_THAT(page.body, testing::AllOf(HasSubstr("ridgecast-client view ws://example.org:7070"), HasSubstr("alpine, seed 3"),
                                        Not(HasSubstr("<script"))));
}

TEST_F(RoutesTest, RefusesTheRestInPlainWords) {
  for (const char* target : {"/nope", "", "/healthz/", "//", "/v1/stream/x", "*", "/%2e"}) {
    EXPECT_EQ(get(target).status, 404u) << target;
    EXPECT_THAT(get(target).type, HasSubstr("text/plain"));
  }
  Request post;
  post.method = "POST";
  post.target = "/healthz";
  EXPECT_EQ(answer(post, *directory, "").status, 405u);
  post.target = "/v1/stream";
  post.method = "HEAD";
  EXPECT_EQ(answer(post, *directory, "").status, 405u);
}

TEST_F(RoutesTest, AForeignHostHeaderNeverReachesThePage) {
  Request request;
  request.method = "GET";
  request.target = "/";
  request.host = "<script>alert(1)</script>";
  EXPECT_THAT(answer(request, *directory, "").body, Not(HasSubstr("alert")));
}

TEST_F(RoutesTest, StreamsAreChosenByTheSessionsName) {
  EXPECT_EQ(connect("/v1/stream").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?session=default").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?a=b&session=def%61ult&c").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?sessions=other").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?session=other").status, 404u);
  EXPECT_EQ(connect("/v1/stream?session=a%20b").status, 400u);
  EXPECT_EQ(connect("/v1/stream?session=" + std::string(65, 'a')).status, 400u);
  EXPECT_EQ(connect("/v1/stream?session=%g0").status, 400u);
  EXPECT_EQ(connect("/v1/stream?session=a%").status, 400u);
  EXPECT_EQ(get("/v1/stream").status, 426u);
  EXPECT_EQ(connect("/v1/stream", "8").status, 426u);
}

TEST(QueryParameter, FirstOfItsNameDecoded) {
  EXPECT_EQ(*queryParameter("a=1&b=2&a=3", "a"), "1");
  EXPECT_EQ(*queryParameter("a=1&b", "b"), "");
  EXPECT_EQ(*queryParameter("", "b"), "");
  EXPECT_EQ(*queryParameter("&&=&b=%41%7a", "b"), "Az");
  EXPECT_FALSE(queryParameter("b=%4", "b"));
  EXPECT_FALSE(queryParameter("b=%", "b"));
  EXPECT_TRUE(queryParameter("a=%&b=1", "b"));
}

}  // namespace
}  // namespace ridgecast::net
