#pragma once
// What a flight leaves behind in its folder: pictures of both renderings, iterations.jsonl and summary.json; and the mesh as glTF.

#include <cstdint>
#include <deque>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "client/core/mesh/scene.h"
#include "client/evaluation/results.h"
#include "client/render/renderer.h"
#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// Ray marches shared by the flights over one terrain: in lock-step all of them see from the same places, and a ray march does not depend on
// the mesh.
class References {
 public:
  struct March {
    camera::Camera camera;
    std::uint32_t samples = 1;  // a side of each pixel
    render::Picture filtered;
    std::optional<render::Picture> unfiltered;
    double milliseconds = 0, cpuMilliseconds = 0;  // of drawing it, filtered
    std::filesystem::path file;                    // that holds `filtered`
  };

  // Keeps `most` of them, 1 and up; the oldest go first. One of 1280 x 720 pixels has 7 MB.
  explicit References(std::size_t most) : most_(most) { expects(most >= 1, "there is room for one ray march"); }

  // The march for this camera, with an unfiltered picture if requested; null: none yet. Valid until the next `keep`.
  const March* find(const camera::Camera& camera, std::uint32_t samples, bool unfiltered) const;
  const March& keep(March march);
  // For another terrain.
  void clear() { marches_.clear(); }

 private:
  std::size_t most_;
  std::deque<March> marches_;
};

// One picture of the mesh against the ray march of the same camera.
struct Comparison {
  Likeness likeness;
  double terrainShare = 0;  // of the picture, 0..1
};

struct PictureSettings {
  std::uint32_t samples = 1;  // a side of each pixel
  bool corrected = false, unfiltered = false;
  References* references = nullptr;  // the ray march is looked for and kept there; null: it is drawn
};

class Recorder {
 public:
  // Makes the folder. Error: it cannot be made or written.
  static Outcome<Recorder> create(const std::filesystem::path& folder);

  Outcome<void> add(const IterationResult& result);

  // Draws both renderings, writes NAME-mesh.png and NAME-raymarch.png (and NAME-corrected.png if requested) and compares them.
  // A ray march among the references is not drawn again; its time is what it took then.
  Outcome<Comparison> picture(const std::string& name, render::Renderer& renderer, const core::Scene& scene, const render::View& view,
                              const PictureSettings& settings);
  // Draws the mesh alone, for a terrain that this client does not know, and writes NAME-mesh.png.
  Outcome<void> meshPicture(const std::string& name, render::Renderer& renderer, const core::Scene& scene, const render::View& view,
                            std::uint32_t samples);
  // Counts a picture among the flight's frames, at `t` seconds of path time.
  void addFrame(const std::string& name, double t, const Likeness& likeness);

  // The caller fills in what the recorder does not know.
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

// The held mesh as an uncompressed binary glTF file (common/gltf/glb.h): one node for each leaf, empty ones included. The file's cell is
// the camera's; asset.extras has terrain and seed beside what every file has. Error: the mesh is too large for a .glb (4 GiB), a height or
// extent is not exact in a float (65 km), or the file cannot be written.
Outcome<void> writeGlb(const core::Leaves& leaves, const camera::Pose& pose, const std::string& terrain, std::uint32_t seed,
                       const std::filesystem::path& file);

}  // namespace ridgecast::evaluation
