#include "server/pipeline/pipeline.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <numbers>

#include "server/pipeline/camera_mesh.h"
#include "server/refinement/candidate_list.h"
#include "server/refinement/coarsening.h"
#include "server/triangulation/verify.h"

namespace ridgecast::pipeline {

using refinement::Pending;
using triangulation::TriangleId;
using triangulation::VertexId;

static_assert(Pipeline::kHorizon == quadtree::kHorizon);

namespace {

constexpr double kDefaultPixels = 0.6, kDefaultArea = 1.2, kDefaultThesis = 2e-5;
// At most so many insertions an iteration, the most wanted first, so that the newest camera is never far away.
constexpr std::size_t kMostInsertions = 24'000;
// A budget that binds raises the threshold by at most this factor: one below the grids alone, which always stay, cannot be kept.
constexpr double kMostRaised = 100;
// A close look tries points this many pixels apart for each pixel of the threshold, within bounds.
constexpr double kClosely = 12, kLeastClosely = 4, kMostClosely = 100;
// Vertices are removed below this share of the threshold.
constexpr double kRemoval = 0.5;
// The thesis never removes; with its metric vertices go only in leaves that the wide frustum does not see, when the budget is nearly full.
constexpr double kThesisRemovalPixels = 1.0;
// "Nearly full": leaves outside the wide frustum then lose vertices below the whole threshold.
constexpr double kTight = 0.9;

struct RemovalLimits {
  double inside, outside;  // pixels of loss, for leaves that may be seen and for the others
};
RemovalLimits removalLimits(bool thesis, double threshold, double fill) {
  const bool tight = fill >= kTight;
  if (thesis) return {0, tight ? kThesisRemovalPixels : 0};
  return {kRemoval * threshold, (tight ? 1 : kRemoval) * threshold};
}

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

wire::Settings grant(const wire::Settings& asked, const Limits& limits) {
  wire::Settings granted = asked;
  if (granted.metric == wire::Metric::kDefault) granted.metric = wire::Metric::kPixels;
  const bool thesis = granted.metric == wire::Metric::kThesis;
  if (!(granted.threshold > 0))
    granted.threshold = thesis ? kDefaultThesis : granted.metric == wire::Metric::kArea ? kDefaultArea : kDefaultPixels;
  granted.threshold = std::clamp(granted.threshold, thesis ? 1e-9 : 0.05, thesis ? 1e9 : 1000.0);
  if (granted.triangleBudget == 0) granted.triangleBudget = limits.defaultBudget;
  granted.triangleBudget = std::clamp<std::uint32_t>(granted.triangleBudget, 10'000, limits.maxBudget);
  granted.candidates = std::min(granted.candidates, wire::kMaxCandidates);
  return granted;
}

namespace {
refinement::Metric metricOf(wire::Metric metric) {
  return metric == wire::Metric::kThesis ? refinement::Metric::kThesis
         : metric == wire::Metric::kArea ? refinement::Metric::kArea
                                         : refinement::Metric::kPixels;
}
}  // namespace

struct Pipeline::State {
  State(std::shared_ptr<const terrain::Terrain> terrain, const wire::Settings& granted, std::shared_ptr<scheduling::Pool> workers)
      : settings(granted),
        madeFor(granted.triangleBudget),
        ground(terrain),
        pool(std::move(workers)),
        horizon(terrain),
        mesh(std::move(terrain), granted.triangleBudget, metricOf(granted.metric)),
        effective(granted.threshold) {}

  void advance(const camera::Camera& camera, bool anew);
  void lookAround(const camera::Camera& camera, refinement::View& view);
  void screen(const camera::Camera& camera, const refinement::View& view, const RemovalLimits& removal);
  void limitPending(const refinement::View& view);
  void publish(bool otherLeaves);
  std::uint32_t owned() const;
  double spacing() const { return std::clamp(kClosely * effective, kLeastClosely, kMostClosely); }
  void describe(wire::Figures& figures) const;

  wire::Settings settings;
  std::uint32_t madeFor;  // triangles that the mesh has room for
  std::shared_ptr<const terrain::Terrain> ground;
  std::shared_ptr<scheduling::Pool> pool;
  refinement::Horizon horizon;
  CameraMesh mesh;
  std::size_t insertionLimit = kMostInsertions;
  double effective;        // threshold; above the asked one while the budget binds
  double left = 0;         // the greatest error, as seen, of what the budget kept out
  std::uint32_t live = 0;  // triangles owned by leaves
  // A camera at rest for which nothing is left to do looks closely, once, and at whatever changes after that. Only then is the mesh settled.
  bool closely = false;
  bool settled = false;
  camera::Camera latest;    // of the last iteration that did anything
  double travel = 0, turn = 0;  // of the camera so far; steps, radians
  bool moving = false;          // since the iteration before
  std::uint64_t versions = 0;
  std::vector<ridgecast::mesh::LeafState> leaves;
};

void Pipeline::State::advance(const camera::Camera& camera, bool anew) {
  const camera::Pose& pose = camera.pose;
  const double dx = static_cast<double>(pose.x - latest.pose.x), dz = static_cast<double>(pose.z - latest.pose.z),
               dy = (pose.y - latest.pose.y) * lattice::kStepsPerMetre;
  const double way = std::sqrt(dx * dx + dz * dz + dy * dy);
  moving = way > 0;
  travel = anew ? 0 : travel + way;  // short ways count beside it, however many long ones there were before
  turn += std::abs(std::remainder(pose.yaw - latest.pose.yaw, 2 * std::numbers::pi)) + std::abs(pose.pitch - latest.pose.pitch);
  if (!(camera.projection == latest.projection)) turn += std::numbers::pi;  // another picture: whatever is asleep is judged again
  latest = camera;
}

// What the ground hides. The thesis's metric knows nothing of that.
void Pipeline::State::lookAround(const camera::Camera& camera, refinement::View& view) {
  if (settings.metric == wire::Metric::kThesis) return;
  const std::vector<int>& rays = horizon.follow(camera, camera.pose.y - mesh.groundBelow(camera.pose), moving, refinement::kWidening);
  pool->forEach(rays.size(), 16, [&](std::size_t k) { horizon.cast(rays[k]); });
  view.horizon = &horizon;
}

// Which leaves may be seen, which candidates they want, which vertices may go.
void Pipeline::State::screen(const camera::Camera& camera, const refinement::View& view, const RemovalLimits& removal) {
  const bool thesis = settings.metric == wire::Metric::kThesis;
  const auto& leafs = mesh.leaves();
  pool->forEach(leafs.size(), 16, [&](std::size_t k) {
    Leaf& leaf = *leafs[k];
    leaf.pending.clear();
    leaf.removable.clear();
    const double side = static_cast<double>(leaf.address.side()) * lattice::kMetresPerStep;
    const double x = static_cast<double>(leaf.address.x() - camera.pose.x) * lattice::kMetresPerStep,
                 z = static_cast<double>(leaf.address.z() - camera.pose.z) * lattice::kMetresPerStep;
    // Triangles straddle borders by less than half a side.
    const camera::Vec3 low{x - side / 2, leaf.ground.low * lattice::kMetresPerStep - camera.pose.y - 1, z - side / 2},
        high{x + 1.5 * side, leaf.ground.high * lattice::kMetresPerStep - camera.pose.y + 1, z + 1.5 * side};
    leaf.visible = view.wide.mayIntersect(low, high);

    if (leaf.visible) {
      if (thesis)
        refinement::screenThesis(mesh.triangulation(), mesh.surface(), leaf.region, view, effective, leaf.pending);
      else
        refinement::screenPixels(mesh.triangulation(), mesh.surface(), leaf.region, view, effective, leaf.pending);
    }
    leaf.removalLimit = leaf.visible ? removal.inside : removal.outside;
    if (leaf.removalLimit > 0)
      refinement::screenLosses(mesh.triangulation(), mesh.surface(), leaf.region, view, leaf.removalLimit, leaf.removable);
  });
}

// Keeps the most wanted insertions that the budget and one iteration have room for; ties by position.
void Pipeline::State::limitPending(const refinement::View& view) {
  left = 0;
  std::size_t wanted = 0;
  for (const Leaf* leaf : mesh.leaves()) wanted += leaf->pending.size();
  const std::size_t budgeted = settings.triangleBudget > live ? (settings.triangleBudget - live) / 2 : 0, room = std::min(insertionLimit, budgeted);
  const bool forNow = budgeted >= insertionLimit || settings.metric == wire::Metric::kThesis;  // what is postponed comes next
  if (wanted <= room) return;
  std::vector<Pending> all;
  all.reserve(wanted);
  for (const Leaf* leaf : mesh.leaves()) all.insert(all.end(), leaf->pending.begin(), leaf->pending.end());
  const auto postpone = [&](Leaf& leaf, std::size_t from) {
    for (std::size_t k = from; k < leaf.pending.size(); ++k) {
      const Pending& p = leaf.pending[k];
      const refinement::Surface::Candidate c = mesh.surface().candidate(p.triangle);
      if (!forNow) left = std::max(left, refinement::measure({p.point.x, p.point.z, c.y}, c.error, view));
      mesh.surface().wakeCandidate(p.triangle, leaf.region);
    }
    leaf.pending.resize(from);
  };
  if (room == 0) {
    for (Leaf* leaf : mesh.leaves()) postpone(*leaf, 0);
    return;
  }
  std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(room - 1), all.end());
  const Pending last = all[room - 1];
  for (Leaf* leaf : mesh.leaves())
    postpone(*leaf, static_cast<std::size_t>(std::upper_bound(leaf->pending.begin(), leaf->pending.end(), last) - leaf->pending.begin()));
}

std::uint32_t Pipeline::State::owned() const {
  std::uint32_t sum = 0;
  for (const Leaf* leaf : mesh.leaves()) sum += mesh.triangulation().triangleCount(leaf->region);
  return sum;
}

// The figures of what there is, as against those of what was done.
void Pipeline::State::describe(wire::Figures& figures) const {
  figures.leaves = static_cast<std::uint32_t>(leaves.size());
  for (const Leaf* leaf : mesh.leaves()) figures.visibleLeaves += leaf->visible;
  figures.triangles = live;
  figures.effectiveThreshold = std::max(effective, left);
}

// New versions and hashes for leaves whose triangles changed.
void Pipeline::State::publish(bool otherLeaves) {
  const auto& leafs = mesh.leaves();
  const auto& t = mesh.triangulation();
  const auto state = [&](const Leaf& leaf) { return mesh::LeafState{leaf.address, leaf.version, leaf.hash, t.triangleCount(leaf.region)}; };
  std::vector<std::size_t> changed;
  mesh.takeChanged([&](std::size_t k) {
    leafs[k]->version = ++versions;
    changed.push_back(k);
  });
  pool->forEach(changed.size(), 16, [&](std::size_t n) {
    Leaf& leaf = *leafs[changed[n]];
    leaf.hash = refinement::hashRegion(t, mesh.surface(), leaf.region);
  });
  if (otherLeaves) {
    leaves.clear();
    for (const Leaf* leaf : leafs) leaves.push_back(state(*leaf));
  } else {
    for (std::size_t k : changed) leaves[k] = state(*leafs[k]);
  }
  live = 0;
  for (const mesh::LeafState& leaf : leaves) live += leaf.triangles;
}

Pipeline::Pipeline(std::shared_ptr<const terrain::Terrain> terrain, const wire::Settings& granted, std::shared_ptr<scheduling::Pool> pool)
    : state_(std::make_unique<State>(std::move(terrain), granted, std::move(pool))) {}
Pipeline::~Pipeline() = default;

wire::Figures Pipeline::iterate(const camera::Camera& camera) {
  State& s = *state_;
  wire::Figures figures;
  const std::uint64_t heightsBefore = s.mesh.heights() + s.horizon.heights();
  Stopwatch watch;

  if (s.settled && camera == s.latest) {  // nothing can change
    s.describe(figures);
    return figures;
  }
  const bool still = camera == s.latest;
  s.pool->rouse();
  const Follow follow = s.mesh.follow(camera.pose);
  figures.selectMs = watch.lap();
  s.mesh.generate(*s.pool);
  s.mesh.compact();
  s.mesh.evaluate(*s.pool);
  figures.generateMs = watch.lap();

  s.live = s.owned();
  const double fill = static_cast<double>(s.live) / s.settings.triangleBudget, before = s.effective;
  if (fill > 0.98)
    s.effective = std::min(s.effective * 1.05, kMostRaised * s.settings.threshold);
  else if (fill < 0.95)
    s.effective = std::max(s.settings.threshold, s.effective * 0.95);
  s.advance(camera, follow.anew);
  s.closely = s.closely && still && !follow.changed;
  refinement::View view(camera, s.mesh.surface().anchor, s.travel, s.turn, s.moving, s.settings.metric == wire::Metric::kArea);
  if (s.closely) view.closely = s.spacing();
  s.lookAround(camera, view);
  const RemovalLimits removal = removalLimits(s.settings.metric == wire::Metric::kThesis, s.effective, fill);
  s.screen(camera, view, removal);
  s.limitPending(view);
  figures.refineMs = watch.lap();

  figures.deferred = s.mesh.change(view, *s.pool);
  figures.triangulateMs = watch.lap();
  s.mesh.evaluate(*s.pool, &view);
  figures.refineMs += watch.lap();
  s.publish(follow.changed);
  figures.triangulateMs += watch.lap();

  for (const Leaf* leaf : s.mesh.leaves()) {
    figures.inserted += leaf->inserted;
    figures.removed += leaf->removed;
  }
  s.describe(figures);
  figures.generatedLeaves = follow.generated;
  figures.droppedLeaves = follow.dropped;
  const bool rests = still && !follow.changed && figures.inserted == 0 && figures.removed == 0 && s.effective == before;
  s.settled = rests && (s.closely || s.settings.metric == wire::Metric::kThesis);
  if (rests && !s.settled) {
    s.closely = true;
    view.closely = s.spacing();
    s.mesh.chooseAgain(view, *s.pool);
    figures.refineMs += watch.lap();
  }
  figures.heights = s.mesh.heights() + s.horizon.heights() - heightsBefore;
  return figures;
}

std::size_t Pipeline::memoryBytes() const { return state_->mesh.memoryBytes(); }

std::string Pipeline::verify() const {
  const std::string wrong = triangulation::verify(state_->mesh.triangulation(), state_->mesh.partition());
  return wrong.empty() ? state_->mesh.verifyGrids() : wrong;
}

void Pipeline::record(bool on) { state_->mesh.record(on); }

Pipeline::Changes Pipeline::changes() const {
  Changes out;
  const lattice::Point anchor = state_->mesh.surface().anchor;
  const auto absolute = [&](triangulation::Point2 p) { return lattice::Point{anchor.x + p.x, anchor.z + p.z}; };
  for (const Leaf* leaf : state_->mesh.leaves()) {
    for (const auto& p : leaf->insertedPoints) out.inserted.push_back(absolute(p));
    for (const auto& p : leaf->removedPoints) out.removed.push_back(absolute(p));
  }
  return out;
}

void Pipeline::change(const wire::Settings& granted) {
  State& s = *state_;
  if (granted.metric != s.settings.metric || granted.triangleBudget > s.madeFor) {
    auto fresh = std::make_unique<State>(s.ground, granted, s.pool);
    fresh->versions = s.versions;
    fresh->insertionLimit = s.insertionLimit;
    state_ = std::move(fresh);
    return;
  }
  const bool other = granted.threshold != s.settings.threshold || granted.triangleBudget != s.settings.triangleBudget;
  // What the budget has raised the threshold to stays, until the mesh is small enough.
  s.effective = std::max(granted.threshold, s.effective > s.settings.threshold ? s.effective : 0.0);
  s.settings = granted;
  if (other) s.settled = s.closely = false;
}

void Pipeline::setInsertionLimit(std::uint32_t most) { state_->insertionLimit = std::min<std::size_t>(most, kMostInsertions); }

bool Pipeline::settled() const { return state_->settled; }

const std::vector<mesh::LeafState>& Pipeline::leaves() const { return state_->leaves; }

std::vector<wire::Candidate> Pipeline::candidates(std::uint32_t most) const {
  const State& s = *state_;
  const refinement::Surface& surface = s.mesh.surface();
  const refinement::View view(s.latest, surface.anchor, s.travel, s.turn, false, s.settings.metric == wire::Metric::kArea);
  const auto& leafs = s.mesh.leaves();
  std::vector<std::vector<refinement::ListedCandidate>> found(leafs.size());
  s.pool->forEach(leafs.size(), 16, [&](std::size_t k) {
    if (!leafs[k]->visible) return;
    refinement::listCandidates(s.mesh.triangulation(), surface, leafs[k]->region, view, found[k]);
    refinement::keepWorst(found[k], most);
  });
  std::vector<refinement::ListedCandidate> all;
  for (const auto& leaf : found) all.insert(all.end(), leaf.begin(), leaf.end());
  refinement::keepWorst(all, most);
  std::vector<wire::Candidate> out;
  out.reserve(all.size());
  for (const auto& c : all) out.push_back({{surface.anchor.x + c.point.x, surface.anchor.z + c.point.z, c.y}, c.pixels});
  return out;
}

mesh::LeafMesh Pipeline::extract(lattice::LeafAddress address) const {
  const State& s = *state_;
  const Leaf* leaf = s.mesh.leaf(address);
  mesh::LeafMesh out;
  out.address = address;
  if (!leaf) return out;
  const auto& t = s.mesh.triangulation();
  const lattice::Step dx = s.mesh.surface().anchor.x - address.x(), dz = s.mesh.surface().anchor.z - address.z();
  out.triangles.reserve(t.triangleCount(leaf->region));
  out.vertices.reserve(t.triangleCount(leaf->region) / 2 + 16);
  // By vertex: 1 + its place in the leaf, 0 between calls. Of each thread, as large as the largest mesh it has seen.
  thread_local std::vector<std::uint32_t> places;
  if (places.size() < t.vertexCapacity()) places.resize(t.vertexCapacity(), 0);
  thread_local std::vector<VertexId> vertices;
  vertices.clear();
  const auto addTriangle = [&](TriangleId id) {
    mesh::Triangle triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      const VertexId v = t.triangle(id).v[k];
      std::uint32_t& place = places[v];
      if (place == 0) {
        const auto& p = t.vertex(v);
        out.vertices.push_back({static_cast<std::int32_t>(dx + p.x), static_cast<std::int32_t>(dz + p.z), p.y});
        vertices.push_back(v);
        place = static_cast<std::uint32_t>(vertices.size());
      }
      triangle[k] = place - 1;
    }
    out.triangles.push_back(triangle);
  };
  const triangulation::TrianglePages& pages = t.trianglePages();
  for (std::uint32_t page : pages.pagesOf(leaf->region)) {
    const TriangleId first = page * triangulation::TrianglePages::kSlots;
    // Many cameras' meshes do not fit the cache: a page's corners are asked for together.
    for (triangulation::TrianglePages::Mask m = pages.aliveMask(page); m != 0; m &= m - 1)
      t.prefetchCorners(first + static_cast<TriangleId>(std::countr_zero(m)));
    for (triangulation::TrianglePages::Mask m = pages.aliveMask(page); m != 0; m &= m - 1)
      addTriangle(first + static_cast<TriangleId>(std::countr_zero(m)));
  }
  for (VertexId v : vertices) places[v] = 0;
  mesh::canonicalize(out);
  return out;
}

}  // namespace ridgecast::pipeline
