#include "server/config/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/process.h"

namespace ridgecast::config {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct Result {
  std::optional<Config> config;
  int status;
  std::string out, err;
};

class ConfigTest : public testing::Test {
 protected:
  Result run(std::vector<std::string> arguments, const std::vector<std::string>& environment = {}) {
    arguments.insert(arguments.begin(), "ridgecast-server");
    std::vector<const char*> argv, variables;
    for (const std::string& a : arguments) argv.push_back(a.c_str());
    for (const std::string& e : environment) variables.push_back(e.c_str());
    variables.push_back(nullptr);
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    Parsed parsed = parse(static_cast<int>(argv.size()), argv.data(), variables.data());
    Result result{std::move(parsed.config), parsed.status, testing::internal::GetCapturedStdout(), testing::internal::GetCapturedStderr()};
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), result.status == 2 ? 1 : 0) << result.err;
    return result;
  }
  std::string file(const std::string& text) {
    const auto path = folder / ("settings" + std::to_string(++files) + ".toml");
    std::ofstream(path) << text;
    return path.string();
  }
  testing_support::ScratchFolder folder;
  int files = 0;
};

TEST_F(ConfigTest, FlagBeforeEnvironmentBeforeFileBeforeDefault) {
  const std::string toml =
      file("max-cameras = 11\nport = 1234\nlog-format = \"json\"\nprivate-terrain = true\ntrusted-proxy = [\"10.0.0.0/8\", \"::1\"]\n");
  struct Case {
    std::vector<std::string> flags, environment;
    bool withFile;
    std::uint32_t cameras;
    std::string source;
  };
  const std::uint32_t standard = Config().limits.maxCameras;
  for (const Case& c : {Case{{}, {}, false, standard, "# default"}, Case{{}, {}, true, 11, "# file " + toml + ":1"},
                        Case{{}, {"RIDGECAST_MAX_CAMERAS=12"}, false, 12, "# environment RIDGECAST_MAX_CAMERAS"},
                        Case{{}, {"RIDGECAST_MAX_CAMERAS=12"}, true, 12, "# environment RIDGECAST_MAX_CAMERAS"},
                        Case{{"--max-cameras", "13"}, {}, true, 13, "# flag"},
                        Case{{"--max-cameras=13"}, {"RIDGECAST_MAX_CAMERAS=12"}, true, 13, "# flag"}}) {
    std::vector<std::string> flags = c.flags;
    if (c.withFile) flags.insert(flags.end(), {"--config", toml});
    const Result result = run(flags, c.environment);
    ASSERT_TRUE(result.config) << result.err;
    EXPECT_EQ(result.config->limits.maxCameras, c.cameras);
    if (c.withFile) {
      EXPECT_EQ(result.config->net.port, 1234);
      EXPECT_EQ(result.config->logFormat, logging::Format::kJson);
      EXPECT_FALSE(result.config->limits.sendsTerrain);
      EXPECT_EQ(result.config->net.trustedProxies.size(), 2u);
    }
    flags.push_back("--print-config");
    const Result printed = run(flags, c.environment);
    EXPECT_EQ(printed.status, 0);
    EXPECT_FALSE(printed.config);
    const auto at = printed.out.find("max-cameras = " + std::to_string(c.cameras) + " ");
    ASSERT_NE(at, std::string::npos) << printed.out;
    EXPECT_THAT(printed.out.substr(at, printed.out.find('\n', at) - at), HasSubstr(c.source));
  }
}

TEST_F(ConfigTest, AnOldNameStillWorksEverywhereButIsNotShown) {
  const auto timeoutOf = [](const Result& result) { return result.config.value().net.timeout; };
  EXPECT_EQ(timeoutOf(run({"--patience", "3"}, {})), std::chrono::seconds(3));
  EXPECT_EQ(timeoutOf(run({}, {"RIDGECAST_PATIENCE=3"})), std::chrono::seconds(3));
  EXPECT_EQ(timeoutOf(run({"--config", file("patience = 3")}, {})), std::chrono::seconds(3));
  EXPECT_EQ(timeoutOf(run({"--timeout", "4", "--config", file("patience = 3")}, {"RIDGECAST_PATIENCE=2"})), std::chrono::seconds(4));
  EXPECT_THAT(run({"--patience", "3", "--print-config"}, {}).out, HasSubstr("\ntimeout = 3 "));
  const std::string help = run({"--help"}, {}).out;
  EXPECT_THAT(help, testing::AllOf(HasSubstr("--timeout"), HasSubstr("-h,--help"), testing::Not(HasSubstr("patience"))));
}

TEST_F(ConfigTest, TheFileMayBeNamedByTheEnvironment) {
  const Result result = run({}, {"RIDGECAST_CONFIG=" + file("seed = 7"), "HOME=/x", "RIDGECASTLE=1"});
  ASSERT_TRUE(result.config) << result.err;
  EXPECT_EQ(result.config->terrain.seed, 7u);
}

TEST_F(ConfigTest, WhatIsPrintedIsASettingsFileThatMeansTheSame) {
  const Result first = run({"--print-config", "--terrain", "canyon", "--param", "width=3", "--param", "depth=2", "--allow-insecure",
                            "--allow-origin", "https://a\"b"});
  EXPECT_THAT(first.out, AllOf(HasSubstr("param = [\"width=3\", \"depth=2\"]"), HasSubstr("allow-insecure = true"),
                               HasSubstr("terrain = \"canyon\"")));
  const Result again = run({"--print-config", "--config", file(first.out)});
  EXPECT_EQ(again.status, 0) << again.err;
  const auto withoutSources = [](const std::string& text) {
    std::string out;
    for (std::size_t at = 0; at < text.size();) {
      const auto end = text.find('\n', at);
      out += text.substr(at, text.find("  # ", at) - at) + "\n";
      at = end + 1;
    }
    return out;
  };
  EXPECT_EQ(withoutSources(first.out).find("default"), std::string::npos);
  const Result config = run({"--config", file(first.out)});
  ASSERT_TRUE(config.config) << config.err;
  EXPECT_EQ(config.config->terrain.parameters.size(), 2u);
  EXPECT_TRUE(config.config->net.allowInsecure);
  EXPECT_EQ(config.config->net.allowedOrigins, std::vector<std::string>{"https://a\"b"});
}

TEST_F(ConfigTest, ListsAndFlagsInTheEnvironment) {
  const Result result = run({}, {"RIDGECAST_TRUSTED_PROXY=10.0.0.0/8,192.168.0.0/16", "RIDGECAST_ALLOW_INSECURE=1", "RIDGECAST_QUIET=false",
                                 "RIDGECAST_TERRAIN=a,b", "RIDGECAST_ALLOWED_HOST=terrain.example.org,server-a"});
  ASSERT_TRUE(result.config) << result.err;
  EXPECT_EQ(result.config->net.trustedProxies.size(), 2u);
  EXPECT_EQ(result.config->net.allowedHosts, (std::vector<std::string>{"terrain.example.org", "server-a"}));
  EXPECT_TRUE(result.config->net.allowInsecure);
  EXPECT_EQ(result.config->logLevel, logging::Level::kInfo);
  EXPECT_EQ(result.config->terrain.terrain, "a,b");
}

// A pod of a namespace with Services named ridgecast and ridgecast-admin has these.
TEST_F(ConfigTest, VariablesThatKubernetesSetsForServicesAreIgnored) {
  const std::vector<std::string> services{"RIDGECAST_PORT=tcp://10.96.0.7:7070",
                                          "RIDGECAST_SERVICE_HOST=10.96.0.7",
                                          "RIDGECAST_SERVICE_PORT=7070",
                                          "RIDGECAST_SERVICE_PORT_HTTP_ADMIN=7071",
                                          "RIDGECAST_PORT_7070_TCP=tcp://10.96.0.7:7070",
                                          "RIDGECAST_PORT_7070_TCP_PROTO=tcp",
                                          "RIDGECAST_PORT_7070_TCP_PORT=7070",
                                          "RIDGECAST_PORT_7070_TCP_ADDR=10.96.0.7",
                                          "RIDGECAST_ADMIN_PORT=tcp://10.96.0.8:7071",
                                          "RIDGECAST_ADMIN_SERVICE_HOST=10.96.0.8",
                                          "RIDGECAST_EU_WEST_PORT_53_UDP_ADDR=10.96.0.8"};
  std::vector<std::string> environment = services;
  environment.push_back("RIDGECAST_MAX_CAMERAS=12");
  const Result result = run({}, environment);
  ASSERT_TRUE(result.config) << result.err;
  EXPECT_EQ(result.config->net.port, 7070);
  EXPECT_EQ(result.config->limits.maxCameras, 12u);
  std::vector<std::string> names;
  for (const std::string& service : services) names.push_back(service.substr(0, service.find('=')));
  EXPECT_EQ(result.config->ignoredVariables, names);
}

TEST_F(ConfigTest, SaysWhatIsWrongAndWhere) {
  struct Case {
    std::vector<std::string> flags, environment;
    std::string toml;
    std::vector<std::string> words;
  };
  for (const Case& c : {Case{{"--max-camera", "3"}, {}, "", {"--max-camera"}},
                        Case{{}, {"RIDGECAST_MAX_CAMERA=3"}, "", {"RIDGECAST_MAX_CAMERA", "not a setting"}},
                        Case{{}, {"RIDGECAST_PRINT_CONFIG=1"}, "", {"RIDGECAST_PRINT_CONFIG", "not a setting"}},
                        Case{{}, {"RIDGECAST_PORT=http://10.0.0.1:7070"}, "", {"RIDGECAST_PORT", "http://"}},
                        Case{{}, {"RIDGECAST_MAX_CAMERAS=0"}, "", {"RIDGECAST_MAX_CAMERAS", "not in range"}},
                        Case{{}, {"RIDGECAST_QUIET=perhaps"}, "", {"RIDGECAST_QUIET"}},
                        Case{{}, {"RIDGECAST_TRUSTED_PROXY=10.0.0.1/8"}, "", {"10.0.0.1/8"}},
                        Case{{"--allowed-host", "https://terrain.example.org"}, {}, "", {"https://terrain", "not a host name"}},
                        Case{{}, {}, "max_cameras = 3", {"settings", ":1", "max_cameras", "not a setting"}},
                        Case{{}, {}, "\nconfig = \"x\"", {":2", "config"}}, Case{{}, {}, "max-cameras = 70000", {":1", "not in range"}},
                        Case{{}, {}, "max-cameras = [3, 4]", {":1", "one value"}}, Case{{}, {}, "max-cameras = 3.5", {":1", "max-cameras"}},
                        Case{{}, {}, "[limits]\nmax-cameras = 3", {":1", "section"}}, Case{{}, {}, "seed = 1979-05-27", {":1", "seed"}},
                        Case{{}, {}, "port = 1\nport = 2", {":2"}}, Case{{}, {}, "log-format = \"xml\"", {":1", "xml"}},
                        Case{{}, {}, "= 3", {":1"}}, Case{{"--config", "/no/such/file"}, {}, "", {"/no/such/file"}}}) {
    std::vector<std::string> flags = c.flags;
    if (!c.toml.empty()) flags.insert(flags.end(), {"--config", file(c.toml)});
    const Result result = run(flags, c.environment);
    EXPECT_FALSE(result.config);
    EXPECT_EQ(result.status, 2);
    for (const std::string& word : c.words) EXPECT_THAT(result.err, HasSubstr(word)) << c.toml;
  }
}

TEST_F(ConfigTest, TokensAreIssuedWithoutSecretsOnTheCommandLine) {
  const std::string secret = file(std::string(40, 's')), tokens = (folder / "tokens").string();
  const Result jwt = run({"token", "--jwt-secret-file", secret, "--rights", "view,query", "--session", "a", "--expires", "15m"});
  EXPECT_EQ(jwt.status, 0) << jwt.err;
  EXPECT_EQ(std::count(jwt.out.begin(), jwt.out.end(), '.'), 2);
  const Result first = run({"token", "--token-file", tokens, "--holder", "lab"}),
               second = run({"token", "--token-file", tokens, "--expires", "1d"});
  EXPECT_EQ(first.status, 0) << first.err;
  EXPECT_EQ(second.status, 0);
  EXPECT_NE(first.out, second.out);
  const std::string text = testing_support::readText(tokens);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 2);
  EXPECT_THAT(text,
              AllOf(HasSubstr("lab view * never sha256:"), HasSubstr("anyone view * 2"), testing::Not(HasSubstr(first.out.substr(0, 20)))));
  EXPECT_EQ(std::filesystem::status(tokens).permissions(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  const std::string out = (folder / "out").string();
  std::ofstream(out) << std::string(100, '?');  // readable by others so far
  const Result third = run({"token", "--token-file", tokens, "--out", out});
  EXPECT_EQ(third.status, 0) << third.err;
  EXPECT_EQ(third.out, "");
  EXPECT_EQ(testing_support::readText(out).size(), first.out.size());
  EXPECT_EQ(std::filesystem::status(out).permissions(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  EXPECT_EQ(run({"token", "--token-file", tokens, "--out", "/no/such/folder/out"}).status, 2);
  const std::string after = testing_support::readText(tokens);
  EXPECT_EQ(std::count(after.begin(), after.end(), '\n'), 3) << "a token that nobody got";
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{"token"},
                                             {"token", "--rights", "owner", "--token-file", tokens},
                                             {"token", "--expires", "soon", "--token-file", tokens},
                                             {"token", "--session", "a/b", "--token-file", tokens},
                                             {"token", "--holder", "a b", "--token-file", tokens},
                                             {"token", "--secret", "x"},
                                             {"token", "--jwt-secret-file", secret, "--token-file", tokens},
                                             {"token", "--jwt-secret-file", file("short")},
                                             {"token", "--token-file", "/no/such/folder/file"}})
    EXPECT_EQ(run(wrong).status, 2);
}

// A password is not printed, and a wrong URL is refused before anybody is asked.
TEST_F(ConfigTest, TakesTheEngineOfSeveralServers) {
  EXPECT_EQ(run({}).config->shared.url, "");
  const std::string url = "rediss://me:se%40cret@host/2";
  const Result named = run({"--shared-ca", "ca.pem", "--shared-password-file", "password"}, {"RIDGECAST_SHARED=" + url});
  ASSERT_TRUE(named.config) << named.err;
  EXPECT_EQ(named.config->shared.url, url);
  EXPECT_EQ(named.config->shared.ca, "ca.pem");
  EXPECT_EQ(named.config->shared.passwordFile, "password");
  EXPECT_THAT(run({"--print-config"}, {"RIDGECAST_SHARED=" + url}).out, HasSubstr("shared = \"rediss://me:...@host/2\" "));
  const Result wrong = run({"--shared", "http://me:secret@host"});
  EXPECT_EQ(wrong.status, 2);
  EXPECT_THAT(wrong.err, AllOf(HasSubstr("must be like redis://"), testing::Not(HasSubstr("secret"))));
}

}  // namespace
}  // namespace ridgecast::config
