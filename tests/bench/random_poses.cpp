#include "tests/bench/random_poses.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <numbers>
#include <random>
#include <stdexcept>
#include <thread>

#include "common/process/scratch.h"
#include "common/terrain/raster.h"
#include "common/user_terrain/catalogue.h"
#include "server/pipeline/pipeline.h"
#include "tests/support/flight.h"
#include "tests/support/rays.h"

namespace ridgecast::bench {
namespace {

struct Wanted {
  std::size_t poses = 200;
  std::uint64_t seed = 1;
  std::string terrain = "alpine";
  raster::RasterOptions raster;
  double lowest = 1.5, highest = 3000;  // metres above the ground
  double threshold = 1;
  double speed = 0;  // metres a second; 0: at rest
  std::filesystem::path out;
  std::size_t only = SIZE_MAX;  // one pose, by number
};

template <class Number>
Number number(const std::string& name, const std::string& value) {
  Number n{};
  const auto [end, wrong] = std::from_chars(value.data(), value.data() + value.size(), n);
  if (wrong != std::errc() || end != value.data() + value.size() || !std::isfinite(static_cast<double>(n)))
    throw std::runtime_error(name + " takes a " + (std::is_integral_v<Number> ? "whole number" : "number") + ", not '" + value + "'");
  return n;
}

Wanted read(const std::vector<std::string>& arguments) {
  Wanted w;
  for (std::size_t k = 0; k < arguments.size(); k += 2) {
    const std::string& name = arguments[k];
    if (k + 1 == arguments.size()) throw std::runtime_error(name + " needs a value");
    const std::string& value = arguments[k + 1];
    if (name == "--poses") {
      w.poses = number<std::size_t>(name, value);
    } else if (name == "--seed") {
      w.seed = number<std::uint64_t>(name, value);
    } else if (name == "--only") {
      w.only = number<std::size_t>(name, value);
    } else if (name == "--terrain") {
      w.terrain = value;
    } else if (name == "--raster") {
      if (const auto added = raster::addRasterOption(value, w.raster); !added) throw std::runtime_error(added.error().message);
    } else if (name == "--altitude") {
      const std::size_t comma = value.find(',');
      if (comma == std::string::npos) throw std::runtime_error("--altitude takes LOW,HIGH in metres");
      w.lowest = number<double>(name, value.substr(0, comma));
      w.highest = number<double>(name, value.substr(comma + 1));
      if (!(w.lowest > 0 && w.highest >= w.lowest)) throw std::runtime_error("--altitude takes 0 < LOW <= HIGH");
    } else if (name == "--threshold") {
      w.threshold = number<double>(name, value);
    } else if (name == "--speed") {
      w.speed = number<double>(name, value);
    } else if (name == "--out") {
      w.out = value;
    } else {
      throw std::runtime_error(
          "error takes --poses, --seed, --terrain, --raster, --altitude, --threshold, --speed and --out, or --edits alone, not " + name);
    }
  }
  if (w.poses == 0) throw std::runtime_error("--poses takes 1 or more");
  return w;
}

// A square of alpine's heights, 513 samples of 4 m, in half metres, raw: what lies beyond is 0, so its edges are walls of a kilometre and
// more.
void writeMap(const std::filesystem::path& file) {
  constexpr int kSamples = 513;
  const auto alpine = terrain::create("alpine", 1).value();
  std::ofstream out(file, std::ios::binary);
  for (int j = 0; j < kSamples; ++j)
    for (int i = 0; i < kSamples; ++i) {
      const auto sample = static_cast<std::uint16_t>(std::clamp(2 * alpine->height({i * 1024, j * 1024}), 0.0, 65535.0));
      out.put(static_cast<char>(sample & 255)).put(static_cast<char>(sample >> 8));
    }
}

std::shared_ptr<const terrain::Terrain> load(const Wanted& wanted, const std::filesystem::path& scratch) {
  user_terrain::Request request;
  request.terrain = wanted.terrain;
  request.raster = wanted.raster;
  request.build.cache = scratch / "cache";
  request.build.prober = "/proc/self/exe";
  request.seed = 7;
  if (wanted.terrain == "dunes") request.terrain = RIDGECAST_TUTORIAL;
  if (wanted.terrain == "terraces") request.terrain = RIDGECAST_TERRACES;
  if (wanted.terrain == "wall") {
    request.terrain = (scratch / "wall.r16").string();
    writeMap(request.terrain);
    for (const char* option : {"pitch=4", "scale=0.5", "edge=0"}) (void)raster::addRasterOption(option, request.raster);
  }
  auto loaded = user_terrain::load(request, nullptr);
  if (!loaded) throw std::runtime_error(loaded.error().message);
  return loaded.value();
}

struct Measured {
  camera::Camera camera;
  testing_support::ScreenError error;  // pixels, for the threshold in force
  std::uint32_t triangles = 0;
  double threshold = 0;  // in force
  bool settled = false;
  double seconds = 0;
};

Measured measure(const std::shared_ptr<const terrain::Terrain>& terrain, camera::Camera camera, const Wanted& wanted) {
  Measured m;
  Clock clock;
  scheduling::Executor executor(1);
  settings::Settings asked;
  asked.metric = settings::Metric::kPixels;
  asked.threshold = wanted.threshold;
  asked.triangleBudget = 2'000'000;
  pipeline::Pipeline pipeline(terrain, pipeline::grant(asked, {}), executor.makePool(1));
  settings::IterationStats figures;
  for (int n = 0; n < 300 && !pipeline.settled(); ++n) figures = pipeline.iterate(camera);
  if (wanted.speed > 0) {
    const double altitude = camera.pose.y - terrain->height({camera.pose.x, camera.pose.z});
    for (int n = 0; n < 30; ++n) {
      const double step = wanted.speed / 10 * lattice::kStepsPerMetre;
      camera.pose.x += std::llround(-std::sin(camera.pose.yaw) * step);
      camera.pose.z += std::llround(-std::cos(camera.pose.yaw) * step);
      camera.pose.y = terrain->height({camera.pose.x, camera.pose.z}) + altitude;
      figures = pipeline.iterate(camera);
    }
  }
  m.camera = camera;
  m.settled = pipeline.settled();
  m.triangles = figures.triangles;
  m.threshold = figures.effectiveThreshold;
  m.seconds = clock.seconds();

  m.error = testing_support::errorOnScreen(pipeline, *terrain, camera, m.threshold, 480);
  return m;
}

std::vector<camera::Camera> randomPoses(const terrain::Terrain& terrain, const Wanted& wanted) {
  std::mt19937_64 random(wanted.seed);
  const auto uniform = [&](double low, double high) { return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53; };
  double reach = 1e6, middleX = 0, middleZ = 0;
  if (const auto* raster = terrain.raster()) {
    const auto& s = raster->shape();
    reach = std::max(s.x.metres() * s.width, s.z.metres() * s.height);
    middleX = static_cast<double>(s.x.origin) * lattice::kMetresPerStep + s.x.metres() * s.width / 2;
    middleZ = static_cast<double>(s.z.origin) * lattice::kMetresPerStep + s.z.metres() * s.height / 2;
  }
  std::vector<camera::Camera> poses;
  constexpr double kDegree = std::numbers::pi / 180;
  for (std::size_t k = 0; k < wanted.poses; ++k) {
    const double x = middleX + uniform(-reach, reach), z = middleZ + uniform(-reach, reach),
                 altitude = std::exp(uniform(std::log(wanted.lowest), std::log(wanted.highest))), yaw = uniform(0, 360),
                 pitch = uniform(-80, 30);
    poses.push_back(testing_support::cameraAt(terrain, x, z, altitude, yaw * kDegree, pitch * kDegree));
  }
  return poses;
}

void writePath(const std::filesystem::path& file, const Wanted& wanted, const camera::Camera& camera) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  std::ofstream out(file);
  char key[256];
  std::snprintf(key, sizeof key, "\"x\": %.6f, \"z\": %.6f, \"y\": %.6f, \"yaw\": %.9f, \"pitch\": %.9f}",
                static_cast<double>(camera.pose.x) / 256, static_cast<double>(camera.pose.z) / 256, camera.pose.y,
                camera.pose.yaw * kDegrees, camera.pose.pitch * kDegrees);
  out << "{\"terrain\": \"" << wanted.terrain << "\", \"seed\": 7, \"keyframes\": [{\"t\": 0, " << key << ", {\"t\": 1, " << key << "]}\n";
}

}  // namespace

Report errorOfRandomPoses(const Options& options) {
  const Wanted wanted = read(options.arguments);
  auto scratch = process::Scratch::create();
  if (!scratch) throw std::runtime_error(scratch.error().message);
  const auto terrain = load(wanted, scratch->path());
  const std::vector<camera::Camera> poses = randomPoses(*terrain, wanted);
  std::vector<Measured> all(poses.size());
  std::atomic<std::size_t> next{0}, done{0};
  std::mutex saying;
  const auto work = [&] {
    for (std::size_t k; (k = next++) < poses.size();) {
      if (wanted.only != SIZE_MAX && k != wanted.only) continue;
      all[k] = measure(terrain, poses[k], wanted);
      const Measured& m = all[k];
      const std::lock_guard lock(saying);
      char line[400];
      std::snprintf(line, sizeof line,
                    "%zu of %zu: pose %zu, %.1f m up, pitch %.0f: p99 %.2f px, max %.2f, jumps %zu of %zu, %u triangles, %.1f s%s; %s",
                    ++done, poses.size(), k, m.camera.pose.y - terrain->height({m.camera.pose.x, m.camera.pose.z}),
                    m.camera.pose.pitch * 180 / std::numbers::pi, m.error.p99, m.error.most, m.error.jumps, m.error.rays, m.triangles,
                    m.seconds, m.settled || wanted.speed > 0 ? "" : ", not settled", m.error.worst.c_str());
      progress(line);
    }
  };
  std::vector<std::thread> threads;
  for (unsigned k = 0; k < std::max(1u, std::thread::hardware_concurrency()); ++k) threads.emplace_back(work);
  for (auto& thread : threads) thread.join();

  if (!wanted.out.empty()) {
    std::filesystem::create_directories(wanted.out);
    std::vector<std::size_t> order(all.size());
    for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
    std::sort(order.begin(), order.end(), [&](std::size_t l, std::size_t r) { return all[l].error.p99 > all[r].error.p99; });
    for (std::size_t k = 0; k < std::min<std::size_t>(5, order.size()); ++k)
      writePath(wanted.out / (wanted.terrain + "-" + std::to_string(order[k]) + ".json"), wanted, all[order[k]].camera);
  }
  Report report;
  report.note(wanted.terrain + ", " + std::to_string(poses.size()) + " random poses" + (wanted.speed > 0 ? " in flight" : " at rest") +
              ", threshold " + std::to_string(wanted.threshold) + ", pixels");
  std::vector<double> p99s;
  double most = 0, mostAtJump = 0, worst = 0, triangles = 0, over = 0, unsettled = 0, rays = 0, jumps = 0, seconds = 0, raised = 0;
  for (const Measured& m : all) {
    if (m.error.rays > 0) p99s.push_back(m.error.p99);
    worst = std::max(worst, m.error.p99);
    most = std::max(most, m.error.most);
    mostAtJump = std::max(mostAtJump, m.error.mostAtJump);
    over += m.error.p99 > 2 * m.threshold;
    unsettled += !m.settled;
    raised += m.threshold > wanted.threshold;
    triangles += m.triangles / static_cast<double>(all.size());
    seconds += m.seconds / static_cast<double>(all.size());
    rays += static_cast<double>(m.error.rays);
    jumps += static_cast<double>(m.error.jumps);
  }
  report.add("worst_p99_px", worst, "px");
  report.add("worst_max_px", most, "px, but for jumps narrower than the lattice");
  report.add("poses_above_2px", over, "poses whose p99 is above twice the threshold in force");
  report.add("median_p99_px", p99s.empty() ? NAN : median(p99s), "px");
  report.add("triangles_mean", triangles);
  report.add("jump_share", rays > 0 ? jumps / rays : 0, "of the rays: errors at jumps narrower than the lattice");
  report.add("jump_max_px", mostAtJump, "px, there");
  report.add("poses_not_settled", unsettled, "within 300 iterations");
  report.add("poses_over_budget", raised, "whose threshold the budget raised");
  report.add("seconds_mean", seconds, "to settle, one thread");
  return report;
}

}  // namespace ridgecast::bench
