#include "client/evaluation/recorder.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "client/evaluation/ssim.h"
#include "client/evaluation/text_file.h"
#include "common/gltf/glb.h"

namespace ridgecast::evaluation {
namespace {

// The last drawing without filtering.
Outcome<render::Picture> unfilteredOf(render::Renderer& renderer, render::View view, std::uint32_t samples) {
  view.filtered = false;
  auto again = renderer.shadeAgain(view, samples);
  if (!again) return again.error();
  return std::move(again->picture);
}

}  // namespace

const References::March* References::find(const camera::Camera& camera, std::uint32_t samples, bool unfiltered) const {
  const auto found = std::ranges::find_if(
      marches_, [&](const March& m) { return m.camera == camera && m.samples == samples && (m.unfiltered || !unfiltered); });
  return found == marches_.end() ? nullptr : &*found;
}

const References::March& References::keep(March march) {
  if (marches_.size() >= most_) marches_.pop_front();
  return marches_.emplace_back(std::move(march));
}

Recorder::Recorder(std::filesystem::path folder) : folder_(std::move(folder)), lines_(folder_ / "iterations.jsonl", std::ios::trunc) {}

Outcome<Recorder> Recorder::create(const std::filesystem::path& folder) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) return Error{"cannot make the folder " + folder.string() + ": " + failed.message() + "; choose another --out"};
  Recorder recorder(folder);
  if (!recorder.lines_) return cannotWrite(folder / "iterations.jsonl");
  return recorder;
}

Outcome<void> Recorder::add(const IterationResult& result) {
  ++summary_.iterations;
  summary_.hashMismatches += !result.hashOk;
  summary_.latencyMsMean += result.latencyMs;  // the sum, until the summary is written
  summary_.latencyMsMax = std::max(summary_.latencyMsMax, result.latencyMs);
  lines_ << asJson(result);
  if (!lines_) return cannotWrite(folder_ / "iterations.jsonl");
  return {};
}

Outcome<Comparison> Recorder::picture(const std::string& name, render::Renderer& renderer, const core::Scene& scene,
                                      const render::View& view, const PictureSettings& settings) {
  const std::uint32_t samples = settings.samples;
  std::optional<render::Picture> meshPoints, corrected;
  auto mesh = renderer.drawMesh(scene.leaves(), view, samples);
  if (!mesh) return mesh.error();
  if (settings.unfiltered) {
    auto points = unfilteredOf(renderer, view, samples);
    if (!points) return points.error();
    meshPoints = std::move(*points);
  }
  if (settings.corrected) {
    auto drawn = renderer.drawCorrected(scene.leaves(), view, samples);
    if (!drawn) return drawn.error();
    correctedTimes_.add(drawn->milliseconds, drawn->cpuMilliseconds);
    corrected = std::move(drawn->picture);
    if (auto written = render::writePng(*corrected, folder_ / (name + "-corrected.png")); !written) return written.error();
  }
  if (auto written = render::writePng(mesh->picture, folder_ / (name + "-mesh.png")); !written) return written.error();

  std::optional<References::March> own;
  const References::March* truth = settings.references ? settings.references->find(view.camera, samples, settings.unfiltered) : nullptr;
  std::error_code failed;
  const std::filesystem::path file = folder_ / (name + "-raymarch.png");
  if (!truth || !std::filesystem::copy_file(truth->file, file, std::filesystem::copy_options::overwrite_existing, failed)) {
    auto marched = march(name, renderer, view, samples, settings.unfiltered);
    if (!marched) return marched.error();
    truth = settings.references ? &settings.references->keep(std::move(*marched)) : &own.emplace(std::move(*marched));
  }
  meshTimes_.add(mesh->milliseconds, mesh->cpuMilliseconds);
  marchTimes_.add(truth->milliseconds, truth->cpuMilliseconds);
  const Similarity drawn = similarity(mesh->picture, truth->filtered);
  Comparison out{{drawn.mean, drawn.terrain.value_or(kNothing)}, drawn.terrainShare};
  if (meshPoints && truth->unfiltered) out.likeness.unfiltered = similarity(*meshPoints, *truth->unfiltered).mean;
  if (corrected) out.likeness.corrected = similarity(*corrected, truth->filtered).mean;
  return out;
}

Outcome<References::March> Recorder::march(const std::string& name, render::Renderer& renderer, const render::View& view,
                                           std::uint32_t samples, bool unfiltered) {
  References::March out{view.camera, samples, {}, {}, 0, 0, folder_ / (name + "-raymarch.png")};
  auto drawn = renderer.drawMarch(view, samples);
  if (!drawn) return drawn.error();
  out.milliseconds = drawn->milliseconds;
  out.cpuMilliseconds = drawn->cpuMilliseconds;
  out.filtered = std::move(drawn->picture);
  if (unfiltered) {
    auto points = unfilteredOf(renderer, view, samples);
    if (!points) return points.error();
    out.unfiltered = std::move(*points);
  }
  if (auto written = render::writePng(out.filtered, out.file); !written) return written.error();
  return out;
}

void Recorder::addFrame(const std::string& name, double t, const Likeness& likeness) {
  summary_.frames.names.push_back(name);
  summary_.frames.t.push_back(t);
  summary_.frames.ssim.push_back(likeness.ssim);
  frames_.push_back(likeness);
}

Outcome<void> Recorder::meshPicture(const std::string& name, render::Renderer& renderer, const core::Scene& scene, const render::View& view,
                                    std::uint32_t samples) {
  auto mesh = renderer.drawMesh(scene.leaves(), view, samples);
  if (!mesh) return mesh.error();
  meshTimes_.add(mesh->milliseconds, mesh->cpuMilliseconds);
  return render::writePng(mesh->picture, folder_ / (name + "-mesh.png"));
}

Outcome<void> Recorder::writeSummary(double seconds) {
  lines_.flush();
  const auto mean = [this](double Likeness::*part) {
    double sum = 0, count = 0;
    for (const Likeness& frame : frames_)
      if (!std::isnan(frame.*part)) sum += frame.*part, ++count;
    return sum / count;  // of none: kNothing
  };
  const auto time = [](const Times& times) { return FrameTime{median(times.milliseconds), median(times.cpuMilliseconds)}; };
  FlightSummary& s = summary_;
  s.mean = {mean(&Likeness::ssim), mean(&Likeness::terrain), mean(&Likeness::unfiltered), mean(&Likeness::corrected)};
  s.frames.count = frames_.size();
  if (!frames_.empty()) s.frames.least = std::ranges::min(s.frames.ssim);
  s.mesh = time(meshTimes_);
  s.corrected = time(correctedTimes_);
  s.raymarch = time(marchTimes_);
  if (seconds > 0) s.iterationsPerSecond = static_cast<double>(s.iterations) / seconds;
  s.latencyMsMean /= static_cast<double>(std::max<std::uint64_t>(s.iterations, 1));
  return writeText(folder_ / "summary.json", asJson(s));
}

Outcome<void> writeGlb(const core::Leaves& leaves, const camera::Pose& pose, const std::string& terrain, std::uint32_t seed,
                       const std::filesystem::path& file) {
  gltf::Document document;
  document.origin = {pose.x, pose.z};
  document.extras = nlohmann::json{{"terrain", terrain}, {"seed", seed}}.dump();
  for (const auto& [address, held] : leaves) document.leaves.push_back({held.mesh.get(), {}, {}});
  const auto bytes = gltf::writeGlb(document, gltf::Compression::kNone);
  if (!bytes) return bytes.error();
  return writeText(file, {bytes->data(), bytes->size()});
}

}  // namespace ridgecast::evaluation
