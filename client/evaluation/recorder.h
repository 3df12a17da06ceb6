#pragma once
// What a flight leaves behind in its folder: pictures of both renderings, iterations.jsonl and summary.json.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "client/evaluation/references.h"
#include "client/evaluation/results.h"
#include "client/render/renderer.h"
#include "client/scene/scene.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// One picture of the mesh against the ray march of the same camera.
struct Comparison {
  Likeness likeness;
  double terrainShare = 0;  // of the picture, 0..1
};

struct PictureSettings {
  std::uint32_t samples = 1;  // a side of each pixel
  bool corrected = false, unfiltered = false;
  References* references = nullptr;  // where the ray march is looked for and kept; null: it is drawn
};

class Recorder {
 public:
  // Makes the folder. Error: it cannot be made or written.
  static Outcome<Recorder> create(const std::filesystem::path& folder);

  Outcome<void> add(const IterationResult& result);

  // Draws both renderings, writes NAME-mesh.png and NAME-raymarch.png (NAME-corrected.png, too, where asked for) and compares them.
  // A ray march that the references have is not drawn again; its time is what it took then.
  Outcome<Comparison> picture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene, const render::View& view,
                              const PictureSettings& settings);
  // Draws the mesh alone, where this client knows no terrain to compare it with, and writes NAME-mesh.png.
  Outcome<void> meshPicture(const std::string& name, render::Renderer& renderer, const scene::Scene& scene, const render::View& view,
                            std::uint32_t samples);
  // Counts a picture among the flight's frames, at `t` seconds of path time.
  void addFrame(const std::string& name, double t, const Likeness& likeness);

  // What others than the recorder know is for them to fill in.
  FlightSummary& summary() { return summary_; }
  // `seconds`: of wall time in which iterations ran, pictures not counted.
  Outcome<void> writeSummary(double seconds);

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
  FlightSummary summary_;
  std::vector<Likeness> frames_;
  Times meshTimes_, correctedTimes_, marchTimes_;
};

}  // namespace ridgecast::evaluation
