#pragma once
// What a flight leaves behind in its folder: pictures of both renderings, iterations.jsonl and summary.json.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "client/evaluation/popping.h"
#include "client/evaluation/ssim.h"
#include "client/render/renderer.h"
#include "client/scene/scene.h"
#include "common/wire/messages.h"

namespace ridgecast::evaluation {

// One iteration as the client saw it.
struct IterationRecord {
  double t = 0;             // seconds of path time of its pose
  std::uint64_t bytes = 0;  // of its message
  double latencyMs = 0;     // from sending its pose to having its message
  double applyMs = 0;       // decoding and applying
  bool hashOk = false;      // the mesh held afterwards is the server's
  std::uint64_t held = 0;   // triangles held afterwards
};

struct Totals {
  double seconds = 0;  // of wall time in which iterations ran, pictures not counted
  std::uint64_t bytesReceived = 0;
  bool settled = false;
  double settleSeconds = 0;
  std::string pacing, path, renderer;
  std::optional<Popping> popping;
};

class Recorder {
 public:
  // Makes the folder. Error: it cannot be made or written.
  static Outcome<Recorder> create(const std::filesystem::path& folder);

  Outcome<void> add(const wire::Iteration& iteration, const IterationRecord& record);

  // Draws both renderings, writes NAME-mesh.png and NAME-raymarch.png and compares them.
  Outcome<Similarity> picture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene, const render::View& view,
                              std::uint32_t samples);
  // Draws the mesh alone, where this client knows no terrain to compare it with, and writes NAME-mesh.png.
  Outcome<void> meshPicture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene, const render::View& view,
                            std::uint32_t samples);
  // Counts a comparison among the flight's frames, or as the one at rest.
  void addFrame(const Similarity& similarity);
  void setSettled(const Similarity& similarity) { settled_ = similarity; }

  std::uint64_t hashMismatches() const { return mismatches_; }
  Outcome<void> writeSummary(const wire::World& world, const scene::Scene& scene, const render::View& view, std::uint32_t samples,
                             const Totals& totals);

 private:
  explicit Recorder(std::filesystem::path folder);
  std::filesystem::path folder_;
  std::ofstream lines_;
  std::uint64_t iterations_ = 0, mismatches_ = 0;
  double latency_ = 0, latencyWorst_ = 0;
  std::vector<double> frames_;  // SSIM of each
  std::vector<double> meshMs_, marchMs_;
  std::optional<Similarity> settled_;
};

}  // namespace ridgecast::evaluation
