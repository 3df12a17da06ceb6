#include "server/pipeline/pipeline.h"

#include <algorithm>
#include <chrono>

#include "common/outcome/contract.h"
#include "server/pipeline/state.h"
#include "server/quadtree/quadtree.h"

namespace ridgecast::pipeline {

static_assert(Pipeline::kHorizon == quadtree::kHorizon);

namespace {
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace

settings::Settings grant(const settings::Settings& asked, const Limits& limits) {
  settings::Settings granted = asked;
  if (granted.metric == settings::Metric::kDefault) granted.metric = settings::Metric::kPixels;
  const settings::MetricTraits& metric = settings::traits(granted.metric);
  granted.threshold = std::clamp(granted.threshold > 0 ? granted.threshold : metric.threshold, metric.least, metric.most);
  if (granted.triangleBudget == 0) granted.triangleBudget = limits.defaultBudget;
  granted.triangleBudget = std::clamp(granted.triangleBudget, settings::kMinBudget, limits.maxBudget);
  granted.candidates = std::min(granted.candidates, settings::kMaxCandidates);
  if (granted.metric == settings::Metric::kThesis) granted.colourError = 0;
  if (granted.colourError > 0) granted.colourError = std::clamp(granted.colourError, settings::kMinColourError, settings::kMaxColourError);
  return granted;
}

Pipeline::Pipeline(std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted,
                   std::shared_ptr<scheduling::Pool> pool)
    : state_(std::make_unique<State>(std::move(terrain), granted, std::move(pool))) {}
Pipeline::~Pipeline() = default;

settings::IterationStats Pipeline::iterate(const camera::Camera& camera) {
  expects(camera::isValid(camera), "a camera that comes this far is valid");
  State& s = *state_;
  settings::IterationStats figures;
  const bool still = camera == s.motion.camera;
  if (s.settled && still) return s.describe(figures);  // nothing can change
  const std::uint64_t heightsBefore = s.mesh.mesh().heights() + s.horizon.heights();
  const double thresholdBefore = s.effective;
  Stopwatch watch;
  s.pool->wakeOne();

  // select
  const double ground = s.terrain->height({camera.pose.x, camera.pose.z});
  const generation::Selection selection = s.mesh.select(camera.pose, ground);
  figures.selectMs = watch.lap();

  // generate
  s.mesh.generate(*s.pool);
  s.evaluate(nullptr);
  figures.generateMs = watch.lap();

  // refine
  s.fitBudget(selection.changed);
  s.searchBound.begin(s.effective, s.isLimited());
  const bool raised = s.searchBound.isRaised();
  s.motion.follow(camera, selection.fromNothing);
  if (!still || selection.changed) s.restart();
  refinement::View view = s.view();
  if (s.closely) view.closely = s.spacing();
  s.castHorizon(view, ground);
  s.findWork(view);
  s.limitInsertions(view);
  figures.refineMs = watch.lap();

  // triangulate
  s.change(view, figures);
  figures.triangulateMs = watch.lap();
  s.evaluate(&view);
  figures.refineMs += watch.lap();
  s.publish(selection.changed);
  figures.triangulateMs += watch.lap();

  figures = s.describe(figures);
  figures.generatedLeaves = selection.generated;
  figures.droppedLeaves = selection.dropped;
  s.settle(still && !selection.changed && figures.inserted == 0 && figures.removed == 0 && s.effective == thresholdBefore && !raised, view);
  figures.refineMs += watch.lap();
  figures.heights = s.mesh.mesh().heights() + s.horizon.heights() - heightsBefore;
  return figures;
}

std::optional<MeshState> Pipeline::state() const {
  const State& s = *state_;
  if (s.leaves.empty()) return {};
  return MeshState{s.mesh.addresses(), s.mesh.vertices(), s.effective};
}

std::optional<settings::IterationStats> Pipeline::restore(const MeshState& from, const camera::Camera& camera) {
  expects(camera::isValid(camera) && state_->leaves.empty(), "a mesh is restored before its first iteration");
  Stopwatch watch;
  if (!state_->mesh.restore(from.leaves, from.vertices, *state_->pool)) {
    auto fresh = std::make_unique<State>(state_->terrain, state_->settings, state_->pool);
    fresh->insertionLimit = state_->insertionLimit;
    state_ = std::move(fresh);
    return {};
  }
  State& s = *state_;
  s.motion.camera = camera;
  s.effective = std::clamp(from.effectiveThreshold, s.settings.threshold, kMaxRaised * s.settings.threshold);
  settings::IterationStats figures;
  figures.generatedLeaves = static_cast<std::uint32_t>(from.leaves.size());
  figures.generateMs = watch.lap();
  s.evaluate(nullptr);
  s.publish(true);
  figures.refineMs = watch.lap();
  return s.describe(figures);
}

void Pipeline::change(const settings::Settings& granted) {
  expects(granted.threshold > 0 && granted.triangleBudget > 0, "settings are granted before they are taken");
  State& s = *state_;
  if (granted.metric != s.settings.metric || granted.colourError != s.settings.colourError || granted.triangleBudget > s.madeFor) {
    auto fresh = std::make_unique<State>(s.terrain, granted, s.pool);
    fresh->versions = fresh->outside = s.versions;
    fresh->insertionLimit = s.insertionLimit;
    state_ = std::move(fresh);
    return;
  }
  const bool other = granted.threshold != s.settings.threshold || granted.triangleBudget != s.settings.triangleBudget;
  // What the budget has raised the threshold to stays, until the mesh is small enough.
  s.effective = std::max(granted.threshold, s.effective > s.settings.threshold ? s.effective : 0.0);
  s.settings = granted;
  if (other) s.restart();
}

void Pipeline::setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) {
  expects(terrain != nullptr, "a mesh has ground");
  State& s = *state_;
  s.terrain = terrain;
  s.horizon.setTerrain(terrain, changed);
  s.mesh.setGround(std::move(terrain), changed, *s.pool);
  s.restart();
}

void Pipeline::setInsertionLimit(std::uint32_t most) { state_->insertionLimit = std::min<std::size_t>(most, kMaxInsertions); }

bool Pipeline::settled() const { return state_->settled; }

const std::vector<mesh::LeafState>& Pipeline::leaves() const { return state_->leaves; }

std::vector<lattice::Candidate> Pipeline::candidates(std::uint32_t most) const {
  const State& s = *state_;
  const refinement::View view = s.view();
  const auto& leafs = s.mesh.leaves();
  expects(s.seen.size() == leafs.size(), "candidates are listed between iterations");
  std::vector<std::vector<refinement::ListedCandidate>> found(leafs.size());
  s.pool->forEach(leafs.size(), 16, [&](std::size_t k) {
    if (!s.seen[k]) return;
    s.mesh.mesh().list(leafs[k]->region, view, found[k]);
    refinement::keepWorst(found[k], most);
  });
  std::vector<refinement::ListedCandidate> all;
  for (const auto& leaf : found) all.insert(all.end(), leaf.begin(), leaf.end());
  refinement::keepWorst(all, most);
  std::vector<lattice::Candidate> out;
  out.reserve(all.size());
  for (const auto& c : all) {
    const lattice::Point at = s.mesh.mesh().absolute(c.point);
    out.push_back({{at.x, at.z, c.y}, c.pixels});
  }
  return out;
}

mesh::LeafMesh Pipeline::extract(lattice::LeafAddress address) const {
  const Leaf* leaf = state_->mesh.leaf(address);
  if (leaf) return state_->mesh.mesh().extract(leaf->region, address);
  mesh::LeafMesh nothing;
  nothing.address = address;
  return nothing;
}

IteratingMesh::Surface Pipeline::surface() const {
  const refinement::AdaptiveMesh& m = state_->mesh.mesh();
  return {&m.triangulation(), m.anchor(), state_->outside};
}

std::uint32_t Pipeline::region(lattice::LeafAddress address) const {
  const Leaf* leaf = state_->mesh.leaf(address);
  expects(leaf != nullptr, "a leaf that is asked for is one of the mesh's");
  return leaf->region;
}

void Pipeline::takeFresh(lattice::LeafAddress address, std::vector<triangulation::VertexId>& out) {
  state_->mesh.mesh().takeFreshVertices(region(address), out);
}

std::size_t Pipeline::memoryBytes() const { return state_->mesh.memoryBytes(); }

const generation::CameraMesh& Pipeline::mesh() const { return state_->mesh; }

}  // namespace ridgecast::pipeline
