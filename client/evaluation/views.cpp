#include "client/evaluation/views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "client/render/context.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::ordered_json;
using render::Picture;
using Leaves = std::map<lattice::LeafAddress, scene::HeldLeaf>;

constexpr std::array<ViewCase, 9> kViews = {{{"alpine", "low", 2000, 1500, 60, 0, -5},
                                             {"alpine", "overview", 1400, 3600, 1200, -20, -30},
                                             {"alpine", "grazing", 1750, 2620, 25, 8, -3},
                                             {"canyon", "low", 5120, 4620, 60, 30, -6},
                                             {"canyon", "overview", 5750, 6100, 1000, 10, -30},
                                             {"canyon", "grazing", 5640, 5560, 25, 60, -2},
                                             {"archipelago", "low", 12500, 6980, 60, 104, -6},
                                             {"archipelago", "overview", 13600, 7100, 900, 96, -28},
                                             {"archipelago", "grazing", 11950, 6950, 15, 108, -2}}};
constexpr std::array<int, 4> kSteps = {1, 2, 3, 4};  // of the correction
constexpr int kMostSteps = 10;                       // as good as it gets, for what is missing
constexpr float kFiner = 2;                          // steps of the march that judges the march

Json figures(const Similarity& s) { return {{"ssim", s.mean}, {"terrain", s.terrain ? Json(*s.terrain) : Json(nullptr)}}; }
Json figures(const PixelError& e) { return {{"median", e.median}, {"p99", e.p99}, {"worst", e.worst}}; }

// 1 - SSIM from black over red and yellow to white, in the middle of each window; the border is black.
Picture lossPicture(const SimilarityMap& map) {
  constexpr std::size_t kBorder = kSimilarityWindow / 2;
  const std::size_t width = map.width + 2 * kBorder, height = map.height + 2 * kBorder;
  Picture out{static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), std::vector<std::uint8_t>(width * height * 3), {}};
  for (std::size_t y = 0; y < map.height; ++y)
    for (std::size_t x = 0; x < map.width; ++x) {
      const double loss = std::clamp((1 - map.values[y * map.width + x]) / 0.25, 0.0, 1.0) * 3;
      for (std::size_t c = 0; c < 3; ++c)
        out.rgb[3 * ((y + kBorder) * width + x + kBorder) + c] =
            static_cast<std::uint8_t>(255 * std::clamp(loss - static_cast<double>(c), 0.0, 1.0));
    }
  return out;
}

// Both ways of colouring one rendering.
struct Both {
  Picture filtered, points;
};

}  // namespace

std::span<const ViewCase> viewCases() { return kViews; }

std::string pathOf(const ViewCase& view) {
  const Json key = {{"t", 0}, {"x", view.x}, {"z", view.z}, {"altitude", view.altitude}, {"yaw", view.yaw}, {"pitch", view.pitch}};
  return Json{{"terrain", view.terrain}, {"seed", 1}, {"keyframes", Json::array({key})}}.dump(2);
}

struct ViewMeasurement::State {
  ViewCase view;
  ViewSettings settings;
  std::filesystem::path folder;
  Json json;
  std::vector<Both> marches;   // for each of the samples
  std::vector<float> marched;  // positions, of one sample a pixel
  std::optional<Picture> finer;
  std::size_t kept = 0;  // index of the samples that pictures are of: 2 x 2 where there are
  std::vector<double> marchMs;

  Outcome<Both> both(Outcome<render::Renderer::Drawn> drawn, const AtRest& at, std::uint32_t samples) const {
    if (!drawn) return drawn.error();
    render::View points = at.view;
    points.filtered = false;
    auto again = at.renderer.shadeAgain(points, samples);
    if (!again) return again.error();
    return Both{std::move(drawn->picture), std::move(again->picture)};
  }

  Outcome<void> reference(const AtRest& at) {
    json["gl_renderer"] = render::contextDescription();
    json["width"] = at.view.camera.projection.width;
    json["height"] = at.view.camera.projection.height;
    for (std::size_t k = 0; k < settings.samples.size(); ++k)
      if (settings.samples[k] <= 2) kept = k;
    for (std::size_t k = 0; k < settings.samples.size(); ++k) {
      auto march = both(at.renderer.drawMarch(at.view, settings.samples[k]), at, settings.samples[k]);
      if (!march) return march.error();
      if (k == 0) marched = at.renderer.positions();
      marches.push_back(std::move(*march));
    }
    auto drawn = at.renderer.drawMarch(at.view, 1, kFiner);
    if (!drawn) return drawn.error();
    finer = std::move(drawn->picture);
    const Similarity s = similarity(*finer, marches.front().filtered);
    json["terrain_share"] = s.terrainShare;
    json["marcher"] = figures(s);
    return render::writePng(marches[kept].filtered, folder / "march.png");
  }

  // Mesh, corrected mesh and ray march in turn, one sample a pixel, filtered: what else the machine does hits all of them.
  Outcome<void> timed(const AtRest& at, Json& out) const {
    const auto note = [&out](const char* name, const Outcome<render::Renderer::Drawn>& drawn) -> Outcome<void> {
      if (!drawn) return drawn.error();
      out[std::string(name) + "_ms"].push_back(drawn->milliseconds);
      out[std::string(name) + "_cpu_ms"].push_back(drawn->cpuMilliseconds);
      return {};
    };
    for (int k = 0; k < settings.repeats; ++k) {
      if (auto noted = note("mesh", at.renderer.drawMesh(at.scene, at.view)); !noted) return noted;
      if (auto noted = note("corrected", at.renderer.drawCorrected(at.scene.leaves(), at.view)); !noted) return noted;
      if (k >= settings.marches) continue;
      if (auto noted = note("march", at.renderer.drawMarch(at.view)); !noted) return noted;
    }
    return {};
  }
};

ViewMeasurement::ViewMeasurement(const ViewCase& view, ViewSettings settings, std::filesystem::path folder)
    : state_(std::make_unique<State>()) {
  state_->view = view;
  state_->settings = std::move(settings);
  state_->folder = std::move(folder);
  state_->json = {{"terrain", view.terrain},   {"view", view.name}, {"x", view.x},        {"z", view.z},
                  {"altitude", view.altitude}, {"yaw", view.yaw},   {"pitch", view.pitch}};
  state_->json["meshes"] = Json::array();
}

ViewMeasurement::~ViewMeasurement() = default;

Outcome<void> ViewMeasurement::measure(const MeshCase& mesh, const AtRest& at) {
  State& s = *state_;
  if (!at.terrain) return Error{"this client does not know the terrain: there is no ray march to compare with"};
  if (s.marches.empty())
    if (auto made = s.reference(at); !made) return made;
  Json out = {{"metric", mesh.metric}, {"threshold", mesh.threshold}, {"triangles", at.scene.triangles()}, {"settled", at.settled}};

  const auto correctedOf = [&](std::uint32_t samples, int steps) {
    return at.renderer.drawCorrected(at.scene.leaves(), at.view, samples, steps);
  };
  auto first = at.renderer.drawMesh(at.scene, at.view);  // uploads
  if (!first) return first.error();
  out["pixel_error"] = figures(pixelErrorOf(at.renderer.positions(), at.view.camera, *at.terrain));
  auto moved = correctedOf(1, render::kCorrectionSteps);
  if (!moved) return moved.error();
  out["pixel_error_corrected"] = figures(pixelErrorOf(at.renderer.positions(), at.view.camera, *at.terrain));

  Json pictures = Json::array();
  for (std::size_t k = 0; k < s.settings.samples.size(); ++k) {
    const std::uint32_t samples = s.settings.samples[k];
    if (samples > mesh.mostSamples) break;
    auto drawn = s.both(at.renderer.drawMesh(at.scene, at.view, samples), at, samples);
    if (!drawn) return drawn.error();
    const std::vector<float> seen = k == 0 ? at.renderer.positions() : std::vector<float>();
    auto corrected = s.both(correctedOf(samples, render::kCorrectionSteps), at, samples);
    if (!corrected) return corrected.error();
    const Both& march = s.marches[k];
    for (const bool filtered : {true, false}) {
      const auto of = [filtered](const Both& b) -> const Picture& { return filtered ? b.filtered : b.points; };
      pictures.push_back({{"samples", samples * samples},
                          {"filtered", filtered},
                          {"mesh", figures(similarity(of(*drawn), of(march)))},
                          {"corrected", figures(similarity(of(*corrected), of(march)))}});
    }
    const SimilarityMap map = similarityMap(drawn->filtered, march.filtered);
    if (k == 0) {
      auto best = correctedOf(1, kMostSteps);
      if (!best) return best.error();
      const Missing missing =
          missingOf(map, similarityMap(best->picture, march.filtered), similarityMap(*s.finer, march.filtered), seen, s.marched, 1);
      out["missing"] = {{"total", missing.total},     {"silhouettes", missing.silhouettes}, {"geometry", missing.geometry},
                        {"shading", missing.shading}, {"marcher", missing.marcher},         {"silhouette_windows", missing.windows}};
    }
    if (k != s.kept) continue;
    const Picture loss = lossPicture(map);
    const std::array<std::pair<const char*, const Picture*>, 3> files = {
        {{"mesh.png", &drawn->filtered}, {"corrected.png", &corrected->filtered}, {"loss.png", &loss}}};
    for (const auto& [name, picture] : files)
      if (auto written = render::writePng(*picture, s.folder / name); !written) return written;
  }
  out["pictures"] = std::move(pictures);

  Json steps = Json::array();
  for (const int n : kSteps) {
    auto drawn = correctedOf(1, n);
    if (!drawn) return drawn.error();
    Json one = figures(similarity(drawn->picture, s.marches.front().filtered));
    one["steps"] = n;
    one["ms"] = drawn->milliseconds;
    steps.push_back(std::move(one));
  }
  out["correction"] = std::move(steps);
  if (auto timed = s.timed(at, out["times"]); !timed) return timed;
  const Json& last = out["pictures"][std::min(2 * s.kept, out["pictures"].size() - 2)];
  std::fprintf(stderr, "%s %s, %s %g: %llu triangles%s, SSIM %.4f, corrected %.4f, with %d samples\n", std::string(s.view.terrain).c_str(),
               std::string(s.view.name).c_str(), mesh.metric.c_str(), mesh.threshold, static_cast<unsigned long long>(at.scene.triangles()),
               at.settled ? "" : " (still refining)", last["mesh"]["ssim"].get<double>(), last["corrected"]["ssim"].get<double>(),
               last["samples"].get<int>());
  s.json["meshes"].push_back(std::move(out));
  return {};
}

Outcome<void> ViewMeasurement::finish() {
  const std::filesystem::path file = state_->folder / "view.json", part = state_->folder / "view.json.part";
  std::ofstream out(part, std::ios::trunc);
  out << state_->json.dump(2, ' ', false, Json::error_handler_t::replace) << '\n';
  out.close();
  std::error_code failed;
  if (out) std::filesystem::rename(part, file, failed);
  if (!out || failed) return Error{"cannot write " + file.string() + ": choose a folder that may be written and has room"};
  return {};
}

}  // namespace ridgecast::evaluation
