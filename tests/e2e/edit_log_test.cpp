// `ridgecast-server edits` as people run it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "tests/support/process.h"

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

}  // namespace
}  // namespace ridgecast
