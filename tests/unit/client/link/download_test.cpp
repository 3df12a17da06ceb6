#include "client/link/download.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_server.h"

namespace ridgecast::link {
namespace {

using namespace std::chrono_literals;
using test::RawConnection;
using test::RawServer;
using testing::HasSubstr;

class DownloadTest : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  Outcome<std::uint64_t> get(const std::string& port, const std::function<void(const Progress&)>& tell = {},
                             std::chrono::milliseconds patience = testing_support::kTimeout) {
    core::Url url;
    url.port = port;
    return download(url, "/v1/a?b=c", file_, patience, tell);
  }
  std::string text() const {
    std::ifstream in(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  std::size_t files() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator()));
  }
  const std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("ridgecast-download-" + std::to_string(getpid()));
  const std::filesystem::path file_ = folder_ / "a.glb";
};

TEST_F(DownloadTest, TheFileComesWholeAndProgressIsTold) {
  const std::string body(3'000'000, 'y');
  std::string head;
  RawServer server([&](RawConnection& c) {
    head = c.readHead();
    c.send("HTTP/1.1 200 OK\r\ncontent-LENGTH: 3000000\r\nX: y\r\n\r\n" + body.substr(0, 10));
    c.send(body.substr(10));
    c.drain();
  });
  Progress last;
  const auto got = get(server.port(), [&](const Progress& p) { last = p; });
  ASSERT_TRUE(got) << got.error().message;
  EXPECT_EQ(*got, 3'000'000u);
  EXPECT_EQ(last.received, last.total);
  EXPECT_EQ(text(), body);
  EXPECT_EQ(files(), 1u);
  EXPECT_THAT(head, testing::StartsWith("GET /v1/a?b=c HTTP/1.1\r\n"));
}

TEST_F(DownloadTest, WordsOfTheWorkAreTold) {
  RawServer server([&](RawConnection& c) {
    EXPECT_THAT(c.readHead(), HasSubstr("\r\nPrefer: progress\r\n"));
    for (const char* word : {"waits", "waits", "meshing, 12 triangles", "meshing, 12 triangles", "evil\x1b[2J", "evil\x1b[2J"}) {
      c.send(std::string("HTTP/1.1 102 Processing\r\nProgress: ") + word + "\r\n\r\n");
      std::this_thread::sleep_for(500ms);  // in all longer than one is patient with silence
    }
    std::string many;
    for (int k = 0; k < 20'000; ++k) many += "HTTP/1.1 103 x\r\nProgress: last\r\n\r\n";
    c.send(many + "HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc");
    c.drain();
  });
  std::vector<std::string> words;
  const auto got = get(
      server.port(),
      [&](const Progress& p) {
        if (words.empty() || words.back() != p.work) words.push_back(p.work);
      },
      2500ms);
  ASSERT_TRUE(got) << got.error().message;
  EXPECT_EQ(text(), "abc");
  EXPECT_THAT(words, testing::IsSupersetOf({"waits", "meshing, 12 triangles", "evil?[2J"}));
  EXPECT_EQ(words.back(), "last");
}

TEST_F(DownloadTest, RefusalsAreTheServersOwnSentence) {
  RawServer server([](RawConnection& c) {
    c.readHead();
    c.send("HTTP/1.1 503 Busy\r\nRetry-After: 5\r\nContent-Length: 21\r\n\r\nThe server is\x1b busy.\r\n");
    c.drain();
  });
  const auto got = get(server.port());
  ASSERT_FALSE(got);
  EXPECT_THAT(got.error().message, testing::AllOf(HasSubstr("says: The server is? busy. (try again in 5 s)")));
  EXPECT_EQ(files(), 0u);
}

TEST_F(DownloadTest, OtherRequestsAreAnsweredWhateverTheStatus) {
  for (const std::string answer :
       {"HTTP/1.1 403 No\r\nContent-Length: 7\r\n\r\nNo\x1b no\n", "HTTP/1.1 200 OK\r\nContent-Length: 7\r\n\r\nNo\x1b no\n"}) {
    std::string head;
    RawServer server([&](RawConnection& c) {
      head = c.readHead();
      c.send(answer);
      c.drain();
    });
    core::Url url;
    url.port = server.port();
    const auto got = request(url, "DELETE", "/v1/a", testing_support::kTimeout);
    ASSERT_TRUE(got) << got.error().message;
    EXPECT_EQ(std::to_string(got->status), answer.substr(9, 3));
    EXPECT_EQ(got->text, "No? no");
    EXPECT_THAT(head, testing::StartsWith("DELETE /v1/a HTTP/1.1\r\n"));
  }
  core::Url url;
  url.port = test::closedPort();
  EXPECT_FALSE(request(url, "DELETE", "/v1/a", testing_support::kTimeout));
}

TEST_F(DownloadTest, HalfAFileIsNone) {
  for (const char* answer : {"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\nhalf", "HTTP/1.1 200 OK\r\nContent-Le",
                             "SSH-2.0-nobody\r\n\r\n", "HTTP/1.1 200 OK\r\nContent-Length: 99999999999999999999999\r\n\r\nx"}) {
    RawServer server([&](RawConnection& c) {
      c.readHead();
      c.send(answer);
    });
    EXPECT_FALSE(get(server.port())) << answer;
    EXPECT_EQ(files(), 0u);
  }
}

TEST_F(DownloadTest, SilenceEnds) {
  RawServer server([](RawConnection& c) {
    c.readHead();
    c.drain();
  });
  EXPECT_THAT(get(server.port(), {}, 400ms).error().message, HasSubstr("no answer"));
  EXPECT_THAT(get(test::closedPort()).error().message, HasSubstr("no server at"));
  EXPECT_EQ(files(), 0u);
}

}  // namespace
}  // namespace ridgecast::link
