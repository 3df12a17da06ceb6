#pragma once
// Cameras at rest over settled meshes, measured against the converged ray march: the same for every terrain.

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "client/core/mesh/scene.h"
#include "client/evaluation/missing.h"
#include "client/render/renderer.h"

namespace ridgecast::evaluation {

// A camera of the evaluation.
struct ViewCase {
  std::string_view terrain, name;  // name: low, overview, grazing
  double x = 0, z = 0;             // metres
  double altitude = 0;             // metres above the ground there
  double yaw = 0, pitch = 0;       // degrees
};
std::span<const ViewCase> viewCases();
std::string pathOf(const ViewCase& view);  // as a path file of one keyframe

// How a mesh is refined.
struct MeshCase {
  std::string metric;  // pixels, area, thesis
  double threshold = 0;
  std::uint32_t mostSamples = 8;  // most samples a side of each pixel that it is drawn with
  friend bool operator==(const MeshCase&, const MeshCase&) = default;
};

// A camera at rest, once its mesh is refined (fly.h).
struct AtRest {
  render::Renderer& renderer;
  const core::Scene& scene;
  const render::View& view;
  const terrain::Terrain* terrain;  // null: the client does not know it
  bool settled;                     // false: the settle limit ran out
};

struct ViewSettings {
  std::vector<std::uint32_t> samples = {1, 2};  // a side of each pixel; ascending, the first is 1
  int repeats = 3;                              // of what is timed, of each mesh
  int marches = 3;                              // of them, how many also time the ray march, 1..repeats: it is the same for every mesh
};

// One view, with several meshes in turn, each with a context and a connection of its own. The ray march is drawn once for all of them.
// Leaves in `folder`: view.json, march.png, mesh.png, corrected.png and loss.png (1 - SSIM, white is 0.25 and more) of the last mesh.
class ViewMeasurement {
 public:
  ViewMeasurement(const ViewCase& view, ViewSettings settings, std::filesystem::path folder);
  ~ViewMeasurement();
  ViewMeasurement(const ViewMeasurement&) = delete;
  ViewMeasurement& operator=(const ViewMeasurement&) = delete;

  // Errors: a picture larger than the driver draws, a file that cannot be written, a terrain that the client does not know.
  Outcome<void> measure(const MeshCase& mesh, const AtRest& at);
  // Writes view.json, whole or not at all.
  Outcome<void> finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace ridgecast::evaluation
