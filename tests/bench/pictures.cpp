#include "tests/bench/pictures.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "tests/bench/bench.h"

namespace ridgecast::bench {

Pictures::Pictures(const std::string& programFolder, const std::string& terrain, const camera::Camera& camera,
                   const std::vector<std::string>& moreOfServer)
    : client_(programFolder + "/ridgecast-client") {
  if (!std::filesystem::exists(client_)) {
    progress("no ridgecast-client beside this program: nothing is drawn");
    return;
  }
  // A path that stands still.
  nlohmann::json key;
  key["x"] = static_cast<double>(camera.pose.x) * lattice::kMetresPerStep;
  key["z"] = static_cast<double>(camera.pose.z) * lattice::kMetresPerStep;
  key["y"] = camera.pose.y;
  key["yaw"] = camera.pose.yaw * 180 / std::numbers::pi;
  key["pitch"] = camera.pose.pitch * 180 / std::numbers::pi;
  nlohmann::json path{{"terrain", terrain}, {"seed", 1}, {"keyframes", nlohmann::json::array()}};
  for (const double t : {0.0, 0.2}) {
    key["t"] = t;
    path["keyframes"].push_back(key);
  }
  std::ofstream(folder_ / "still.json") << path;
  std::vector<std::string> arguments{"--terrain", terrain};
  arguments.insert(arguments.end(), moreOfServer.begin(), moreOfServer.end());
  server_ = std::make_unique<testing_support::ServerProcess>(programFolder + "/ridgecast-server", arguments);
}

Pictures::Similarity Pictures::settled(const std::string& metric, double threshold) {
  if (!server_) return {NAN, NAN};
  const std::string out = (folder_ / "out").string();
  const std::string command = "'" + client_ + "' fly " + server_->url() + " --path '" + (folder_ / "still.json").string() + "' --out '" +
                              out + "' --metric " + metric + " --threshold " + std::to_string(threshold * 1e9) + "e-9 --budget 2000000 >'" +
                              out + ".log' 2>&1";
  std::ifstream file;
  if (std::system(command.c_str()) == 0) file.open(out + "/summary.json");
  const auto summary = nlohmann::json::parse(file, nullptr, false);
  if (summary.is_discarded() || !summary["ssim_settled"].is_number()) {
    progress("the client drew nothing: see its own words with ridgecast-client fly");
    return {NAN, NAN};
  }
  return {summary["ssim_settled"].get<double>(),
          summary["ssim_settled_terrain"].is_number() ? summary["ssim_settled_terrain"].get<double>() : NAN};
}

}  // namespace ridgecast::bench
