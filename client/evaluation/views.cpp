#include "client/evaluation/views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <utility>

#include "client/evaluation/text_file.h"
#include "client/render/context.h"

namespace ridgecast::evaluation {
namespace {

using OrderedJson = nlohmann::ordered_json;
using render::Picture;

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
constexpr int kMaxSteps = 10;                        // as good as it gets, for what is missing
constexpr float kFiner = 2;                          // steps of the march that judges the march

OrderedJson figures(const Similarity& s) {
  return {{"ssim", s.mean}, {"terrain", s.terrain ? OrderedJson(*s.terrain) : OrderedJson(nullptr)}};
}
OrderedJson figures(const PixelError& e) { return {{"median", e.median}, {"p99", e.p99}, {"worst", e.worst}}; }

OrderedJson figures(const Missing& m) {
  return {{"total", m.total},     {"silhouettes", m.silhouettes}, {"geometry", m.geometry},
          {"shading", m.shading}, {"marcher", m.marcher},         {"silhouette_windows", m.windows}};
}

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
  const OrderedJson key = {{"t", 0}, {"x", view.x}, {"z", view.z}, {"altitude", view.altitude}, {"yaw", view.yaw}, {"pitch", view.pitch}};
  return OrderedJson{{"terrain", view.terrain}, {"seed", 1}, {"keyframes", OrderedJson::array({key})}}.dump(2);
}

struct ViewMeasurement::State {
  ViewCase view;
  ViewSettings settings;
  std::filesystem::path folder;
  OrderedJson json;
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

  // Mesh and corrected mesh against the march with the k-th number of samples: "pictures", and with the first "missing".
  Outcome<void> compare(std::size_t k, const AtRest& at, OrderedJson& out) const {
    auto drawn = both(at.renderer.drawMesh(at.scene.leaves(), at.view, settings.samples[k]), at, settings.samples[k]);
    if (!drawn) return drawn.error();
    const std::vector<float> seen = k == 0 ? at.renderer.positions() : std::vector<float>();
    auto corrected = both(at.renderer.drawCorrected(at.scene.leaves(), at.view, settings.samples[k]), at, settings.samples[k]);
    if (!corrected) return corrected.error();
    const Both& march = marches[k];
    const SimilarityMap map = similarityMap(drawn->filtered, march.filtered);
    if (k == 0) {
      auto best = at.renderer.drawCorrected(at.scene.leaves(), at.view, 1, kMaxSteps);
      if (!best) return best.error();
      out["missing"] =
          figures(missingOf(map, similarityMap(best->picture, march.filtered), similarityMap(*finer, march.filtered), seen, marched, 1));
    }
    for (const auto& [filtered, picture] : {std::pair(true, &Both::filtered), std::pair(false, &Both::points)})
      out["pictures"].push_back({{"samples", settings.samples[k] * settings.samples[k]},
                                 {"filtered", filtered},
                                 {"mesh", figures(similarity((*drawn).*picture, march.*picture))},
                                 {"corrected", figures(similarity((*corrected).*picture, march.*picture))}});
    if (k != kept) return {};
    const Picture loss = lossPicture(map);
    for (const auto& [name, picture] :
         {std::pair("mesh.png", &std::as_const(drawn->filtered)), {"corrected.png", &corrected->filtered}, {"loss.png", &loss}})
      if (auto written = render::writePng(*picture, folder / name); !written) return written;
    return {};
  }

  // Mesh, corrected mesh and ray march in turn, one sample a pixel, filtered: what else the machine does hits all of them.
  Outcome<void> timed(const AtRest& at, OrderedJson& out) const {
    const auto note = [&out](const char* name, const Outcome<render::Renderer::Drawn>& drawn) -> Outcome<void> {
      if (!drawn) return drawn.error();
      out[std::string(name) + "_ms"].push_back(drawn->milliseconds);
      out[std::string(name) + "_cpu_ms"].push_back(drawn->cpuMilliseconds);
      return {};
    };
    for (int k = 0; k < settings.repeats; ++k) {
      if (auto noted = note("mesh", at.renderer.drawMesh(at.scene.leaves(), at.view)); !noted) return noted;
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
  state_->json["meshes"] = OrderedJson::array();
}

ViewMeasurement::~ViewMeasurement() = default;

Outcome<void> ViewMeasurement::measure(const MeshCase& mesh, const AtRest& at) {
  State& s = *state_;
  if (!at.terrain) return Error{"this client does not know the terrain: there is no ray march to compare with"};
  if (s.marches.empty())
    if (auto made = s.reference(at); !made) return made;
  OrderedJson out = {{"metric", mesh.metric}, {"threshold", mesh.threshold}, {"triangles", at.scene.triangles()}, {"settled", at.settled}};
  const auto pixelError = [&at] { return figures(pixelErrorOf(at.renderer.positions(), at.view.camera, *at.terrain)); };
  if (auto first = at.renderer.drawMesh(at.scene.leaves(), at.view); !first) return first.error();  // uploads
  out["pixel_error"] = pixelError();
  if (auto moved = at.renderer.drawCorrected(at.scene.leaves(), at.view); !moved) return moved.error();
  out["pixel_error_corrected"] = pixelError();
  for (std::size_t k = 0; k < s.settings.samples.size() && s.settings.samples[k] <= mesh.mostSamples; ++k)
    if (auto compared = s.compare(k, at, out); !compared) return compared;
  for (const int steps : kSteps) {
    auto drawn = at.renderer.drawCorrected(at.scene.leaves(), at.view, 1, steps);
    if (!drawn) return drawn.error();
    OrderedJson one = figures(similarity(drawn->picture, s.marches.front().filtered));
    one["steps"] = steps;
    one["ms"] = drawn->milliseconds;
    out["correction"].push_back(std::move(one));
  }
  if (auto timed = s.timed(at, out["times"]); !timed) return timed;
  const OrderedJson& last = out["pictures"][std::min(2 * s.kept, out["pictures"].size() - 2)];
  std::fprintf(stderr, "%s %s, %s %g: %llu triangles%s, SSIM %.4f, corrected %.4f, with %d samples\n", std::string(s.view.terrain).c_str(),
               std::string(s.view.name).c_str(), mesh.metric.c_str(), mesh.threshold, static_cast<unsigned long long>(at.scene.triangles()),
               at.settled ? "" : " (still refining)", last["mesh"]["ssim"].get<double>(), last["corrected"]["ssim"].get<double>(),
               last["samples"].get<int>());
  s.json["meshes"].push_back(std::move(out));
  return {};
}

Outcome<void> ViewMeasurement::finish() {
  const std::filesystem::path file = state_->folder / "view.json", part = state_->folder / "view.json.part";
  if (auto written = writeText(part, state_->json.dump(2, ' ', false, OrderedJson::error_handler_t::replace) + "\n"); !written)
    return written;
  std::error_code failed;
  std::filesystem::rename(part, file, failed);
  if (failed) return cannotWrite(file);
  return {};
}

}  // namespace ridgecast::evaluation
