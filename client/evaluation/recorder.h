#pragma once
// What a flight leaves behind in its folder: pictures of both renderings, iterations.jsonl and summary.json.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "client/evaluation/popping.h"
#include "client/evaluation/references.h"
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
  // Where frames are measured: bringing the graphics card up to date, and drawing.
  std::optional<double> uploadMs, drawMs;
};

// One picture of the mesh against the ray march of the same camera.
struct Comparison {
  std::string name;  // of its files
  double t = 0;      // seconds of path time
  Similarity mesh;
  std::optional<Similarity> corrected, unfiltered;  // where asked for
};

struct PictureSettings {
  std::uint32_t samples = 1;  // a side of each pixel
  bool corrected = false, unfiltered = false;
  References* references = nullptr;  // where the ray march is looked for and kept; null: it is drawn
};

struct Totals {
  double seconds = 0;  // of wall time in which iterations ran, pictures not counted
  std::uint64_t bytesReceived = 0, reconnections = 0;
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

  // Draws both renderings, writes NAME-mesh.png and NAME-raymarch.png (NAME-corrected.png, too, where asked for) and compares them.
  // A ray march that the references have is not drawn again; its time is what it took then.
  Outcome<Comparison> picture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene, const render::View& view,
                              const PictureSettings& settings);
  // Draws the mesh alone, where this client knows no terrain to compare it with, and writes NAME-mesh.png.
  Outcome<void> meshPicture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene, const render::View& view,
                            std::uint32_t samples);
  // Counts a comparison among the flight's frames, at `t` seconds of path time, or as the one at rest.
  void addFrame(Comparison comparison, double t);
  void setSettled(const Comparison& comparison) { settled_ = comparison; }

  std::uint64_t hashMismatches() const { return mismatches_; }
  Outcome<void> writeSummary(const wire::World& world, const scene::Scene& scene, const render::View& view, std::uint32_t samples,
                             const Totals& totals);

 private:
  explicit Recorder(std::filesystem::path folder);
  struct Times {  // of a frame each
    std::vector<double> milliseconds, cpuMilliseconds;
    void add(double wall, double cpu) {
      milliseconds.push_back(wall);
      cpuMilliseconds.push_back(cpu);
    }
  };
  Outcome<References::March> march(const std::string& name, render::Renderer& renderer, const render::View& view, std::uint32_t samples,
                                   bool unfiltered);
  std::filesystem::path folder_;
  std::ofstream lines_;
  std::uint64_t iterations_ = 0, mismatches_ = 0;
  double latency_ = 0, latencyWorst_ = 0;
  std::vector<Comparison> frames_;
  Times meshTimes_, correctedTimes_, marchTimes_;
  std::optional<Comparison> settled_;
};

}  // namespace ridgecast::evaluation
