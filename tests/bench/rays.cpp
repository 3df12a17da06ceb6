// Rays to the true ground, one core, against the march by samples that functions of which nothing is known still need. Both take the same
// rays in turn, in the same run.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <memory>
#include <numbers>
#include <random>
#include <span>
#include <stdexcept>
#include <thread>

#include "common/ground/ground.h"
#include "common/ground/march.h"
#include "common/process/scratch.h"
#include "common/raster/raster_terrain.h"
#include "tests/bench/bench.h"
#include "tests/bench/usage.h"

namespace ridgecast::bench {
namespace {

using ground::Ray;
using TerrainPtr = std::shared_ptr<const terrain::Terrain>;

constexpr int kBeams = 64;

// Terrains that nobody has asked yet.
class Fresh {
 public:
  explicit Fresh(bool quick) : side_(quick ? 1024 : 4096) {}
  TerrainPtr make(const std::string& name) {
    if (name != "map") return terrain::create(name, 1).value();
    if (!scratch_) write();
    raster::RasterOptions how;
    how.pitch = 10;
    how.scale = 1.0 / 16;
    auto map = raster::loadRaster(scratch_->path() / "alpine.r16", how, ++seed_);
    if (!map) throw std::runtime_error(map.error().message);
    return *map;
  }

 private:
  void write() {
    auto made = process::Scratch::create();
    if (!made) throw std::runtime_error(made.error().message);
    scratch_ = std::make_unique<process::Scratch>(std::move(*made));
    const auto alpine = terrain::create("alpine", 1).value();
    std::ofstream out(scratch_->path() / "alpine.r16", std::ios::binary);
    std::vector<lattice::Step> x(static_cast<std::size_t>(side_)), z(x.size());
    std::vector<float> height(x.size());
    for (int j = 0; j < side_; ++j) {
      for (int i = 0; i < side_; ++i) {
        const auto k = static_cast<std::size_t>(i);
        x[k] = (i - side_ / 2) * lattice::Step{2560};
        z[k] = (j - side_ / 2) * lattice::Step{2560};
      }
      alpine->heights(x, z, height);
      for (const float h : height) {
        const auto sample = static_cast<std::uint16_t>(std::lround(h * 16));
        out.put(static_cast<char>(sample & 255)).put(static_cast<char>(sample >> 8));
      }
    }
  }
  int side_;
  std::uint32_t seed_ = 0;
  std::unique_ptr<process::Scratch> scratch_;
};

// A turning lidar, 2 m above the ground: 64 beams from 24.8 degrees below the horizon to 2 above it, beam after beam.
std::vector<Ray> lidar(const terrain::Terrain& terrain, lattice::Point at, int turns, double reach) {
  std::vector<Ray> rays;
  const double y = terrain.height(at) + 2;
  for (int turn = 0; turn < turns; ++turn)
    for (int beam = 0; beam < kBeams; ++beam) {
      const double yaw = 2 * std::numbers::pi * turn / turns, pitch = (-24.8 + 26.8 * beam / (kBeams - 1)) * std::numbers::pi / 180;
      rays.push_back({at.x, at.z, y, std::cos(pitch) * std::sin(yaw), std::sin(pitch), -std::cos(pitch) * std::cos(yaw), reach});
    }
  return rays;
}

std::vector<Ray> scans(const terrain::Terrain& terrain, int turns, double reach) {
  std::vector<Ray> rays;
  for (const lattice::Point at : {lattice::Point{0, 0}, {512'000, -768'000}, {-1'280'000, 256'000}, {768'000, 1'024'000}})
    std::ranges::copy(lidar(terrain, at, turns, reach), std::back_inserter(rays));
  return rays;
}

std::vector<Ray> level(int count, double reach) {
  std::vector<Ray> rays;
  for (int k = 0; k < count; ++k) {
    const double yaw = 2 * std::numbers::pi * k / count;
    rays.push_back({.y = 9000, .directionX = std::sin(yaw), .directionZ = std::cos(yaw), .reach = reach});
  }
  return rays;
}

// Each somewhere else within 20 km.
std::vector<Ray> scattered(const terrain::Terrain& terrain, std::size_t count, double reach) {
  std::mt19937_64 random(3);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  std::vector<Ray> rays;
  for (std::size_t k = 0; k < count; ++k) {
    const lattice::Point at{static_cast<lattice::Step>(uniform(-2.5e6, 2.5e6)), static_cast<lattice::Step>(uniform(-2.5e6, 2.5e6))};
    rays.push_back({at.x, at.z, terrain.height(at) + uniform(1, 80), uniform(-1, 1), uniform(-0.5, 0.2), uniform(-1, 1), reach});
  }
  return rays;
}

std::vector<Ray> everyNth(const std::vector<Ray>& rays, std::size_t n) {
  std::vector<Ray> some;
  for (std::size_t k = n / 2; k < rays.size(); k += n) some.push_back(rays[k]);
  return some;
}

std::vector<double> castAll(const terrain::Terrain& terrain, std::span<const Ray> rays) {
  constexpr std::size_t kPiece = 4096;
  std::vector<double> out(rays.size());
  for (std::size_t k = 0; k < rays.size(); k += kPiece) {
    const std::size_t n = std::min(kPiece, rays.size() - k);
    ground::cast(terrain, rays.subspan(k, n), std::span(out).subspan(k, n));
  }
  return out;
}
std::vector<double> marchAll(const terrain::Terrain& terrain, std::span<const Ray> rays) {
  std::vector<double> out;
  for (const Ray& ray : rays) out.push_back(ground::march(terrain, ray));
  return out;
}

struct Rate {
  double median = 0, worst = 0;  // rays a second of processor time
};
template <class F>
double perSecond(std::size_t rays, F&& f) {
  const double before = cpuSeconds();
  f();
  return static_cast<double>(rays) / (cpuSeconds() - before);
}
Rate rateOf(const std::vector<double>& runs) { return {median(runs), *std::ranges::min_element(runs)}; }

// Both in turn, after a first run of each.
void compare(Report& report, const std::string& name, const terrain::Terrain& terrain, const std::vector<Ray>& rays, int rounds) {
  const std::vector<Ray> some = everyNth(rays, 16);
  const std::vector<double> mine = castAll(terrain, rays), theirs = marchAll(terrain, some);
  std::size_t differ = 0;
  for (std::size_t k = 0; k < some.size(); ++k) differ += std::abs(mine[8 + 16 * k] - theirs[k]) > 1 ? 1 : 0;
  std::vector<double> cast, march;
  for (int round = 0; round < rounds; ++round) {
    cast.push_back(perSecond(rays.size(), [&] { castAll(terrain, rays); }));
    march.push_back(perSecond(some.size(), [&] { marchAll(terrain, some); }));
  }
  const Rate ours = rateOf(cast);
  report.add(name + "_rays_s", ours.median, "rays/s");
  report.add(name + "_rays_s_worst", ours.worst, "rays/s");
  report.add(name + "_ratio", ours.median / median(march), "x the march");
  report.add(name + "_differ", static_cast<double>(differ) / static_cast<double>(some.size()),
             "of them end more than 1 m from the march's");
}

// The first rays at a place that nobody has asked about.
void begin(Report& report, const std::string& name, Fresh& fresh, const std::vector<Ray>& rays, int rounds) {
  std::vector<double> first, all, again, march;
  double bytes = 0;
  for (int round = 0; round < rounds; ++round) {
    const TerrainPtr terrain = fresh.make(name);
    const double before = residentBytes();
    const auto part = std::span(rays).first(std::min<std::size_t>(64, rays.size()));
    first.push_back(1e3 * static_cast<double>(part.size()) / perSecond(part.size(), [&] { castAll(*terrain, part); }));
    all.push_back(perSecond(rays.size(), [&] { castAll(*terrain, rays); }));
    again.push_back(perSecond(rays.size(), [&] { castAll(*terrain, rays); }));
    bytes = std::max(bytes, residentBytes() - before);
    const std::vector<Ray> some = everyNth(rays, 16);
    march.push_back(perSecond(some.size(), [&] { marchAll(*terrain, some); }));
  }
  const auto n = static_cast<double>(rays.size());
  report.add(name + "_begin_64_rays_ms", median(first), "ms");
  report.add(name + "_begin_scan_ms", 1e3 * (n / median(all) - n / median(again)), "ms more than later for a scan");
  report.add(name + "_begin_ratio", median(all) / median(march), "x the march, a scan of 32,768 rays at a new place");
  report.add(name + "_mib", bytes / (1 << 20), "MiB");
}

void post(Report& report, const std::string& name, Fresh& fresh, int rounds) {
  for (const double reach : {100.0, 3000.0}) {
    std::vector<double> cast, march;
    for (int round = 0; round < rounds; ++round) {
      const TerrainPtr terrain = fresh.make(name);
      const std::vector<Ray> rays = scattered(*terrain, 1000, reach);
      cast.push_back(perSecond(rays.size(), [&] { castAll(*terrain, rays); }));
      march.push_back(perSecond(rays.size(), [&] { marchAll(*terrain, rays); }));
    }
    const std::string full = name + "_scattered_" + std::to_string(static_cast<int>(reach)) + "m";
    report.add(full + "_rays_s", median(cast), "rays/s");
    report.add(full + "_ratio", median(cast) / median(march), "x the march");
  }
}

void threads(Report& report, const terrain::Terrain& terrain, const std::vector<Ray>& rays, int rounds) {
  std::vector<double> ratio;
  const std::vector<double> alone = castAll(terrain, rays);
  bool equal = true;
  for (int round = 0; round < rounds; ++round) {
    const Clock one;
    castAll(terrain, rays);
    const double first = one.seconds();
    const Clock two;
    std::vector<double> other;
    std::thread beside([&] { other = castAll(terrain, rays); });
    equal &= castAll(terrain, rays) == alone;
    beside.join();
    equal &= other == alone;
    ratio.push_back(2 * first / two.seconds());
  }
  report.add("speedup_2", median(ratio), "x one thread, by the wall clock");
  report.add("answers_equal", equal ? 1 : 0);
}

}  // namespace

Report rays(const Options& options) {
  const int turns = options.quick ? 64 : 512, rounds = options.quick ? 3 : 9;
  Report report;
  Fresh fresh(options.quick);
  report.note("one thread, processor time, median of " + std::to_string(rounds) + "; lidar: 64 beams x " + std::to_string(turns) +
              " directions at four places, asked before; the march: every 16th of the same rays, in turn");
  for (const std::string name : {"alpine", "canyon", "map"}) {
    const TerrainPtr terrain = fresh.make(name);
    for (const double reach : {100.0, 10'000.0}) {
      progress("rays: " + name + ", " + std::to_string(static_cast<int>(reach)) + " m");
      compare(report, name + "_" + std::to_string(static_cast<int>(reach)) + "m", *terrain, scans(*terrain, turns, reach), rounds);
    }
    post(report, name, fresh, rounds);
    begin(report, name, fresh, lidar(*terrain, {5'120'000, 2'560'000}, turns, 10'000), rounds);
  }
  const TerrainPtr alpine = fresh.make("alpine");
  for (const double reach : {100.0, 10'000.0})
    compare(report, "level_" + std::to_string(static_cast<int>(reach)) + "m", *alpine, level(options.quick ? 1024 : 8192, reach), rounds);
  threads(report, *alpine, scans(*alpine, turns, 1000), rounds);
  return report;
}

}  // namespace ridgecast::bench
