#include "client/viewer/panes.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <utility>

#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kRest{400};  // after this time without a change the mesh is drawn in full

// Keeps `layer` if it already has that size.
Outcome<void> fit(std::optional<Layer>& layer, const render::View& view, std::uint32_t coarseness, bool carried = false) {
  const std::uint32_t width = view.camera.projection.width, height = view.camera.projection.height;
  if (layer && layer->canvas.width() == width && layer->canvas.height() == height) {
    layer->coarseness = coarseness;
    return {};
  }
  layer.reset();
  auto surface = render::Surface::create(width, height, carried);
  if (!surface) return surface.error();
  auto canvas = render::Canvas::create(width, height);
  if (!canvas) return canvas.error();
  layer.emplace(Layer{coarseness, std::move(*surface), std::move(*canvas)});
  return {};
}

}  // namespace

Outcome<Passes> Passes::create(const render::TerrainText& text) {
  auto world = render::Passes::create(text);
  if (!world) return world.error();
  auto structure = render::StructurePass::create();
  if (!structure) return structure.error();
  auto difference = render::DifferencePass::create();
  if (!difference) return difference.error();
  return Passes{std::move(*world), std::move(*structure), std::move(*difference)};
}

Outcome<void> MeshPane::fitBefore() {
  const render::Surface& size = layer_->surface;
  if (auto fitted = render::fit(first_, size.width(), size.height(), passes_.mesh.shaded()); !fitted) return fitted;
  return render::fit(second_, size.width(), size.height(), passes_.mesh.shaded());
}

Outcome<bool> MeshPane::update(const render::View& view, const core::Scene& scene, std::uint64_t sceneVersion, bool moving) {
  const double now = nowInSeconds();
  const bool wasActive = morph_.active();
  morph_.advance(scene.leaves(), sceneVersion, now, smooth_);
  const bool sceneChanged = sceneVersion != sceneVersion_;
  sceneVersion_ = sceneVersion;
  if (sceneChanged) sceneChanged_ = Clock::now();
  const bool morphing = morph_.active() || wasActive || morph_.version() != shownVersion_;
  const bool refining = morphing || Clock::now() - sceneChanged_ < kRest, rests = !moving && !refining;
  const std::chrono::milliseconds budget = moving ? kMeshBudget : kRefiningBudget;
  const std::uint32_t coarseness = rests ? 1 : cost_.coarseness(view, budget);
  const render::View samples = coarser(view, coarseness);
  const bool corrects = mayCorrect_ && (rests || cost_.correctsInTime(samples, budget));
  const bool fits = layer_ && layer_->coarseness == coarseness && layer_->canvas.width() == samples.camera.projection.width &&
                    layer_->canvas.height() == samples.camera.projection.height && corrects == corrected_;
  if (fits && !moving && !morphing && !restructured_) return refining && (coarseness > 1 || corrects != mayCorrect_);
  restructured_ = false;
  if (auto fitted = fit(layer_, samples, coarseness, passes_.mesh.shaded()); !fitted) return fitted.error();
  if (morph_.version() != shownVersion_) {
    passes_.before.update(morph_.from());
    passes_.mesh.update(morph_.to());
    shownVersion_ = morph_.version();
  }
  if (auto drawn = draw(samples, corrects, now); !drawn) return drawn.error();
  return true;
}

// Into the layer; measures what a sample costs.
Outcome<void> MeshPane::draw(const render::View& samples, bool corrects, double now) {
  const auto began = Clock::now();
  if (morph_.active() || corrects)
    if (auto fitted = fitBefore(); !fitted) return fitted;
  if (morph_.active()) {
    passes_.before.draw(samples, *first_);
    passes_.mesh.draw(samples, *second_);
    passes_.morph.blend(*first_, *second_, morph_.share(now), layer_->surface);
  } else {
    passes_.mesh.draw(samples, layer_->surface);
  }
  double correction = 0;
  if (corrects) {
    glFinish();
    const auto drawn = Clock::now();
    passes_.correction.correct(samples, layer_->surface, *first_);
    glFinish();
    correction = 1e3 * secondsSince(drawn);
  }
  passes_.shade.shade(samples, corrects ? *first_ : layer_->surface, layer_->canvas);
  passes_.structure.draw(samples, passes_.mesh, layer_->surface, layer_->canvas, structure_);
  glFinish();
  corrected_ = corrects;
  milliseconds_ = 1e3 * secondsSince(began);
  cost_.drew(samples, milliseconds_, correction);
  return {};
}

Outcome<void> MarchPane::begin(const render::View& view, std::uint32_t coarseness) {
  if (next_) spare_ = std::exchange(next_, std::nullopt);
  view_ = coarser(view, coarseness);
  if (auto fitted = fit(spare_, view_, coarseness); !fitted) return fitted.error();
  next_ = std::exchange(spare_, std::nullopt);
  passes_.march.begin(view_, next_->surface);
  spent_ = 0;
  return {};
}

bool MarchPane::advance(std::chrono::milliseconds budget) {
  const auto began = Clock::now();
  const bool complete = passes_.march.advance(budget);
  if (complete) {
    passes_.shade.shade(view_, next_->surface, next_->canvas);
    glFinish();
  }
  spent_ += 1e3 * secondsSince(began);
  if (!complete) return false;
  milliseconds_ = spent_;
  perSample_ = spent_ / samplesOf(view_);
  spare_ = std::exchange(shown_, std::exchange(next_, std::nullopt));
  return true;
}

Outcome<bool> MarchPane::update(const render::View& view, bool moving) {
  if (moving || !shown_) {
    // The first picture is a coarse one: its cost is unknown.
    if (auto begun = begin(view, shown_ ? fitting(view, perSample_, kMarchBudget) : kCoarsest); !begun) return begun.error();
    advance(std::chrono::hours(1));
    return true;
  }
  if (!next_) {
    if (isFinest()) return false;
    if (auto begun = begin(view, std::max(1u, shown_->coarseness / 4)); !begun) return begun.error();
  }
  return advance(kMarchBudget);
}

}  // namespace ridgecast::viewer
