#include "server/bus/protocol.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "server/bus/address.h"
#include "tests/support/sanitized.h"

namespace ridgecast::bus {
namespace {

bool equal(const Reply& a, const Reply& b) {
  return a.kind == b.kind && a.text == b.text && a.integer == b.integer &&
         std::equal(a.parts.begin(), a.parts.end(), b.parts.begin(), b.parts.end(), equal);
}

// As the protocol's document says, and not as protocol.cpp reads.
void write(const Reply& reply, std::string& out) {
  switch (reply.kind) {
    case Reply::Kind::kNil:
      out += "$-1\r\n";
      break;
    case Reply::Kind::kText:
      out += "$" + std::to_string(reply.text.size()) + "\r\n" + reply.text + "\r\n";
      break;
    case Reply::Kind::kInteger:
      out += ":" + std::to_string(reply.integer) + "\r\n";
      break;
    case Reply::Kind::kError:
      out += "-" + reply.text + "\r\n";
      break;
    case Reply::Kind::kArray:
      out += "*" + std::to_string(reply.parts.size()) + "\r\n";
      for (const Reply& part : reply.parts) write(part, out);
  }
}

Reply random(std::mt19937& from, int depth) {
  Reply reply;
  reply.kind = static_cast<Reply::Kind>(from() % (depth < 5 ? 5 : 3));
  if (depth >= 5 && reply.kind == Reply::Kind::kArray) reply.kind = Reply::Kind::kNil;
  if (reply.kind == Reply::Kind::kInteger) reply.integer = static_cast<int>(from());
  if (reply.kind == Reply::Kind::kError) reply.text = "ERR " + std::to_string(from());
  if (reply.kind == Reply::Kind::kText)
    for (std::size_t n = from() % 200; n > 0; --n) reply.text += static_cast<char>(from());
  if (reply.kind == Reply::Kind::kArray)
    for (std::size_t n = from() % 6; n > 0; --n) reply.parts.push_back(random(from, depth + 1));
  return reply;
}

TEST(ReplyReader, TakesRepliesApartHoweverTheirBytesCome) {
  std::mt19937 from(3);
  for (int round = 0; round < testing_support::rounds(200); ++round) {
    std::vector<Reply> replies;
    std::string bytes;
    for (int i = 0; i < 10; ++i) write(replies.emplace_back(random(from, 0)), bytes);
    ReplyReader reader;
    std::size_t read = 0;
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t piece = std::min<std::size_t>(bytes.size() - at, 1 + from() % (round % 2 ? 3 : 700));
      reader.feed(std::string_view(bytes).substr(at, piece));
      at += piece;
      for (;;) {
        auto next = reader.next();
        ASSERT_TRUE(next);
        if (!*next) break;
        ASSERT_LT(read, replies.size());
        EXPECT_TRUE(equal(**next, replies[read++]));
      }
    }
    EXPECT_EQ(read, replies.size());
  }
}

TEST(ReplyReader, WaitsForTheRestOfEveryPrefix) {
  std::mt19937 from(4);
  for (int round = 0; round < testing_support::rounds(60); ++round) {
    std::string bytes;
    write(random(from, 0), bytes);
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      ReplyReader reader;
      const std::vector<char> fresh(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));  // its end is guarded
      reader.feed({fresh.data(), fresh.size()});
      const auto next = reader.next();
      ASSERT_TRUE(next && !*next) << size;
    }
  }
}

TEST(ReplyReader, RefusesWhatNoRedisSays) {
  for (const std::string& bytes : {std::string("HTTP/1.1 400 Bad Request\r\n\r\n"), std::string("$-2\r\n"), std::string("*-2\r\n"),
                                   std::string(":12x\r\n"), std::string("$999999999999999999999\r\n"), std::string("*2147483648\r\n"),
                                   std::string("*2147483647\r\n"), std::string("*65537\r\n"), std::string("\xff\xff\r\n"),
                                   std::string("*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n*1\r\n:1\r\n")}) {
    ReplyReader reader;
    reader.feed(bytes);
    EXPECT_FALSE(reader.next()) << bytes;
    reader.feed("+OK\r\n");
    EXPECT_FALSE(reader.next()) << bytes;  // nor later
  }
}

// Each part is small, and what holds them would not be.
TEST(ReplyReader, BoundsThePartsOfOneReplyTogether) {
  ReplyReader reader;
  reader.feed("*60000\r\n*5000\r\n");
  EXPECT_TRUE(reader.next());
  for (int i = 0; i < 5000; ++i) reader.feed(":1\r\n");
  EXPECT_TRUE(reader.next());
  reader.feed("*5000\r\n");
  EXPECT_FALSE(reader.next());
  ReplyReader many;  // and each by itself
  for (int i = 0; i < 10; ++i) {
    std::string bytes = "*60000\r\n";
    for (int n = 0; n < 60'000; ++n) bytes += "$-1\r\n";
    many.feed(bytes);
    const auto next = many.next();
    ASSERT_TRUE(next && *next);
    EXPECT_EQ((*next)->parts.size(), 60'000u);
  }
}

TEST(ReplyReader, BoundsTheBytesOfOneReply) {
  ReplyReader reader;
  reader.feed("$9223372036854775807\r\n");
  const std::string piece(1 << 16, 'x');
  std::size_t fed = 0;
  while (reader.next() && fed < 2 * ReplyReader::kMaxBytes) {
    reader.feed(piece);
    fed += piece.size();
  }
  EXPECT_LE(fed, ReplyReader::kMaxBytes + 2 * piece.size());
}

TEST(ReplyReader, SurvivesDamage) {
  std::mt19937 from(5);
  for (int round = 0; round < testing_support::rounds(3000); ++round) {
    std::string bytes;
    for (int i = 0; i < 3; ++i) write(random(from, 0), bytes);
    for (std::size_t n = 1 + from() % 4; n > 0; --n) {
      const std::size_t at = from() % bytes.size();
      if (from() % 2)
        bytes[at] = "$*:+-0123456789\r\n\xff"[from() % 18];
      else
        bytes.erase(at, from() % 5);
      if (bytes.empty()) break;
    }
    ReplyReader reader;
    reader.feed(bytes);
    for (int i = 0; i < 100; ++i)
      if (const auto next = reader.next(); !next || !*next) break;
  }
}

TEST(Command, IsAnArrayOfTexts) {
  EXPECT_EQ(command({"SET", "k", std::string_view("\r\n\0", 3)}), "*3\r\n$3\r\nSET\r\n$1\r\nk\r\n$3\r\n\r\n" + std::string("\0\r\n", 3));
}

TEST(Address, IsReadFromAUrl) {
  const auto is = [](const std::string& url, bool tls, const std::string& user, const std::string& password, const std::string& host,
                     int port, unsigned database, const std::string& text) {
    const auto a = parseAddress(url);
    ASSERT_TRUE(a) << url;
    EXPECT_EQ(a->tls, tls) << url;
    EXPECT_EQ(a->user, user) << url;
    EXPECT_EQ(a->password, password) << url;
    EXPECT_EQ(a->host, host) << url;
    EXPECT_EQ(a->port, port) << url;
    EXPECT_EQ(a->database, database) << url;
    EXPECT_EQ(a->text(), text) << url;
  };
  is("redis://host", false, "", "", "host", 6379, 0, "redis://host:6379");
  is("rediss://me:pa%40ss@10.0.0.1:7000/3", true, "me", "pa@ss", "10.0.0.1", 7000, 3, "rediss://10.0.0.1:7000/3");
  is("redis://:only:pass@host/", false, "", "only:pass", "host", 6379, 0, "redis://host:6379");
  is("redis://me@host", false, "me", "", "host", 6379, 0, "redis://host:6379");
  is("redis://[::1]:7000", false, "", "", "::1", 7000, 0, "redis://[::1]:7000");
  for (const char* wrong : {"", "host", "http://host", "redis://", "redis:///1", "redis://host:0", "redis://host:65536", "redis://host:x",
                            "redis://host/x", "redis://me:@host", "redis://me:%4@host", "redis://[::1", "redis://[::1]x", "redis://a b",
                            "redis://host?x=1", "redis://host/1/2"}) {
    const auto a = parseAddress(wrong);
    EXPECT_FALSE(a) << wrong;
  }
  EXPECT_THAT(parseAddress("redis://me:secret@").error().message, testing::Not(testing::HasSubstr("secret")));
}

}  // namespace
}  // namespace ridgecast::bus
