// `ridgecast-client evaluate` from its beginning to its end, shrunken: one terrain, small pictures, a second of each flight, killed in
// the middle and gone on from there.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/render/context.h"
#include "tests/support/process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using Json = nlohmann::json;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

std::vector<std::string> command(const std::filesystem::path& out, const std::string& size = "64x48") {
  return {RIDGECAST_CLIENT, "evaluate", "--quick", "--terrains", "archipelago", "--size", size, "--seconds", "1", "--out", out.string()};
}

// The cells of each line of a table without line breaks or quotes inside its cells.
std::vector<std::vector<std::string>> cellsOf(const std::filesystem::path& file) {
  std::vector<std::vector<std::string>> out;
  std::istringstream lines(readText(file));
  for (std::string line; std::getline(lines, line);) {
    if (line.ends_with('\r')) line.pop_back();
    out.emplace_back();
    std::string cell;
    bool quoted = false;
    for (const char c : line + ",")
      if (c == '"')
        quoted = !quoted;
      else if (c == ',' && !quoted)
        out.back().push_back(std::exchange(cell, {}));
      else
        cell += c;
  }
  return out;
}

class Evaluate : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (auto context = render::HeadlessContext::create(); !context) {
      noGraphics_ = context.error().message;
      return;
    }
    folder_ = std::make_unique<ScratchFolder>();
    Process first(command(out()));
    const std::filesystem::path early = out() / "views/archipelago-low/view.json";
    await([&] { return !first.running() || std::filesystem::exists(early); }, 5 * kTimeout);
    killedInTheMiddle_ = first.running();
    first.signal(SIGKILL);
    first.wait(kTimeout);
    early_ = readText(early);
    auto report = command(out());
    report.push_back("--report");
    ofWhatIsThere_ = runProgram(report);
    earlyReport_ = readText(out() / "report.md");
    second_ = runProgram(command(out()));
  }
  static void TearDownTestSuite() { folder_.reset(); }
  void SetUp() override {
    if (!noGraphics_.empty()) GTEST_SKIP() << noGraphics_;
    ASSERT_EQ(second_.code, 0) << second_.output;
  }
  static std::filesystem::path out() { return *folder_ / "out"; }

  static inline std::unique_ptr<ScratchFolder> folder_;
  static inline std::string noGraphics_, early_, earlyReport_;
  static inline Finished ofWhatIsThere_;
  static inline bool killedInTheMiddle_ = false;
  static inline Finished second_;
};

TEST_F(Evaluate, GoesOnWhereItWasKilled) {
  EXPECT_TRUE(killedInTheMiddle_);
  ASSERT_FALSE(early_.empty());
  EXPECT_EQ(readText(out() / "views/archipelago-low/view.json"), early_);  // not measured again
  // And once all is there, nothing is: only the report is written.
  const auto again = runProgram(command(out()));
  EXPECT_EQ(again.code, 0) << again.output;
  EXPECT_THAT(again.output, Not(HasSubstr("flying")));
}

TEST_F(Evaluate, ReportsWhatIsThereInTheMiddle) {
  EXPECT_EQ(ofWhatIsThere_.code, 0) << ofWhatIsThere_.output;
  EXPECT_THAT(ofWhatIsThere_.output, Not(HasSubstr("flying")));
  EXPECT_THAT(earlyReport_, ContainsRegex(" of its [0-9]+ parts"));
  EXPECT_THAT(earlyReport_, HasSubstr("archipelago low"));
  EXPECT_THAT(earlyReport_, Not(HasSubstr("archipelago grazing")));
  EXPECT_THAT(readText(out() / "report.md"), Not(ContainsRegex(" of its [0-9]+ parts")));
}

TEST_F(Evaluate, RefusesAFolderOfOtherOptions) {
  const auto other = runProgram(command(out(), "128x64"));
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.output, HasSubstr("choose another --out"));
}

TEST_F(Evaluate, RefusesRefinementsThatAreNone) {
  auto wrong = command(*folder_ / "wrong");
  wrong.insert(wrong.end(), {"--refined", "pixels:1,area"});
  const auto refused = runProgram(wrong);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.output, HasSubstr("'area' is not METRIC:THRESHOLD"));
}

// Each place is ray-marched once, whatever flies there.
TEST_F(Evaluate, FlightsShareTheirRayMarches) {
  std::set<std::string> times, marches;
  std::size_t flights = 0;
  for (const auto& entry : std::filesystem::directory_iterator(out() / "flights")) {
    const Json summary = Json::parse(readText(entry.path() / "summary.json"));
    if (summary.at("frames") == 0) continue;
    ++flights;
    EXPECT_EQ(summary.at("frames_names").size(), summary.at("frames").get<std::size_t>());
    times.insert(summary.at("raymarch_frame_ms").dump());
    marches.insert(readText(entry.path() / "settled-raymarch.png"));
  }
  EXPECT_EQ(flights, 3u);
  EXPECT_EQ(times.size(), 1u);
  EXPECT_EQ(marches.size(), 1u);
}

TEST_F(Evaluate, EveryTableIsThereWithItsFigures) {
  for (const auto& [name, rows] : std::vector<std::pair<std::string, std::size_t>>{{"likeness", 6},
                                                                                   {"missing", 6},
                                                                                   {"speed", 6},
                                                                                   {"corrected", 6},
                                                                                   {"steps", 6},
                                                                                   {"flights", 3},
                                                                                   {"rates", 3},
                                                                                   {"stages", 3},
                                                                                   {"stream", 3},
                                                                                   {"frames", 1},
                                                                                   {"popping", 1},
                                                                                   {"targets", 6},
                                                                                   {"runs", 5}}) {
    const auto cells = cellsOf(out() / (name + ".csv"));
    ASSERT_GT(cells.size(), rows) << name;
    for (const auto& row : cells) {
      EXPECT_EQ(row.size(), cells.front().size()) << name;
      EXPECT_FALSE(row.front().empty()) << name;
    }
  }
  const std::string document = readText(out() / "report.md");
  for (const char* title :
       {"Required and measured", "Likeness of the settled mesh", "Sources of error", "faster by", "The mesh corrected along each ray",
        "Along the flights", "Time of each stage", "The stream", "because of uploads", "Popping"})
    EXPECT_THAT(document, HasSubstr(title));
}

TEST_F(Evaluate, StatesTheMeshAsItIsAndCorrectedSideBySide) {
  for (const auto& [name, columns] : std::vector<std::pair<std::string, std::vector<std::pair<std::string, std::string>>>>{
           {"likeness",
            {{"filtered, 1x1: mesh", "filtered, 1x1: corrected"},
             {"filtered, 2x2: mesh", "filtered, 2x2: corrected"},
             {"unfiltered, 1x1: mesh", "unfiltered, 1x1: corrected"},
             {"unfiltered, 2x2: mesh", "unfiltered, 2x2: corrected"}}},
           {"corrected", {{"SSIM mesh", "SSIM corrected"}}},
           {"flights", {{"SSIM mean", "corrected"}, {"settled", "settled, corrected"}}}}) {
    const auto cells = cellsOf(out() / (name + ".csv"));
    for (const auto& [plain, corrected] : columns) {
      const auto at = static_cast<std::size_t>(std::ranges::find(cells[0], plain) - cells[0].begin());
      const auto beside = static_cast<std::size_t>(std::ranges::find(cells[0], corrected) - cells[0].begin());
      ASSERT_LT(std::max(at, beside), cells[0].size()) << name << ": " << plain << ", " << corrected;
      double gain = 0;
      for (std::size_t row = 1; row < cells.size(); ++row) {
        const double is = std::stod(cells[row][at]), becomes = std::stod(cells[row][beside]);
        EXPECT_GT(is, 0.3) << name << ", " << plain;
        EXPECT_GT(becomes, is - 0.01) << name << ", " << corrected;
        gain += becomes - is;
      }
      EXPECT_GT(gain, 0) << name << ", " << corrected;
    }
  }
}

TEST_F(Evaluate, ViewsSayWhatTheyShould) {
  for (const char* name : {"low", "overview", "grazing"}) {
    const Json view = Json::parse(readText(out() / "views" / ("archipelago-" + std::string(name)) / "view.json"));
    ASSERT_EQ(view.at("meshes").size(), 2u);
    EXPECT_GT(view.at("marcher").at("ssim").get<double>(), 0.98);
    for (const Json& mesh : view.at("meshes")) {
      EXPECT_EQ(mesh.at("settled"), true);
      EXPECT_LE(mesh.at("triangles").get<std::uint64_t>(), 500'000u);
      ASSERT_EQ(mesh.at("pictures").size(), 4u);  // 1 x 1 and 2 x 2, with and without filter
      for (const Json& picture : mesh.at("pictures")) {
        EXPECT_GT(picture.at("mesh").at("ssim").get<double>(), 0.5);
        EXPECT_LE(picture.at("mesh").at("ssim").get<double>(), 1);
        EXPECT_GE(picture.at("corrected").at("ssim").get<double>(), picture.at("mesh").at("ssim").get<double>() - 0.01);
      }
      for (const char* what : {"mesh", "corrected", "march"})
        for (const char* time : {"_ms", "_cpu_ms"})
          EXPECT_GT(mesh.at("times").at(std::string(what) + time).at(0).get<double>(), 0) << what << time;
      const Json& missing = mesh.at("missing");
      double sum = 0;
      for (const char* part : {"silhouettes", "geometry", "shading", "marcher"}) sum += missing.at(part).get<double>();
      EXPECT_NEAR(sum, missing.at("total").get<double>(), 1e-9);
      EXPECT_NEAR(missing.at("total").get<double>(), 1 - mesh.at("pictures")[0].at("mesh").at("ssim").get<double>(), 1e-9);
      EXPECT_LT(mesh.at("pixel_error_corrected").at("median"), mesh.at("pixel_error").at("median"));
    }
    EXPECT_GT(view.at("meshes")[1].at("pictures")[2].at("mesh").at("ssim"), view.at("meshes")[0].at("pictures")[2].at("mesh").at("ssim"))
        << "more triangles";
  }
}

TEST_F(Evaluate, ThePageOpensWithoutANetwork) {
  const std::string page = readText(out() / "report.html");
  EXPECT_TRUE(page.starts_with("<!doctype html>"));
  EXPECT_TRUE(page.ends_with("</html>\n"));
  std::size_t pictures = 0, plots = 0;
  for (std::size_t at = 0; (at = page.find("<img", at)) != std::string::npos; ++at) {
    const std::size_t source = page.find(" src=", at);
    const bool isPlot = page.compare(source, 32, " src=\"data:image/svg+xml;base64,") == 0;
    EXPECT_TRUE(isPlot || page.compare(source, 29, " src=\"data:image/jpeg;base64,") == 0) << page.substr(at, 100);
    ++(isPlot ? plots : pictures);
  }
  EXPECT_GE(pictures, 12u + 6u);
  EXPECT_EQ(plots, 5u);
  for (const char* outside : {"<script", "<link", "@import", "url(", "href=", "http"}) EXPECT_THAT(page, Not(HasSubstr(outside)));
  for (const char* plot : {"triangles.svg", "bytes.svg", "stages.svg", "likeness-along.svg", "popping.svg"}) {
    const std::string svg = readText(out() / plot);
    EXPECT_TRUE(svg.starts_with("<svg") && svg.ends_with("</svg>\n")) << plot;
    EXPECT_THAT(svg, HasSubstr("<path")) << plot;
    EXPECT_THAT(svg, Not(HasSubstr("nan"))) << plot;
    EXPECT_THAT(page, HasSubstr(plot)) << plot;
  }
}

}  // namespace
}  // namespace ridgecast
