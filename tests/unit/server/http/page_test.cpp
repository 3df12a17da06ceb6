#include "server/http/site.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "server/directory/directory.h"
#include "server/session/session.h"
#include "tests/support/process.h"

namespace ridgecast::http {
namespace {

using testing::HasSubstr;

class SiteTest : public testing::Test {
 protected:
  void put(const std::string& name, const std::string& text) {
    const auto file = folder / "site" / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << text;
  }
  std::shared_ptr<const Site> load() { return Site::load(folder / "site").value(); }
  testing_support::ScratchFolder folder;
};

TEST_F(SiteTest, FindsItsFilesByTheirExactPathAlone) {
  put("index.html", "<!doctype html>");
  put("assets/main-0a1b2c.js", "let x;");
  put("assets/main-0a1b2c.js.br", "BR");
  put("assets/main-0a1b2c.js.gz", "GZ");
  put("alone.gz", "data");
  put(".secret", "no");
  put(".git/config", "no");
  std::ofstream(folder / "outside.txt") << "outside";
  std::filesystem::create_symlink(folder / "outside.txt", folder / "site/link.txt");
  const auto site = load();
  ASSERT_NE(site->find("/"), nullptr);
  EXPECT_EQ(site->find("/"), site->find("/index.html"));
  EXPECT_EQ(site->find("/")->type, "text/html; charset=utf-8");
  EXPECT_FALSE(site->find("/")->immutable);
  const File* script = site->find("/assets/main-0a1b2c.js");
  ASSERT_NE(script, nullptr);
  EXPECT_EQ(script->type, "text/javascript; charset=utf-8");
  EXPECT_TRUE(script->immutable);
  EXPECT_NE(script->tag, site->find("/")->tag);
  ASSERT_NE(site->find("/alone.gz"), nullptr);
  for (const char* path :
       {"", "index.html", "//", "/../outside.txt", "/assets/../../outside.txt", "/assets/..", "/assets/", "/assets", "/%2e%2e/outside.txt",
        "/link.txt", "/.secret", "/.git/config", "/assets/main-0a1b2c.js.br", "/assets/main-0a1b2c.js.gz", "/INDEX.HTML", "/index.html/"})
    EXPECT_EQ(site->find(path), nullptr) << path;
  EXPECT_EQ(site->find(std::string_view("/index.html\0", 12)), nullptr);
}

TEST_F(SiteTest, OffersTheCompressedFormsThatAreTaken) {
  File file;
  file.plain = "plain";
  file.gzip = "gzip";
  file.brotli = "br";
  const auto form = [&](std::string_view header) { return std::string(formFor(file, header).bytes); };
  EXPECT_EQ(form(""), "plain");
  EXPECT_EQ(form("gzip, deflate, br, zstd"), "br");
  EXPECT_EQ(form("gzip;q=1.0, br;q=0"), "gzip");
  EXPECT_EQ(form("br;q=0.000, gzip;q=0"), "plain");
  EXPECT_EQ(form("GZIP ; q=0.5"), "gzip");
  EXPECT_EQ(form("brotli, xgzip, *"), "plain");
  EXPECT_EQ(form(",,;;q=,"), "plain");
  file.brotli.clear();
  EXPECT_EQ(form("br"), "plain");
  EXPECT_TRUE(formFor(file, "br").encoding.empty());
}

TEST_F(SiteTest, RefusesAFolderThatIsNoPage) {
  EXPECT_THAT(Site::load(folder / "nowhere").error().message, HasSubstr("cannot be read"));
  put("other.html", "");
  EXPECT_THAT(Site::load(folder / "site").error().message, HasSubstr("no index.html"));
  put("index.html", "");
  for (std::size_t k = 0; k < kMaxFiles; ++k) put("f" + std::to_string(k), "");
  EXPECT_THAT(Site::load(folder / "site").error().message, HasSubstr("more than"));
}

class SiteRoutesTest : public SiteTest {
 protected:
  SiteRoutesTest() {
    put("index.html", "<!doctype html>the viewer");
    put("assets/a-1.js", "let x = 1;");
    put("assets/a-1.js.gz", "zipped");
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_unique<directory::Directory>(resources, terrain::create("alpine", 3).value());
    routes.push_back(pageRoute(load()));
  }
  Answer get(std::string_view target, std::string_view encodings = "", std::string_view method = "GET") {
    Request request;
    request.method = method;
    request.target = target;
    request.host = "example.org";
    request.acceptEncoding = encodings;
    return std::get<Answer>(answer(request, *directory, "9.9", routes));
  }
  static std::string header(const Answer& a, std::string_view name) {
    for (const auto& [n, v] : a.headers)
      if (n == name) return v;
    return {};
  }
  scheduling::Executor executor{1};
  std::unique_ptr<directory::Directory> directory;
  std::vector<Route> routes;
};

TEST_F(SiteRoutesTest, ThePageMayGoWhereALeavingServerSendsIt) {
  const auto allowed = [&](const std::string& url) {
    routes = {pageRoute(load(), url)};
    const std::string policy = header(get("/"), "Content-Security-Policy"), begin = "connect-src 'self'";
    const auto at = policy.find(begin) + begin.size();
    return policy.substr(at, policy.find(';', at) - at);
  };
  EXPECT_EQ(allowed(""), "");
  EXPECT_EQ(allowed("wss://b.example"), " wss://b.example:443");
  EXPECT_EQ(allowed("https://b.example:7071/?session=x"), " wss://b.example:7071");
  EXPECT_EQ(allowed("HTTP://b.example"), " ws://b.example:80");
  EXPECT_EQ(allowed("b.example"), " ws://b.example:7070");
  EXPECT_EQ(allowed("ws://[::1]"), " ws://[::1]:80");
  EXPECT_EQ(allowed("ws://[::1]:9"), " ws://[::1]:9");
  for (const char* wrong : {"ws://", "ws://a b", "ws://b.example; script-src *", "'unsafe-inline'"})
    EXPECT_EQ(allowed(wrong), " ") << wrong;
}

TEST_F(SiteRoutesTest, ServesThePageWithItsHeaders) {
  const auto page = get("/?x=1", "gzip, br");
  EXPECT_EQ(page.status, 200u);
  EXPECT_THAT(page.body, HasSubstr("the viewer"));
  EXPECT_EQ(header(page, "Cache-Control"), "") << "checked by its etag each time";
  EXPECT_THAT(header(page, "Content-Security-Policy"),
              testing::AllOf(HasSubstr("default-src 'none'"), HasSubstr("script-src 'self' 'wasm-unsafe-eval'")));
  EXPECT_THAT(header(page, "Content-Security-Policy"), testing::Not(HasSubstr("unsafe-inline")));
  EXPECT_THAT(header(page, "Content-Security-Policy"), HasSubstr("connect-src 'self';"));
  const auto script = get("/assets/a-1.js", "gzip, br");
  EXPECT_EQ(script.body, "zipped");
  EXPECT_EQ(header(script, "Content-Encoding"), "gzip");
  EXPECT_EQ(header(script, "Vary"), "Accept-Encoding");
  EXPECT_THAT(header(script, "Cache-Control"), HasSubstr("immutable"));
  EXPECT_EQ(get("/assets/a-1.js").body, "let x = 1;");
  EXPECT_FALSE(script.etag.empty());
  EXPECT_NE(get("/assets/a-1.js").etag, script.etag) << "other bytes";
  EXPECT_EQ(get("/assets/a-1.js", "gzip", "HEAD").etag, script.etag);
  EXPECT_EQ(get("/assets/a-1.js", "", "POST").status, 405u);
  EXPECT_THAT(get("/about").body, testing::AllOf(HasSubstr("alpine, seed 3"), HasSubstr("in this browser")));
  EXPECT_EQ(get("/healthz").body, "ok\n");
  for (const char* target : {"/assets/../index.html", "/..%2f", "/assets/a-1.js.gz", "/index.htm"})
    EXPECT_EQ(get(target).status, 404u) << target;
}

TEST_F(SiteRoutesTest, SaysThatThePageIsMissing) {
  routes.clear();
  EXPECT_EQ(get("/").status, 200u);
  EXPECT_THAT(get("/").body,
              testing::AllOf(HasSubstr("is not here"), HasSubstr("npm"), HasSubstr("ridgecast-client view ws://example.org")));
  EXPECT_EQ(get("/assets/a-1.js").status, 404u);
}

}  // namespace
}  // namespace ridgecast::http
