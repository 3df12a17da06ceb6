#pragma once
// The two pictures of the window. On a graphics card each is drawn whole every frame. In software, each pane measures the cost of a sample;
// while the camera moves it draws as many as fit its budget, stretched, and once the camera rests it draws finer ones. An up-to-date pane
// draws nothing. The mesh is corrected onto the true surface (render/correction_pass.h) while a picture stays within its budget, and
// always once the camera rests.

#include <chrono>
#include <cstdint>
#include <optional>
#include <utility>

#include "client/render/difference_pass.h"
#include "client/render/morph.h"
#include "client/render/renderer.h"
#include "client/render/structure_pass.h"
#include "client/render/surface.h"
#include "client/viewer/mesh_cost.h"

namespace ridgecast::viewer {

inline constexpr std::chrono::milliseconds kMeshBudget{40}, kMarchBudget{40};  // each frame, while the camera moves
inline constexpr std::chrono::milliseconds kRefiningBudget{100};               // for the mesh, while only the mesh changes

// Errors: a shader that the driver does not compile.
struct Passes : render::Passes {
  render::StructurePass structure;
  render::DifferencePass difference;
  static Outcome<Passes> create(const render::TerrainText& text);
};

// A surface and the canvas it is shaded into, `coarseness` pixels a sample.
struct Layer {
  std::uint32_t coarseness = 0;
  render::Surface surface;
  render::Canvas canvas;
};

class MeshPane {
 public:
  explicit MeshPane(Passes& passes) : passes_(passes) {}
  // Returns whether it drew or will soon draw finer. `sceneVersion` tells scenes apart. Error: the window is larger than the driver can
  // draw.
  Outcome<bool> update(const render::View& view, const core::Scene& scene, std::uint64_t sceneVersion, bool moving);
  // Shows changes of the mesh over a fraction of a second (render/morph.h), or at once.
  void setSmooth(bool smooth) { smooth_ = smooth; }
  // Whether to correct the mesh, if the terrain's function is known.
  void setCorrected(bool corrected) { mayCorrect_ = corrected && passes_.correction.canCorrect(); }
  bool isCorrected() const { return corrected_; }  // what is shown
  // What to draw over the picture from the next update on; redraws.
  void setStructure(render::Structure structure) {
    structure_ = std::move(structure);
    restructured_ = true;
  }
  const render::Canvas* canvas() const { return layer_ ? &layer_->canvas : nullptr; }
  double milliseconds() const { return milliseconds_; }
  // Drawn in full, and nothing moves.
  bool isAtRest() const { return layer_ && layer_->coarseness == 1 && corrected_ == mayCorrect_ && !morph_.active(); }

 private:
  Outcome<void> fitBefore();
  Outcome<void> draw(const render::View& samples, bool corrects, double now);
  Passes& passes_;
  render::Morph morph_;
  render::Structure structure_;
  bool smooth_ = true, restructured_ = false, mayCorrect_ = false, corrected_ = false;
  std::optional<Layer> layer_;
  std::optional<render::Surface> first_, second_;  // of the layer's size, while the mesh morphs or is corrected
  std::uint64_t sceneVersion_ = ~std::uint64_t{0}, shownVersion_ = ~std::uint64_t{0};
  std::chrono::steady_clock::time_point sceneChanged_{};
  double milliseconds_ = 0;
  MeshCost cost_;
};

class MarchPane {
 public:
  explicit MarchPane(Passes& passes) : passes_(passes) {}
  Outcome<bool> update(const render::View& view, bool moving);
  const render::Canvas* canvas() const { return shown_ ? &shown_->canvas : nullptr; }
  double milliseconds() const { return milliseconds_; }  // of the last complete picture
  bool isFinest() const { return shown_ && shown_->coarseness == 1; }
  std::uint32_t coarseness() const { return shown_ ? shown_->coarseness : 0; }
  double progress() const { return next_ ? passes_.march.progress() : 1; }

 private:
  Outcome<void> begin(const render::View& view, std::uint32_t coarseness);
  bool advance(std::chrono::milliseconds budget);

  Passes& passes_;
  std::optional<Layer> shown_, next_, spare_;
  render::View view_;  // of next_, in samples
  double milliseconds_ = 0, spent_ = 0, perSample_ = 0;
};

}  // namespace ridgecast::viewer
