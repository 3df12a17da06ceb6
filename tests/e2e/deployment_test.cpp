// The files by which systemd, containers, Prometheus and Kubernetes run a server, by the programs that read them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using nlohmann::json;
using testing::HasSubstr;

TEST(Deployment, ContainersAndTheUnitLimitMemory) {
  EXPECT_THAT(readText(RIDGECAST_DOCKER "/compose.yaml"), HasSubstr("\n    mem_limit: 4g"));
  EXPECT_THAT(readText(RIDGECAST_DOCKER "/compose.scale.yaml"), HasSubstr("\n  mem_limit: 4g"));
  EXPECT_THAT(readText(RIDGECAST_DOCKER "/systemd/ridgecast-server.service"), HasSubstr("\nMemoryMax=75%\n"));
}

// By the programs that read them, where these are installed.
TEST(Deployment, FilesForSystemdAndPrometheusAreGood) {
  ScratchFolder folder;
  int judged = 0;
  if (programExists("systemd-analyze")) {
    std::string unit = readText(RIDGECAST_DOCKER "/systemd/ridgecast-server.service");
    const std::string installed = "ExecStart=/usr/bin/ridgecast-server";
    const auto at = unit.find(installed + " --config");
    ASSERT_NE(at, std::string::npos);
    unit.replace(at, installed.size(), std::string("ExecStart=") + RIDGECAST_SERVER);  // systemd asks that the program is there
    const std::string file = folder / "ridgecast-server.service";
    std::ofstream(file) << unit;
    const Finished verified = runProgram({"systemd-analyze", "verify", file});
    EXPECT_EQ(verified.code, 0) << verified.output;
    EXPECT_EQ(verified.output.find("ridgecast-server.service"), std::string::npos) << verified.output;  // warnings name it
    ++judged;
  }
  const std::string rules = readText(RIDGECAST_DOCKER "/prometheus/rules.yml"),
                    tests = readText(RIDGECAST_DOCKER "/prometheus/rules_test.yml");
  const std::regex alert("alert: ([A-Za-z]+)");
  for (auto at = std::sregex_iterator(rules.begin(), rules.end(), alert); at != std::sregex_iterator(); ++at)
    EXPECT_THAT(tests, HasSubstr("name: " + (*at)[1].str() + "\n")) << "each alert has a test";
  if (programExists("promtool")) {
    for (const std::vector<std::string>& check : {std::vector<std::string>{"config", RIDGECAST_DOCKER "/prometheus/prometheus.yml"},
                                                  {"rules", RIDGECAST_DOCKER "/prometheus/rules.yml"},
                                                  {"rules", RIDGECAST_DOCKER "/prometheus/rules_test.yml"}}) {
      std::vector<std::string> command{"promtool", check[1].ends_with("_test.yml") ? "test" : "check"};
      command.insert(command.end(), check.begin(), check.end());
      const Finished checked = runProgram(command);
      EXPECT_EQ(checked.code, 0) << checked.output;
    }
    ++judged;
  }
  const Finished settings = runProgram({RIDGECAST_SERVER, "--config", RIDGECAST_DOCKER "/systemd/server.toml", "--print-config"});
  EXPECT_EQ(settings.code, 0) << settings.output;
  EXPECT_THAT(settings.output, HasSubstr("log-format = \"json\""));
  if (judged < 2) GTEST_SKIP() << "systemd-analyze or promtool (package prometheus) is not installed: " << judged << " of 2 judged";
}

// What kills a server waits for as long as it may take.
TEST(Deployment, WhoeverStopsAServerWaitsForIt) {
  constexpr int kAfterDrain = 15;  // as server/README.md says
  ASSERT_THAT(readText(RIDGECAST_DOCKER "/../server/README.md"),
              HasSubstr("`drain-delay` + `drain` + " + std::to_string(kAfterDrain) + " s"));
  const auto numberIn = [](const std::string& text, const std::string& before) {
    std::smatch found;
    return std::regex_search(text, found, std::regex(before + "\\s*\"?([0-9]+)")) ? std::stoi(found[1]) : -1;
  };
  // By the settings that the program has there.
  const auto needs = [&](const std::vector<std::string>& arguments, const Environment& environment) {
    std::vector<std::string> command{RIDGECAST_SERVER, "--print-config"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const Finished settings = runProgram(command, environment);
    EXPECT_EQ(settings.code, 0) << settings.output;
    const int delay = numberIn(settings.output, "\ndrain-delay ="), drain = numberIn(settings.output, "\ndrain =");
    EXPECT_GE(delay, 0) << settings.output;
    EXPECT_GT(drain, 0) << settings.output;
    return delay + drain + kAfterDrain;
  };
  EXPECT_GE(numberIn(readText(RIDGECAST_DOCKER "/systemd/ridgecast-server.service"), "\nTimeoutStopSec="),
            needs({"--config", RIDGECAST_DOCKER "/systemd/server.toml"}, {}));
  const std::string pods = readText(RIDGECAST_DOCKER "/kubernetes/server.yaml");
  Environment drains;
  for (const char* name : {"RIDGECAST_DRAIN_DELAY", "RIDGECAST_DRAIN"})
    drains.emplace_back(name, std::to_string(numberIn(pods, std::string("name: ") + name + ", value:")));
  EXPECT_GE(numberIn(pods, "terminationGracePeriodSeconds:"), needs({}, drains));
  for (const char* file : {"/compose.yaml", "/compose.scale.yaml"}) {
    const std::string compose = readText(std::string(RIDGECAST_DOCKER) + file);
    Environment said;
    if (const int delay = numberIn(compose, "RIDGECAST_DRAIN_DELAY:"); delay >= 0)
      said.emplace_back("RIDGECAST_DRAIN_DELAY", std::to_string(delay));
    EXPECT_EQ(compose.find("RIDGECAST_DRAIN:"), compose.npos) << "of which this test knows nothing";
    EXPECT_GE(numberIn(compose, "stop_grace_period:"), needs({}, said)) << file;
  }
}

// By the types of the Kubernetes API, by the server whose settings they give, and by Prometheus, whose queries the autoscaler needs.
TEST(Deployment, FilesForKubernetesAreGood) {
  if (!std::getenv("TESTS_NODE_TOOLS") || !programExists("node")) GTEST_SKIP() << "no node, or TESTS_NODE_TOOLS names no folder";
  const Finished judged = runProgram({"node", RIDGECAST_TOOLS "/validate-kubernetes.mjs", RIDGECAST_DOCKER "/kubernetes"});
  ASSERT_EQ(judged.code, 0) << judged.output;
  const json said = json::parse(judged.output);
  Environment environment;
  for (const auto& [name, value] : said["environment"].items()) environment.emplace_back(name, value.get<std::string>());
  const Finished settings = runProgram({RIDGECAST_SERVER, "--print-config"}, environment);
  EXPECT_EQ(settings.code, 0) << settings.output;
  const int delay = std::stoi(said["environment"]["RIDGECAST_DRAIN_DELAY"].get<std::string>()),
            drain = std::stoi(said["environment"]["RIDGECAST_DRAIN"].get<std::string>());
  EXPECT_GE(delay, 5);  // what kube-proxy may need
  EXPECT_GT(said["grace"], delay + drain);
  // Redis has the settings of its file, and a password in place of the user.
  const auto& arguments = said["redis"];
  std::istringstream file(readText(RIDGECAST_DOCKER "/redis.conf"));
  std::size_t at = 0;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#' || line.starts_with("bind ") || line.starts_with("port ") || line.starts_with("user ")) continue;
    const auto space = line.find(' ');
    const std::string value = line.substr(space + 1);
    ASSERT_LT(at + 1, arguments.size()) << line;
    EXPECT_EQ(arguments[at++], "--" + line.substr(0, space));
    EXPECT_EQ(arguments[at++], value == "\"\"" ? "" : value);
  }
  EXPECT_EQ(arguments[at], "--requirepass");
  EXPECT_EQ(arguments.size(), at + 2);
  if (!programExists("promtool")) GTEST_SKIP() << "promtool (package prometheus) is not installed";
  ScratchFolder folder;
  std::ofstream(folder / "queries.yml") << R"(tests:
  - interval: 1m
    input_series:
      - { series: 'ridgecast_delivery_seconds_bucket{namespace="ridgecast",pod="a",le="0.25"}', values: 0+3240x10 }
      - { series: 'ridgecast_delivery_seconds_bucket{namespace="ridgecast",pod="a",le="0.5"}', values: 0+3600x10 }
      - { series: 'ridgecast_delivery_seconds_bucket{namespace="ridgecast",pod="a",le="+Inf"}', values: 0+3600x10 }
      - { series: 'ridgecast_saturation{namespace="ridgecast",pod="a"}', values: 0.5x8 0.75 0.5 }
    promql_expr_test:
      - { eval_time: 9m, exp_samples: [{ labels: '{pod="a"}', value: 0.375 }], expr: )"
                                        << said["queries"][0] << R"( }
      - { eval_time: 9m, exp_samples: [{ labels: '{pod="a"}', value: 0.75 }], expr: )"
                                        << said["queries"][1] << " }\n";
  const Finished queried = runProgram({"promtool", "test", "rules", folder / "queries.yml"});
  EXPECT_EQ(queried.code, 0) << queried.output;
}

}  // namespace
}  // namespace ridgecast
