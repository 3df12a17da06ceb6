#include "client/evaluation/recorder.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>
#include <system_error>

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::ordered_json;

Json mean(const std::vector<double>& values) {
  if (values.empty()) return nullptr;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

std::string_view metricName(wire::Metric metric) {
  return metric == wire::Metric::kThesis ? "thesis" : metric == wire::Metric::kArea ? "area" : "pixels";
}

Error cannotWrite(const std::filesystem::path& file) {
  return {"cannot write " + file.string() + ": choose a folder that exists, may be written and has room"};
}

}  // namespace

Recorder::Recorder(std::filesystem::path folder) : folder_(std::move(folder)), lines_(folder_ / "iterations.jsonl", std::ios::trunc) {}

Outcome<Recorder> Recorder::create(const std::filesystem::path& folder) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) return Error{"cannot make the folder " + folder.string() + ": " + failed.message() + "; choose another --out"};
  Recorder recorder(folder);
  if (!recorder.lines_) return cannotWrite(folder / "iterations.jsonl");
  return recorder;
}

Outcome<void> Recorder::add(const wire::Iteration& iteration, const IterationRecord& record) {
  const wire::Figures& f = iteration.figures;
  Json line = {{"iteration", iteration.number},
               {"pose", iteration.poseSequence},
               {"t", record.t},
               {"select_ms", f.selectMs},
               {"generate_ms", f.generateMs},
               {"refine_ms", f.refineMs},
               {"triangulate_ms", f.triangulateMs},
               {"encode_ms", f.encodeMs},
               {"apply_ms", record.applyMs},
               {"latency_ms", record.latencyMs},
               {"triangles", f.triangles},
               {"triangles_held", record.held},
               {"inserted", f.inserted},
               {"removed", f.removed},
               {"deferred", f.deferred},
               {"heights", f.heights},
               {"leaves", f.leaves},
               {"leaves_valid", f.validLeaves},
               {"leaves_visible", f.visibleLeaves},
               {"leaves_generated", f.generatedLeaves},
               {"leaves_dropped", f.droppedLeaves},
               {"leaves_sent", iteration.whole.size()},
               {"leaves_gone", iteration.gone.size()},
               {"bytes", record.bytes},
               {"effective_threshold", f.effectiveThreshold},
               {"settled", iteration.settled},
               {"hash_ok", record.hashOk}};
  if (record.uploadMs) line["upload_ms"] = *record.uploadMs;
  if (record.drawMs) line["draw_ms"] = *record.drawMs;
  ++iterations_;
  mismatches_ += record.hashOk ? 0 : 1;
  latency_ += record.latencyMs;
  latencyWorst_ = std::max(latencyWorst_, record.latencyMs);
  lines_ << line.dump() << '\n';
  if (!lines_) return cannotWrite(folder_ / "iterations.jsonl");
  return {};
}

Outcome<Comparison> Recorder::picture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene,
                                      const render::View& view, const PictureSettings& settings) {
  const std::uint32_t samples = settings.samples;
  render::View points = view;
  points.filtered = false;
  Comparison out;
  std::optional<render::Picture> meshPoints, corrected;
  auto mesh = renderer.drawMesh(scene, view, samples);
  if (!mesh) return mesh.error();
  if (settings.unfiltered) {
    auto again = renderer.shadeAgain(points, samples);
    if (!again) return again.error();
    meshPoints = std::move(again->picture);
  }
  if (settings.corrected) {
    auto drawn = renderer.drawCorrected(scene.leaves(), view, samples);
    if (!drawn) return drawn.error();
    correctedMs_.push_back(drawn->milliseconds);
    corrected = std::move(drawn->picture);
    if (auto written = render::writePng(*corrected, folder_ / (name + "-corrected.png")); !written) return written.error();
  }
  auto march = renderer.drawMarch(view, samples);
  if (!march) return march.error();
  if (meshPoints) {
    auto again = renderer.shadeAgain(points, samples);
    if (!again) return again.error();
    out.unfiltered = similarity(*meshPoints, again->picture);
  }
  if (auto written = render::writePng(mesh->picture, folder_ / (name + "-mesh.png")); !written) return written.error();
  if (auto written = render::writePng(march->picture, folder_ / (name + "-raymarch.png")); !written) return written.error();
  meshMs_.push_back(mesh->milliseconds);
  marchMs_.push_back(march->milliseconds);
  out.mesh = similarity(mesh->picture, march->picture);
  if (corrected) out.corrected = similarity(*corrected, march->picture);
  return out;
}

Outcome<void> Recorder::meshPicture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene,
                                    const render::View& view, std::uint32_t samples) {
  auto mesh = renderer.drawMesh(scene, view, samples);
  if (!mesh) return mesh.error();
  meshMs_.push_back(mesh->milliseconds);
  return render::writePng(mesh->picture, folder_ / (name + "-mesh.png"));
}

Outcome<void> Recorder::writeSummary(const wire::World& world, const scene::Scene& scene, const render::View& view, std::uint32_t samples,
                                     const Totals& totals) {
  lines_.flush();
  Json summary;
  std::vector<double> whole, terrain, unfiltered, corrected;
  for (const Comparison& frame : frames_) {
    whole.push_back(frame.mesh.mean);
    if (frame.mesh.terrain) terrain.push_back(*frame.mesh.terrain);
    if (frame.unfiltered) unfiltered.push_back(frame.unfiltered->mean);
    if (frame.corrected) corrected.push_back(frame.corrected->mean);
  }
  summary["frames"] = frames_.size();
  summary["ssim_mean"] = mean(whole);
  summary["ssim_min"] = whole.empty() ? Json(nullptr) : Json(*std::ranges::min_element(whole));
  summary["ssim_frames"] = whole;
  summary["ssim_mean_terrain"] = mean(terrain);
  if (!unfiltered.empty()) summary["ssim_mean_unfiltered"] = mean(unfiltered);
  if (!corrected.empty()) summary["ssim_mean_corrected"] = mean(corrected);
  summary["ssim_settled"] = settled_ ? Json(settled_->mesh.mean) : Json(nullptr);
  summary["ssim_settled_terrain"] = settled_ && settled_->mesh.terrain ? Json(*settled_->mesh.terrain) : Json(nullptr);
  if (settled_ && settled_->unfiltered) summary["ssim_settled_unfiltered"] = settled_->unfiltered->mean;
  if (settled_ && settled_->corrected) summary["ssim_settled_corrected"] = settled_->corrected->mean;
  summary["terrain_share"] = settled_ ? Json(settled_->mesh.terrainShare) : Json(nullptr);
  summary["triangles"] = scene.triangles();
  summary["iterations_per_second"] = totals.seconds > 0 ? Json(static_cast<double>(iterations_) / totals.seconds) : Json(nullptr);
  summary["mesh_frame_ms"] = mean(meshMs_);
  if (!correctedMs_.empty()) summary["corrected_frame_ms"] = mean(correctedMs_);
  summary["raymarch_frame_ms"] = mean(marchMs_);
  summary["bytes_received"] = totals.bytesReceived;
  summary["iterations"] = iterations_;
  summary["hash_mismatches"] = mismatches_;
  summary["settled"] = totals.settled;
  summary["settle_seconds"] = totals.settleSeconds;
  summary["leaves"] = scene.leaves().size();
  summary["latency_ms_mean"] = latency_ / static_cast<double>(std::max<std::uint64_t>(iterations_, 1));
  summary["latency_ms_max"] = latencyWorst_;
  summary["metric"] = metricName(world.settings.metric);
  summary["threshold"] = world.settings.threshold;
  summary["budget"] = world.settings.triangleBudget;
  summary["width"] = view.camera.projection.width;
  summary["height"] = view.camera.projection.height;
  summary["samples"] = samples * samples;
  if (totals.popping) {
    summary["popping_off"] = totals.popping->worstOff;
    summary["popping_on"] = totals.popping->worstOn;
    summary["popping_frames"] = {{"off", totals.popping->off}, {"on", totals.popping->on}};
  }
  summary["pacing"] = totals.pacing;
  summary["path"] = totals.path;
  summary["terrain"] = world.terrainName;
  summary["seed"] = world.seed;
  summary["horizon"] = world.horizon;
  summary["server"] = world.serverName;
  summary["gl_renderer"] = totals.renderer;
  const std::filesystem::path file = folder_ / "summary.json";
  std::ofstream out(file, std::ios::trunc);
  out << summary.dump(2, ' ', false, Json::error_handler_t::replace) << '\n';
  out.close();
  if (!out) return cannotWrite(file);
  return {};
}

}  // namespace ridgecast::evaluation
