#include "server/recording/paths.h"

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <system_error>

#include "server/recording/reader.h"

namespace ridgecast::recording {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::int64_t kLongest = std::int64_t{24} * 3'600'000'000, kShortest = 1000;  // microseconds

struct Flight {
  unsigned files = 0;
  std::string name;
  std::optional<camera::Pose> last;
  std::int64_t began = 0, at = 0;
  double fov = 0;
  Json keyframes = Json::array();
};

Json keyframeOf(const camera::Pose& pose, double seconds) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  return {{"t", seconds},
          {"x", static_cast<double>(pose.x) * lattice::kMetresPerStep},
          {"z", static_cast<double>(pose.z) * lattice::kMetresPerStep},
          {"y", pose.y},
          {"yaw", pose.yaw * kDegrees},
          {"pitch", pose.pitch * kDegrees}};
}

class Export {
 public:
  Export(World world, std::filesystem::path folder, std::string name)
      : world_(std::move(world)), folder_(std::move(folder)), name_(std::move(name)) {}

  Outcome<void> take(const Iterated& i, std::int64_t time) {
    Flight& f = flights_[i.camera];
    if (f.last == i.view.pose) return {};
    if (!f.keyframes.empty() && (f.keyframes.size() == kMaxKeyframes || time - f.began > kLongest))
      if (auto written = write(i.camera, f); !written) return written.error();
    if (f.keyframes.empty()) f.began = time, f.fov = i.view.projection.verticalFov;
    if (!f.keyframes.empty() && time - f.at < kShortest)
      f.keyframes.back() = keyframeOf(i.view.pose, f.keyframes.back()["t"].get<double>());
    else
      f.keyframes.push_back(keyframeOf(i.view.pose, static_cast<double>(time - f.began) / 1e6)), f.at = time;
    f.last = i.view.pose;
    return {};
  }
  void take(const Joined& joined) { flights_[joined.camera].name = joined.name; }

  Outcome<std::size_t> end() {
    for (auto& [camera, flight] : flights_)
      if (auto written = write(camera, flight); !written) return written.error();
    return files_;
  }

 private:
  Outcome<void> write(std::uint64_t camera, Flight& f) {
    if (f.keyframes.empty()) return {};
    std::string file = name_ + ".camera-" + std::to_string(camera);
    if (++f.files > 1) file += "." + std::to_string(f.files);
    const std::filesystem::path path = folder_ / (file + ".json");
    const Json json{{"name", "camera " + std::to_string(camera) + (f.name.empty() ? "" : ", " + f.name)},
                    {"terrain", world_.terrain},
                    {"seed", world_.seed},
                    {"fov", f.fov * 180 / std::numbers::pi},
                    {"keyframes", std::move(f.keyframes)}};
    f.keyframes = Json::array();
    ++files_;
    std::ofstream out(path, std::ios::binary);
    out << json.dump(-1, ' ', false, Json::error_handler_t::replace) << "\n";
    if (!out.flush()) return Error{"Cannot write '" + path.string() + "'."};
    return {};
  }

  const World world_;
  const std::filesystem::path folder_;
  const std::string name_;
  std::map<std::uint64_t, Flight> flights_;
  std::size_t files_ = 0;
};

}  // namespace

Outcome<Exported> exportPaths(const std::vector<Parts>& recordings, const std::filesystem::path& folder, const Span& span) {
  auto reader = openRecords(recordings);
  if (!reader) return reader.error();
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) return Error{"Cannot make the folder '" + folder.string() + "': " + failed.message() + "."};
  const std::filesystem::path& first = recordings.front().front();
  const auto name = nameOf(first);
  Export paths((*reader)->world(), folder, name ? name->first : first.stem().string());
  while (const auto record = (*reader)->next()) {
    const double seconds = static_cast<double>(record->time) / 1e6;
    if (seconds > span.until) break;
    if (const auto* joined = std::get_if<Joined>(&record->event)) paths.take(*joined);
    const auto* iterated = std::get_if<Iterated>(&record->event);
    if (!iterated || seconds < span.from) continue;
    if (auto taken = paths.take(*iterated, record->time); !taken) return taken.error();
  }
  const auto files = paths.end();
  if (!files) return files.error();
  return Exported{*files, (*reader)->damage(), (*reader)->wasCutOff()};
}

}  // namespace ridgecast::recording
