#include "client/evaluation/recorder.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>
#include <system_error>
#include <utility>

#include "common/settings/settings.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::ordered_json;

Json mean(const std::vector<double>& values) {
  if (values.empty()) return nullptr;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

// Of times: a frame that something else on the machine held up is one of many.
Json median(std::vector<double> values) {
  if (values.empty()) return nullptr;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
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
  Comparison out{name, 0, {}, {}, {}};
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
  out.mesh = similarity(mesh->picture, truth->filtered);
  if (meshPoints && truth->unfiltered) out.unfiltered = similarity(*meshPoints, *truth->unfiltered);
  if (corrected) out.corrected = similarity(*corrected, truth->filtered);
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
    render::View points = view;
    points.filtered = false;
    auto again = renderer.shadeAgain(points, samples);
    if (!again) return again.error();
    out.unfiltered = std::move(again->picture);
  }
  if (auto written = render::writePng(out.filtered, out.file); !written) return written.error();
  return out;
}

void Recorder::addFrame(Comparison comparison, double t) {
  comparison.t = t;
  frames_.push_back(std::move(comparison));
}

Outcome<void> Recorder::meshPicture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene,
                                    const render::View& view, std::uint32_t samples) {
  auto mesh = renderer.drawMesh(scene, view, samples);
  if (!mesh) return mesh.error();
  meshTimes_.add(mesh->milliseconds, mesh->cpuMilliseconds);
  return render::writePng(mesh->picture, folder_ / (name + "-mesh.png"));
}

Outcome<void> Recorder::writeSummary(const wire::World& world, const scene::Scene& scene, const render::View& view, std::uint32_t samples,
                                     const Totals& totals) {
  lines_.flush();
  Json summary;
  std::vector<double> whole, terrain, unfiltered, corrected, times;
  std::vector<std::string> names;
  for (const Comparison& frame : frames_) {
    whole.push_back(frame.mesh.mean);
    times.push_back(frame.t);
    names.push_back(frame.name);
    if (frame.mesh.terrain) terrain.push_back(*frame.mesh.terrain);
    if (frame.unfiltered) unfiltered.push_back(frame.unfiltered->mean);
    if (frame.corrected) corrected.push_back(frame.corrected->mean);
  }
  summary["frames"] = frames_.size();
  summary["ssim_mean"] = mean(whole);
  summary["ssim_min"] = whole.empty() ? Json(nullptr) : Json(*std::ranges::min_element(whole));
  summary["ssim_frames"] = whole;
  summary["frames_t"] = times;
  summary["frames_names"] = names;
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
  for (const auto& [name, drawn] :
       {std::pair("mesh", &meshTimes_), std::pair("corrected", &correctedTimes_), std::pair("raymarch", &marchTimes_)}) {
    if (drawn == &correctedTimes_ && drawn->milliseconds.empty()) continue;
    summary[std::string(name) + "_frame_ms"] = median(drawn->milliseconds);
    summary[std::string(name) + "_frame_cpu_ms"] = median(drawn->cpuMilliseconds);
  }
  summary["bytes_received"] = totals.bytesReceived;
  summary["reconnections"] = totals.reconnections;
  summary["iterations"] = iterations_;
  summary["hash_mismatches"] = mismatches_;
  summary["settled"] = totals.settled;
  summary["settle_seconds"] = totals.settleSeconds;
  summary["leaves"] = scene.leaves().size();
  summary["latency_ms_mean"] = latency_ / static_cast<double>(std::max<std::uint64_t>(iterations_, 1));
  summary["latency_ms_max"] = latencyWorst_;
  summary["metric"] = settings::traits(world.settings.metric).name;
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
