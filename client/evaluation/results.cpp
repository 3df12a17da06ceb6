#include "client/evaluation/results.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace ridgecast::evaluation {
namespace {

using OrderedJson = nlohmann::ordered_json;

enum class In { kAlways, kIfMeasured };

// The keys of summary.json.
void eachField(const FlightSummary& s, const auto& field) {
  field("frames", s.frames.count);
  field("ssim_mean", s.mean.ssim);
  field("ssim_min", s.frames.least);
  field("ssim_frames", s.frames.ssim);
  field("frames_t", s.frames.t);
  field("frames_names", s.frames.names);
  field("ssim_mean_terrain", s.mean.terrain);
  field("ssim_mean_unfiltered", s.mean.unfiltered, In::kIfMeasured);
  field("ssim_mean_corrected", s.mean.corrected, In::kIfMeasured);
  field("ssim_settled", s.settled.ssim);
  field("ssim_settled_terrain", s.settled.terrain);
  field("ssim_settled_unfiltered", s.settled.unfiltered, In::kIfMeasured);
  field("ssim_settled_corrected", s.settled.corrected, In::kIfMeasured);
  field("terrain_share", s.terrainShare);
  field("triangles", s.triangles);
  field("iterations_per_second", s.iterationsPerSecond);
  field("mesh_frame_ms", s.mesh.ms);
  field("mesh_frame_cpu_ms", s.mesh.cpuMs);
  field("corrected_frame_ms", s.corrected.ms, In::kIfMeasured);
  field("corrected_frame_cpu_ms", s.corrected.cpuMs, In::kIfMeasured);
  field("raymarch_frame_ms", s.raymarch.ms);
  field("raymarch_frame_cpu_ms", s.raymarch.cpuMs);
  field("bytes_received", s.bytesReceived);
  field("reconnections", s.reconnections);
  field("iterations", s.iterations);
  field("hash_mismatches", s.hashMismatches);
  field("settled", s.isSettled);
  field("settle_seconds", s.settleSeconds);
  field("leaves", s.leaves);
  field("latency_ms_mean", s.latencyMsMean);
  field("latency_ms_max", s.latencyMsMax);
  field("metric", s.settings.metric);
  field("threshold", s.settings.threshold);
  field("budget", s.settings.budget);
  field("width", s.settings.width);
  field("height", s.settings.height);
  field("samples", s.settings.samples);
  field("popping_off", s.popping.off, In::kIfMeasured);
  field("popping_on", s.popping.on, In::kIfMeasured);
  field("popping_frames", s.popping.frames, In::kIfMeasured);
  field("pacing", s.settings.pacing);
  field("path", s.settings.path);
  field("terrain", s.settings.terrain);
  field("seed", s.settings.seed);
  field("horizon", s.settings.horizon);
  field("server", s.settings.server);
  field("gl_renderer", s.settings.renderer);
}

// The keys of a line of iterations.jsonl.
void eachField(const IterationResult& r, const auto& field) {
  field("iteration", r.number);
  field("pose", r.pose);
  field("t", r.t);
  field("select_ms", r.figures.selectMs);
  field("generate_ms", r.figures.generateMs);
  field("refine_ms", r.figures.refineMs);
  field("triangulate_ms", r.figures.triangulateMs);
  field("encode_ms", r.figures.encodeMs);
  field("apply_ms", r.applyMs);
  field("latency_ms", r.latencyMs);
  field("triangles", r.figures.triangles);
  field("triangles_held", r.trianglesHeld);
  field("inserted", r.figures.inserted);
  field("removed", r.figures.removed);
  field("deferred", r.figures.deferred);
  field("heights", r.figures.heights);
  field("leaves", r.figures.leaves);
  field("leaves_visible", r.figures.visibleLeaves);
  field("leaves_generated", r.figures.generatedLeaves);
  field("leaves_dropped", r.figures.droppedLeaves);
  field("leaves_sent", r.leavesSent);
  field("leaves_gone", r.leavesGone);
  field("bytes", r.bytes);
  field("effective_threshold", r.figures.effectiveThreshold);
  field("settled", r.settled);
  field("hash_ok", r.hashOk);
  field("upload_ms", r.uploadMs, In::kIfMeasured);
  field("draw_ms", r.drawMs, In::kIfMeasured);
}

std::string write(const auto& results, int indent) {
  OrderedJson out;
  eachField(results, [&](const char* key, const auto& value, In in = In::kAlways) {
    OrderedJson json = value;
    if (json.is_number_float() && std::isnan(json.get<double>())) json = nullptr;
    if (in != In::kIfMeasured || !json.empty()) out[key] = std::move(json);
  });
  return out.dump(indent, ' ', false, OrderedJson::error_handler_t::replace) + "\n";
}

}  // namespace

std::string asJson(const FlightSummary& summary) { return write(summary, 2); }
std::string asJson(const IterationResult& result) { return write(result, -1); }

}  // namespace ridgecast::evaluation
