// `ridgecast-server edits` as people run it, and logs of servers that live.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::HasSubstr;
using testing::StartsWith;

Finished edits(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {RIDGECAST_SERVER, "edits"});
  return runProgram(arguments);
}

constexpr const char* kLines = R"({"edit":{"op":"crater","x":0,"z":0,"radius":12,"depth":4},"author":"ann"}
{"edit":{"op":"road","line":[[0,0],[200,50]],"width":6},"time":0}

{"edit":{"op":"undo","edit":1},"number":3}
{"edit":{"op":"smooth","x":3,"z":4,"radius":8,"material":"sand"},"key":"k"}
)";

class Edits : public testing::Test {
 protected:
  Edits() : log((folder / "a.edits").string()) {
    const auto imported = edits({"import", log, write(kLines), "--terrain", "canyon", "--seed", "7", "--param", "riverLevel=300"});
    EXPECT_EQ(imported.code, 0) << imported.output;
  }
  std::string write(const std::string& lines) {
    std::string file = (folder / "lines").string();
    std::ofstream(file) << lines;
    return file;
  }
  ScratchFolder folder;
  std::string log;
};

TEST_F(Edits, AreListedExportedAndImportedAgain) {
  const auto list = edits({"list", log});
  EXPECT_EQ(list.code, 0);
  EXPECT_THAT(list.output, HasSubstr("ann               crater depth 4.0 radius 12.0 x 0.0 z 0.0 (undone)\n"));
  EXPECT_THAT(list.output, HasSubstr("1970-01-01 00:00:00"));
  const auto lines = edits({"export", log});
  EXPECT_EQ(lines.code, 0);
  const std::string copy = (folder / "copy.edits").string();
  EXPECT_EQ(edits({"import", copy, write(lines.output), "--terrain", "canyon", "--seed", "7", "--param", "riverLevel=300"}).code, 0);
  EXPECT_EQ(edits({"export", copy}).output, lines.output);
  EXPECT_EQ(edits({"verify", copy}).output, edits({"verify", log}).output);
}

TEST_F(Edits, CompactedAreTheSameGround) {
  const auto before = edits({"verify", log});
  EXPECT_EQ(before.code, 0);
  EXPECT_THAT(before.output, HasSubstr("4 edits after 0 compacted ones"));
  const std::string copy = (folder / "copy.edits").string();
  EXPECT_EQ(edits({"backup", log, copy}).code, 0);
  EXPECT_EQ(edits({"backup", log, copy}).code, 1);
  EXPECT_THAT(edits({"compact", log}).output, StartsWith("Edits 1 to 4 are a part of the ground now and cannot be undone"));
  const auto after = edits({"verify", log});
  EXPECT_EQ(after.code, 0);
  const auto hash = [](const std::string& output) { return output.substr(output.find("tiles, hash")); };
  EXPECT_EQ(hash(after.output), hash(before.output));
  EXPECT_THAT(edits({"export", log}).output, HasSubstr("do not make the ground alone"));
  EXPECT_EQ(edits({"verify", copy}).output, before.output);
}

TEST_F(Edits, ThatAreForgottenLeaveTheirName) {
  EXPECT_EQ(edits({"forget", log}).code, 0);
  EXPECT_EQ(edits({"forget", log}).code, 2);
  EXPECT_EQ(edits({"import", log, write(kLines)}).code, 0);
  std::ofstream(log) << "damaged";
  EXPECT_EQ(edits({"list", log}).code, 1);
  EXPECT_EQ(edits({"forget", log}).code, 0);
  EXPECT_FALSE(std::filesystem::exists(log));
}

TEST_F(Edits, OfAnotherTerrainAreNotVerified) {
  const auto other = edits({"verify", log, "--terrain", "archipelago"});
  EXPECT_NE(other.code, 0);
}

TEST_F(Edits, ThatAreWrongLeaveNoLog) {
  const std::string file = (folder / "b.edits").string();
  const std::pair<const char*, const char*> wrong[] = {
      {"{}", R"(Line 1: it is not a JSON object with an "edit")"},
      {R"({"edit":{"op":"undo","edit":3}})", "Line 1: There is no edit 3 to undo"},
      {R"({"edit":{"op":"crater","x":0,"z":0,"radius":2,"depth":4},"number":2})", "Line 1: its number is 2, but 1 is next"},
      {R"({"edit":{"op":"crater","x":0,"z":0,"radius":2,"depth":4},"author":2})", R"(Line 1: "author" is not one of)"},
      {"{\"edit\":{\"op\":\"crater\",\"x\":0,\"z\":0,\"radius\":2,\"depth\":4}}\nx", "Line 2: "},
      {"\n \nx", "Line 3: "}};
  for (const auto& [lines, sentence] : wrong) {
    const auto refused = edits({"import", file, write(lines)});
    EXPECT_EQ(refused.code, 1);
    EXPECT_THAT(refused.output, HasSubstr(sentence));
    EXPECT_FALSE(std::filesystem::exists(file));
  }
  EXPECT_EQ(edits({"import", log, write(kLines)}).code, 2);  // it exists
}

// Sessions with such authors would be told by nobody's client.
TEST_F(Edits, OfAuthorsThatNoClientAcceptsAreNotImported) {
  const std::string file = (folder / "b.edits").string();
  const auto line = [](const std::string& field, const std::string& value) {
    return R"({"edit":{"op":"crater","x":0,"z":0,"radius":2,"depth":4},")" + field + R"(":")" + value + "\"}\n";
  };
  for (const char* const field : {"author", "name"}) {
    for (const std::string& value : {std::string(129, 'a'), std::string("a\\nb"), std::string("a\\u007f"), std::string("\\u0000")}) {
      const auto refused = edits({"import", file, write(line(field, "ann") + line(field, value))});
      EXPECT_EQ(refused.code, 1) << value;
      EXPECT_THAT(refused.output, HasSubstr("Line 2: its \"" + std::string(field) + "\" is one that no client accepts"));
      EXPECT_FALSE(std::filesystem::exists(file));
    }
  }
  const std::string fits = line("author", std::string(128, 'a')) + line("name", std::string(128, 'b'));
  EXPECT_EQ(edits({"import", file, write(fits)}).code, 0);
  const auto exported = edits({"export", file}).output;
  EXPECT_THAT(exported, HasSubstr(R"("author":")" + std::string(128, 'a') + R"(","name":"")"));
  EXPECT_THAT(exported, HasSubstr(R"("author":"","name":")" + std::string(128, 'b') + R"(")"));
}

TEST(EditsCommand, SaysWhatItWants) {
  for (const std::vector<std::string>& bad : {std::vector<std::string>{}, {"list"}, {"list", "--quiet"}, {"list", "/nowhere/a.edits"}}) {
    const auto refused = edits(bad);
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.output, StartsWith("ridgecast-server edits: "));
  }
  for (const std::vector<std::string>& asks : {std::vector<std::string>{"--help"}, {"-h"}, {"list", "--help"}}) {
    const auto said = edits(asks);
    EXPECT_EQ(said.code, 0);
    EXPECT_THAT(said.output, StartsWith("Usage: ridgecast-server edits COMMAND FILE"));
  }
}

std::string request(const std::string& line, const std::string& headers = "") {
  return line + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + headers + "\r\n";
}
std::string crater(int x) { return R"({"op":"crater","z":0,"radius":10,"depth":4,"x":)" + std::to_string(x) + "}"; }

// What a server on a folder acknowledges, and must have for ever.
class KeptEdits : public testing::Test {
 protected:
  std::vector<std::string> arguments(std::vector<std::string> more = {}) const {
    more.insert(more.begin(), {"--state", state});
    return more;
  }
  std::string log(const std::string& session) const { return state + "/" + session + ".edits"; }
  static void edit(std::uint16_t port, const std::string& session, int number) {
    EXPECT_THAT(ask(port, "POST /v1/sessions/" + session + "/edits", crater(100 * number)),
                HasSubstr("{\"number\": " + std::to_string(number) + "}"));
  }
  void expectAll(std::uint16_t port, const std::string& session, int last) {
    const std::string all = ask(port, "GET /v1/sessions/" + session + "/edits?limit=1000");
    EXPECT_THAT(all, HasSubstr("{\"last\": " + std::to_string(last) + ","));
    for (int number = 1; number <= last; ++number) {
      EXPECT_THAT(all, HasSubstr("{\"number\": " + std::to_string(number) + ", "));
      EXPECT_THAT(all, HasSubstr("\"x\":" + std::to_string(100 * number) + ".0"));
    }
  }
  ScratchFolder folder;
  const std::string state = (folder / "state").string();
};

// A session that has no log yet has its name.
TEST_F(KeptEdits, NobodyUsesTheLogOfALivingSession) {
  ServerProcess server(RIDGECAST_SERVER, arguments());
  std::ofstream(folder / "lines") << kLines;
  const std::vector<std::string> import{"import", log("default"), (folder / "lines").string()};
  EXPECT_EQ(edits(import).code, 1);
  edit(server.port(), "default", 1);
  for (const std::vector<std::string>& command : {import,
                                                  {"list", log("default")},
                                                  {"export", log("default")},
                                                  {"verify", log("default")},
                                                  {"compact", log("default")},
                                                  {"forget", log("default")},
                                                  {"backup", log("default"), (folder / "copy").string()}}) {
    const auto refused = edits(command);
    EXPECT_EQ(refused.code, 1) << command[0];
    EXPECT_THAT(refused.output, HasSubstr("in use by another program; stop the server that has it")) << command[0];
  }
  EXPECT_EQ(edits({"import", log("other"), (folder / "lines").string()}).code, 0) << "nobody is there";
  EXPECT_THAT(ask(server.port(), "GET /v1/heights?at=5,5&session=other"), HasSubstr(" 200 "));
  EXPECT_THAT(ask(server.port(), "GET /v1/sessions/other/edits"), HasSubstr("{\"last\": 4,"));
}

// What a backup has is what had been acknowledged when it was asked for, and perhaps the edits that came meanwhile: each whole, in order.
TEST_F(KeptEdits, ABackupOfALivingSessionCanBeRestored) {
  const auto fileOf = [](const std::string& answer) { return answer.substr(std::min(answer.size(), answer.find("\r\n\r\n") + 4)); };
  const std::string other = (folder / "other").string(), restored = other + "/default.edits";
  std::filesystem::create_directory(other);
  std::string original;
  int before = 0, after = 0;
  {
    ServerProcess server(RIDGECAST_SERVER, arguments());
    EXPECT_THAT(ask(server.port(), "GET /v1/sessions/default/backup"), HasSubstr("This session has no edits yet."));
    EXPECT_THAT(ask(server.port(), "GET /v1/sessions/none/backup"), StartsWith("HTTP/1.1 404"));
    EXPECT_THAT(ask(server.port(), "POST /v1/sessions/default/backup", "{}"), StartsWith("HTTP/1.1 405"));
    std::atomic<int> made{0};
    std::jthread editor([&](const std::stop_token& stop) {
      while (!stop.stop_requested()) edit(server.port(), "default", made + 1), ++made;
    });
    EXPECT_TRUE(await([&] { return made >= 20; }));
    before = made;
    const std::string answer = ask(server.port(), "GET /v1/sessions/default/backup");
    after = made + 1;
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
    EXPECT_THAT(answer, HasSubstr("filename=\"default.edits\""));
    std::ofstream(restored, std::ios::binary) << fileOf(answer);
    EXPECT_TRUE(await([&] { return made >= after + 5; })) << "edits go on";
    editor.request_stop();
    editor.join();
    EXPECT_THAT(edits({"backup", log("default"), (folder / "copy").string()}).output,
                HasSubstr("Or ask that server for the copy: GET /v1/sessions/SESSION/backup."));
    EXPECT_EQ(server.stop(), 0);
  }
  const auto verified = edits({"verify", restored});
  EXPECT_EQ(verified.code, 0) << verified.output;
  const std::string all = edits({"export", log("default")}).output, copy = edits({"export", restored}).output;
  const auto lines = std::ranges::count(copy, '\n');
  EXPECT_GE(lines, before);
  EXPECT_LE(lines, after);
  EXPECT_EQ(copy, all.substr(0, copy.size())) << "the same edits";
  // A server goes on with it, on the same ground.
  ServerProcess server(RIDGECAST_SERVER, {"--state", other});
  const auto last = static_cast<int>(lines);
  expectAll(server.port(), "default", last);
  edit(server.port(), "default", last + 1);
  ServerProcess first(RIDGECAST_SERVER, arguments());
  for (const int number : {1, last, last + 1}) {
    const std::string height = "GET /v1/heights?at=" + std::to_string(100 * number + 3) + ",2";
    EXPECT_EQ(fileOf(ask(server.port(), height)), fileOf(ask(first.port(), height))) << number;
  }
}

TEST_F(KeptEdits, ASlowOneIsNotAcknowledgedInASessionThatHasEnded) {
  const auto isThere = [](std::uint16_t port) { return ask(port, "GET /v1/sessions").find("\"site\"") != std::string::npos; };
  for (const bool isKept : {true, false})
    for (const bool isRemoved : {true, false}) {
      const std::vector<std::string> idle{"--session-idle", isRemoved ? "300" : "1"};
      ServerProcess server(RIDGECAST_SERVER, isKept ? arguments(idle) : idle);
      const std::uint16_t port = server.port();
      const std::string world = "session=site&terrain=canyon&seed=" + std::to_string(isRemoved ? 7 : 8);
      if (isKept) std::filesystem::remove(log("site"));
      ASSERT_THAT(ask(port, "GET /v1/heights?at=5,5&" + world), HasSubstr(" 200 "));
      SocketClient slow(port);
      const std::string body = crater(100);
      slow.send(request("POST /v1/sessions/site/edits", "Content-Type: application/json\r\nExpect: 100-continue\r\nContent-Length: " +
                                                            std::to_string(body.size()) + "\r\n"));
      ASSERT_THAT(slow.answer(false), HasSubstr(" 100 "));  // the session was found
      if (isRemoved) {
        ASSERT_THAT(ask(port, "DELETE /v1/sessions/site"), HasSubstr(" 200 "));
      }
      ASSERT_TRUE(await([&] { return !isThere(port); }));
      slow.send(body);
      const std::string answer = slow.answer();
      EXPECT_THAT(answer, HasSubstr(" 404 "));
      EXPECT_THAT(answer, HasSubstr("The session has ended"));
      SocketClient member(port);
      ASSERT_TRUE(member.upgrade("/v1/stream?" + world)) << member.refusal();
      edit(port, "site", 1);
      edit(port, "site", 2);
      expectAll(port, "site", 2);
    }
}

TEST_F(KeptEdits, OfferNoPaths) {
  ServerProcess server(RIDGECAST_SERVER, arguments());
  edit(server.port(), "default", 1);
  std::ofstream(log("torn")) << "no log";
  std::filesystem::create_directory(log("odd"));
  for (const char* session : {"torn", "odd"}) {
    const std::string answer = ask(server.port(), std::string("GET /v1/heights?at=5,5&session=") + session);
    EXPECT_THAT(answer, HasSubstr(" 503 "));
    EXPECT_THAT(answer, testing::Not(HasSubstr(state)));
    EXPECT_THAT(server.process().output(), HasSubstr(state)) << "its log says where";
  }
}

TEST_F(KeptEdits, AFolderThatCannotBeWrittenIsSaidAtTheStart) {
  const auto refused = runProgram({RIDGECAST_SERVER, "--port", "0", "--state", "/proc"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.output, HasSubstr("--state '/proc' cannot be written: "));
}

}  // namespace
}  // namespace ridgecast
