// What goes wrong in front of a person: each program says in one sentence what was wrong and what would be right, with an exit code that
// scripts can tell apart, and no server is harmed.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::AnyOf;
using testing::HasSubstr;
using testing::Not;

constexpr int kFailed = 1, kWrongInput = 2, kNoGraphics = 3;
const std::string kPath = RIDGECAST_PATHS "/alpine.json";

// The last line is the error: one sentence, led by the program's name, without anything that only a programmer would say.
void expectError(const Finished& f, int code, const std::vector<std::string>& words) {
  ASSERT_TRUE(f.code) << "it did not end: " << f.output;
  EXPECT_EQ(*f.code, code) << f.output;
  for (const std::string& word : words) EXPECT_THAT(f.output, HasSubstr(word));
  EXPECT_THAT(f.output, Not(AnyOf(HasSubstr("terminate called"), HasSubstr("what():"), HasSubstr("Assertion"), HasSubstr("exception"))));
  EXPECT_FALSE(f.output.empty());
}

Finished server(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), RIDGECAST_SERVER);
  return runProgram(arguments);
}
Finished client(std::vector<std::string> arguments, const Environment& environment = {}) {
  arguments.insert(arguments.begin(), RIDGECAST_CLIENT);
  return runProgram(arguments, environment);
}
Finished fly(const std::string& url, const std::string& path, const Environment& environment = {}) {
  ScratchFolder folder;
  return client({"fly", url, "--path", path, "--out", (folder / "out").string(), "--size", "64x48"}, environment);
}

TEST(ServerErrors, WrongArguments) {
  expectError(server({"--terrain", "atlantis"}), kWrongInput, {"ridgecast-server: ", "atlantis", "alpine"});
  expectError(server({"--nonsense"}), kWrongInput, {"ridgecast-server: ", "--nonsense", "--help"});
  expectError(server({"--port", "70000"}), kWrongInput, {"ridgecast-server: ", "70000"});
  expectError(server({"--port", "many"}), kWrongInput, {"ridgecast-server: ", "many"});
  expectError(server({"--port", "-1"}), kWrongInput, {"ridgecast-server: ", "-1"});
  expectError(server({"--threads", "100000"}), kWrongInput, {"ridgecast-server: ", "threads"});
  expectError(server({"--port", "0", "--host", "0.0.0.0"}), kWrongInput, {"ridgecast-server: ", "--allow-insecure"});
  expectError(server({"--port", "0", "--host", "no.such.host.invalid"}), kWrongInput, {"ridgecast-server: ", "no.such.host.invalid"});
  expectError(server({"--port", "0", "--port-file", "/no/such/folder/port"}), kWrongInput, {"ridgecast-server: ", "/no/such/folder/port"});
}

TEST(Server, ChecksATerrain) {
  const std::string tutorial = RIDGECAST_PATHS "/../../../common/terrain/tutorial/dunes.glsl",
                    bad = RIDGECAST_PATHS "/../../../tests/cases/terrain/";
  const Finished dunes = server({"check", tutorial, "--param", "tallest=300"});
  EXPECT_EQ(dunes.code, 0) << dunes.output;
  EXPECT_THAT(dunes.output, HasSubstr("dunes.glsl can be served: "));
  EXPECT_THAT(dunes.output, HasSubstr(" --param tallest = 300 "));
  const Finished alpine = server({"check", "alpine"});
  EXPECT_EQ(alpine.code, 0);
  EXPECT_THAT(alpine.output, testing::ContainsRegex("made of .*grass [0-9.]+ %"));
  expectError(server({"check", bad + "int-for-float.glsl"}), kWrongInput, {"int-for-float.glsl:", "write "});
  expectError(server({"check"}), kWrongInput, {"ridgecast-server check: Say FILE"});
  expectError(server({"check", "/no/such.tif"}), kWrongInput, {"ridgecast-server check: ", "/no/such.tif"});
}

TEST(ServerErrors, PortInUse) {
  ServerProcess first(RIDGECAST_SERVER);
  expectError(server({"--port", std::to_string(first.port())}), kWrongInput,
              {"ridgecast-server: ", std::to_string(first.port()), "in use"});
  EXPECT_TRUE(first.healthy());
}

TEST(Server, SaysWhatThereIsAndEndsOnASignal) {
  const Finished terrains = server({"--list-terrains"});
  EXPECT_EQ(terrains.code, 0);
  EXPECT_TRUE(terrains.output.starts_with("alpine\n    ")) << terrains.output;
  EXPECT_EQ(server({"--version"}).code, 0);
  EXPECT_EQ(server({"--help"}).code, 0);
  EXPECT_EQ(client({"--version"}).code, 0);
  EXPECT_EQ(client({"fly", "--help"}).code, 0);
  ServerProcess running(RIDGECAST_SERVER);
  EXPECT_EQ(running.stop(), 0) << running.process().output();
}

TEST(ClientErrors, NoServerThere) {
  std::string url;
  {
    ServerProcess gone(RIDGECAST_SERVER);
    url = gone.url();
    gone.stop();
  }
  const std::string port = url.substr(url.rfind(':') + 1);
  expectError(fly(url, kPath), kFailed, {"ridgecast-client: ", port, "ridgecast-server"});
  expectError(fly("no.such.host.invalid", kPath), kFailed, {"ridgecast-client: ", "no.such.host.invalid"});
}

TEST(ClientErrors, WrongUrl) {
  ServerProcess running(RIDGECAST_SERVER);
  expectError(fly("127.0.0.1:99999", kPath), kWrongInput, {"ridgecast-client: ", "99999"});
  expectError(fly("ftp://127.0.0.1", kPath), kWrongInput, {"ridgecast-client: ", "ftp"});
  expectError(fly(running.url() + "/?session=atlantis", kPath), kFailed, {"ridgecast-client: ", "atlantis"});
  EXPECT_TRUE(running.healthy());
}

TEST(ClientErrors, PathFiles) {
  ServerProcess running(RIDGECAST_SERVER);
  ScratchFolder folder;
  std::ofstream(folder / "path.json") << R"({"keyframes": []})";
  expectError(fly(running.url(), folder / "none.json"), kWrongInput, {"ridgecast-client: ", "none.json"});
  expectError(fly(running.url(), folder / "path.json"), kWrongInput, {"ridgecast-client: ", "path.json", "keyframe"});
}

TEST(ClientErrors, WrongArguments) {
  expectError(client({}), kWrongInput, {"view", "fly"});
  expectError(client({"swim"}), kWrongInput, {"swim"});
  expectError(client({"fly"}), kWrongInput, {"--path"});
  expectError(client({"fly", "--path", kPath, "--out", "x", "--nonsense"}), kWrongInput, {"--nonsense"});
  expectError(client({"fly", "--path", kPath, "--out", "x", "--size", "1280"}), kWrongInput, {"--size", "1280x720"});
  expectError(client({"fly", "--path", kPath, "--out", "x", "--rate", "0"}), kWrongInput, {"--rate"});
  expectError(client({"fly", "--path", kPath, "--out", "x", "--rate", "nan"}), kWrongInput, {"--rate"});
  expectError(client({"fly", "--path", kPath, "--out", "x", "--metric", "taste"}), kWrongInput, {"--metric"});
  expectError(client({"fly", "--path", kPath, "--out", "x", "--export-at", "3"}), kWrongInput, {"--export"});
}

TEST(ClientErrors, FoldersThatCannotBe) {
  ServerProcess running(RIDGECAST_SERVER);
  ScratchFolder folder;
  std::ofstream(folder / "file") << "not a folder";
  const std::string out = (folder / "file").string() + "/out";
  expectError(client({"fly", running.url(), "--path", kPath, "--out", out}), kWrongInput, {"ridgecast-client: ", out});
}

TEST(ClientErrors, NoOpenGl) {
  ServerProcess running(RIDGECAST_SERVER);
  // glvnd then finds no driver at all.
  expectError(fly(running.url(), kPath, {{"__EGL_VENDOR_LIBRARY_FILENAMES", "/dev/null"}}), kNoGraphics, {"ridgecast-client: ", "OpenGL"});
  EXPECT_TRUE(running.healthy());
}

TEST(ClientErrors, NoDisplay) {
  ServerProcess running(RIDGECAST_SERVER);
  const ScratchFolder folder;
  const Environment none{{"DISPLAY", {}}, {"WAYLAND_DISPLAY", {}}, {"XDG_CONFIG_HOME", folder / "configuration"}};
  expectError(client({"view", running.url(), "--seconds", "1"}, none), kNoGraphics, {"ridgecast-client: ", "display", "fly"});
  expectError(client({"view", running.url(), "--seconds", "1"}, {{"DISPLAY", ":4711"}, {"WAYLAND_DISPLAY", {}}, none.back()}), kNoGraphics,
              {"ridgecast-client: ", "display"});
  EXPECT_TRUE(running.healthy());
}

}  // namespace
}  // namespace ridgecast
