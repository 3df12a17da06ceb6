#include "tests/bench/edited_views.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "server/pipeline/pipeline.h"
#include "tests/bench/edit_session.h"
#include "tests/bench/pictures.h"
#include "tests/support/flight.h"
#include "tests/support/process.h"
#include "tests/support/rays.h"

namespace ridgecast::bench {
namespace {

using lattice::Step;

Step m(double metres) { return std::llround(metres * lattice::kStepsPerMetre); }

constexpr double kX = -3525, kZ = -2300;  // a meadow in a valley

// A field of craters, a road through it and up the slope, a levelled site.
std::vector<edits::Operation> operations(const terrain::Terrain& terrain) {
  std::vector<edits::Operation> out;
  std::mt19937_64 random(1);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  for (int k = 0; k < 40; ++k) {
    const double radius = std::exp(uniform(std::log(2), std::log(16)));
    out.push_back(
        {edits::Crater{{m(kX + uniform(-120, 40)), m(kZ + uniform(-80, 80))}, m(radius), static_cast<std::int32_t>(m(radius / 3))}, 0});
  }
  const lattice::Point site{m(kX + 80), m(kZ - 30)};
  out.push_back({edits::Level{{site}, m(25), terrain.heightStep(site), 256}, 7});
  edits::Road road;
  for (const auto& [x, z] : {std::pair{-180.0, 60.0}, {-60.0, 20.0}, {60.0, 30.0}, {110.0, -60.0}, {200.0, -120.0}})
    road.line.push_back({m(kX + x), m(kZ + z), 0});
  road.width = m(7);
  out.push_back({road, 6});
  return out;
}

std::vector<camera::Camera> views(const terrain::Terrain& terrain) {
  std::vector<camera::Camera> out;
  struct View {
    double away, bearing, altitude, pitch;  // metres and degrees
  };
  for (const View v : {View{60, 20, 8, -12}, View{60, 200, 15, -15}, View{90, 110, 30, -20}, View{120, 300, 40, -20},
                       View{150, 70, 60, -25}, View{200, 160, 90, -28}, View{250, 250, 120, -28}, View{400, 340, 200, -28}}) {
    const double yaw = v.bearing * std::numbers::pi / 180;
    out.push_back(testing_support::cameraAt(terrain, kX + v.away * std::sin(yaw), kZ + v.away * std::cos(yaw), v.altitude, yaw,
                                            v.pitch * std::numbers::pi / 180));
  }
  return out;
}

testing_support::ScreenError settled(const std::shared_ptr<const terrain::Terrain>& terrain, const camera::Camera& camera) {
  scheduling::Executor executor(2);
  settings::Settings asked;
  asked.metric = settings::Metric::kPixels;
  asked.threshold = 1;
  asked.triangleBudget = 2'000'000;
  pipeline::Pipeline pipeline(terrain, pipeline::grant(asked, {}), executor.makePool(2));
  for (int n = 0; n < 300 && !pipeline.settled(); ++n) pipeline.iterate(camera);
  return testing_support::errorOnScreen(pipeline, *terrain, camera, asked.threshold, 480);
}

}  // namespace

Report errorOfEditedViews(const Options& options) {
  const std::shared_ptr<const terrain::Terrain> plain = terrain::create("alpine", 1).value();
  const testing_support::ScratchFolder state;
  std::shared_ptr<const edits::Layer> layer;
  {
    EditSession session = EditSession::open(state / "default.edits", plain);
    for (edits::Operation& o : operations(*plain)) session.append({std::move(o)});
    layer = session.history.layer();
  }
  const auto edited = std::make_shared<const edits::EditedTerrain>(plain, layer);
  Report report;
  report.note("alpine, a field of 40 craters, a road and a levelled site; threshold 1, 1280x720, from the same places before and after");
  report.note("| view | p99 px before | after | SSIM before | after |");
  report.note("|---|---|---|---|---|");
  double before = 0, after = 0;
  std::vector<double> losses;
  for (const camera::Camera& camera : views(*edited)) {
    const auto old = settled(plain, camera), now = settled(edited, camera);
    before = std::max(before, old.p99);
    after = std::max(after, now.p99);
    const auto draw = [&](const std::vector<std::string>& more) {
      return options.quick ? NAN : Pictures(options.programFolder, "alpine", camera, more).settled("pixels", 1).all;
    };
    const double oldSsim = draw({}), newSsim = draw({"--state", (state / "").string()});
    losses.push_back(oldSsim - newSsim);
    char line[200];
    std::snprintf(line, sizeof line, "| %zu | %.3f | %.3f | %.4f | %.4f |", losses.size(), old.p99, now.p99, oldSsim, newSsim);
    report.note(line);
    progress(line);
  }
  report.add("worst_p99_px_before", before, "px");
  report.add("worst_p99_px", after, "px, edited");
  report.add("worst_ssim_loss", std::ranges::max(losses), "by which mesh and ray march are less alike than before");
  report.add("median_ssim_loss", median(losses));
  return report;
}

}  // namespace ridgecast::bench
