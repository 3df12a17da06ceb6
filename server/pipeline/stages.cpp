#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "common/outcome/contract.h"
#include "common/triangulation/triangulation.h"
#include "server/pipeline/state.h"
#include "server/scheduling/colouring.h"

namespace ridgecast::pipeline {

using refinement::Pending;

namespace {

// Vertices are removed below this share of the threshold.
constexpr double kRemoval = 0.5;
// The thesis never removes; with its metric vertices go only in leaves that the wide frustum does not see, when the budget is nearly full.
constexpr double kThesisRemovalPixels = 1.0;
// "Nearly full": leaves outside the wide frustum then lose vertices below the whole threshold.
constexpr double kTight = 0.9;
// While insertions are limited the eye may leave the centre of its horizon so many times as far as otherwise.
constexpr double kLeaveLimited = 2;

struct RemovalLimits {
  double inside, outside;  // pixels of loss, for leaves that may be seen and for the others
};
RemovalLimits removalLimits(bool thesis, double threshold, double fill) {
  const bool tight = fill >= kTight;
  if (thesis) return {0, tight ? kThesisRemovalPixels : 0};
  return {kRemoval * threshold, (tight ? 1 : kRemoval) * threshold};
}

}  // namespace

void Motion::follow(const camera::Camera& now, bool fromNothing) {
  const camera::Pose &pose = now.pose, &before = camera.pose;
  const double dx = static_cast<double>(pose.x - before.x), dz = static_cast<double>(pose.z - before.z),
               dy = (pose.y - before.y) * lattice::kStepsPerMetre;
  const double way = std::sqrt(dx * dx + dz * dz + dy * dy);
  moving = way > 0;
  travel = fromNothing ? 0 : travel + way;
  turn += std::abs(std::remainder(pose.yaw - before.yaw, 2 * std::numbers::pi)) + std::abs(pose.pitch - before.pitch);
  if (!(now.projection == camera.projection)) turn += std::numbers::pi;  // another picture: whatever is dormant is judged again
  camera = now;
}

// Errors lie close below the bound, where nothing was inserted: how close, only a step tells.
void SearchBound::lower() {
  if (lowered_) step_ = std::min(1.25, 1 + 2 * (step_ - 1));
  lowered_ = isRaised();
  value_ = std::max(threshold_, value_ / step_);
}

void SearchBound::raise(std::vector<double>& putOff, std::size_t room, double most) {
  const bool lowered = std::exchange(lowered_, false);
  if (putOff.size() <= 3 * room) return;
  if (lowered) step_ = std::max(1.01, 1 + (step_ - 1) / 2);
  const auto next = putOff.begin() + static_cast<std::ptrdiff_t>(2 * room);
  std::nth_element(putOff.begin(), next, putOff.end(), std::greater());
  value_ = std::max(value_, std::min(*next, most));
}

Pipeline::State::State(std::shared_ptr<const terrain::Terrain> ground, const settings::Settings& granted,
                       std::shared_ptr<scheduling::Pool> workers)
    : settings(granted),
      madeFor(granted.triangleBudget),
      terrain(std::move(ground)),
      pool(std::move(workers)),
      horizon(terrain),
      mesh(terrain, granted.triangleBudget, granted.metric, granted.colourError),
      effective(granted.threshold) {
  expects(pool != nullptr, "a pipeline has threads");
  expects(granted.threshold > 0 && granted.triangleBudget > 0, "settings are granted before a mesh is made for them");
}

refinement::View Pipeline::State::view() const {
  return {motion.camera, mesh.mesh().anchor(), motion.travel, motion.turn, motion.moving, settings.metric};
}

// ---- refine ----

void Pipeline::State::fitBudget(bool otherLeaves) {
  if (otherLeaves) {
    live = 0;
    for (const triangulation::RegionId region : mesh.regions()) live += mesh.mesh().triangulation().triangleCount(region);
  }
  fill = static_cast<double>(live) / settings.triangleBudget;
  if (fill > 0.98)
    effective = std::min(effective * 1.05, kMaxRaised * settings.threshold);
  else if (fill < 0.95)
    effective = std::max(settings.threshold, effective * 0.95);
}

void Pipeline::State::castHorizon(refinement::View& view, double ground) {
  if (isThesis()) return;
  const double leave = !motion.moving ? 0 : isLimited() ? kLeaveLimited : 1;
  const std::vector<int>& rays = horizon.follow(motion.camera, motion.camera.pose.y - ground, leave, refinement::kWidening);
  pool->forEach(rays.size(), 16, [&](std::size_t k) { horizon.cast(rays[k]); });
  view.horizon = &horizon;
}

// Whether a leaf, or a triangle that straddles its border, may be in the wide frustum.
bool Pipeline::State::maySee(const refinement::View& view, std::size_t leaf) const {
  const camera::Pose& pose = motion.camera.pose;
  const refinement::HeightRange& ground = mesh.mesh().ground(mesh.regions()[leaf]);
  const lattice::LeafAddress& address = mesh.addresses()[leaf];
  const double side = static_cast<double>(address.side()) * lattice::kMetresPerStep;
  const double x = static_cast<double>(address.x() - pose.x) * lattice::kMetresPerStep,
               z = static_cast<double>(address.z() - pose.z) * lattice::kMetresPerStep;
  // Triangles straddle borders by less than half a side.
  const camera::Vec3 low{x - side / 2, ground.low * lattice::kMetresPerStep - pose.y - 1, z - side / 2},
      high{x + 1.5 * side, ground.high * lattice::kMetresPerStep - pose.y + 1, z + 1.5 * side};
  return view.wide.mayIntersect(low, high);
}

void Pipeline::State::findWork(const refinement::View& view) {
  const RemovalLimits removal = removalLimits(isThesis(), effective, fill);
  const auto& leafs = mesh.leaves();
  seen.resize(leafs.size());
  constexpr std::size_t kBatch = 16;
  std::vector<std::uint32_t> found((leafs.size() + kBatch - 1) / kBatch);
  pool->forEach(found.size(), 1, [&](std::size_t batch) {
    const std::size_t first = batch * kBatch, count = std::min(kBatch, leafs.size() - first);
    for (std::size_t k = first; k < first + count; ++k) mesh.mesh().prefetch(mesh.regions()[k]);
    std::array<refinement::AdaptiveMesh::Search, kBatch> searches;
    for (std::size_t k = 0; k < count; ++k) {
      const bool isSeen = maySee(view, first + k);
      seen[first + k] = isSeen;
      searches[k] = {mesh.regions()[first + k], isSeen, isSeen ? removal.inside : removal.outside, &leafs[first + k]->work};
    }
    found[batch] = mesh.mesh().findWork(std::span(searches).first(count), view, searchBound.value());
  });
  busy.clear();
  for (std::size_t batch = 0; batch < found.size(); ++batch)
    for (std::uint32_t bits = found[batch]; bits != 0; bits &= bits - 1)
      busy.push_back(leafs[batch * kBatch + static_cast<std::size_t>(std::countr_zero(bits))]);
}

void Pipeline::State::limitInsertions(const refinement::View& view) {
  std::size_t wanted = 0;
  for (const Leaf* leaf : busy) wanted += leaf->work.pending.size();
  const std::size_t budgeted = settings.triangleBudget > live ? (settings.triangleBudget - live) / 2 : 0,
                    room = std::min(insertionLimit, budgeted);
  left = searchBound.isRaised() ? searchBound.value() : 0;
  if (wanted <= room) return searchBound.lower();
  std::vector<double> putOff = keepMostWanted(room, wanted, view);
  // What one iteration cannot hold comes next, and is not withheld.
  const bool forNow = isThesis() || (budgeted >= insertionLimit && !isLimited());
  if (!forNow) left = std::max(left, std::ranges::max(putOff));
  if (isLimited() && room == insertionLimit) searchBound.raise(putOff, room, kMaxRaised * settings.threshold);
}

std::vector<double> Pipeline::State::keepMostWanted(std::size_t room, std::size_t wanted, const refinement::View& view) {
  expects(room < wanted, "some of what is wanted has no room");
  std::vector<double> errors;
  errors.reserve(wanted - room);
  const auto postpone = [&](Leaf& leaf, std::size_t from) {
    for (std::size_t k = from; k < leaf.work.pending.size(); ++k)
      errors.push_back(mesh.mesh().postpone(leaf.work.pending[k], leaf.region, view, !isLimited()));
    leaf.work.pending.resize(from);
  };
  if (room == 0) {
    for (Leaf* leaf : busy) postpone(*leaf, 0);
    return errors;
  }
  std::vector<Pending> all;
  all.reserve(wanted);
  for (const Leaf* leaf : busy) all.insert(all.end(), leaf->work.pending.begin(), leaf->work.pending.end());
  std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(room - 1), all.end());
  const Pending last = all[room - 1];
  for (Leaf* leaf : busy)
    postpone(*leaf, static_cast<std::size_t>(std::upper_bound(leaf->work.pending.begin(), leaf->work.pending.end(), last) -
                                             leaf->work.pending.begin()));
  return errors;
}

void Pipeline::State::evaluate(const refinement::View* view) {
  thread_local std::vector<Leaf*> changed;
  changed.clear();
  mesh.forEachChanged([&](std::size_t k) { changed.push_back(mesh.leaves()[k]); });
  pool->forEach(changed.size(), 4, [&, list = changed.data()](std::size_t k) { mesh.mesh().evaluateFresh(list[k]->region, view); });
}

void Pipeline::State::lookClosely(const refinement::View& view) {
  std::vector<const Leaf*> some;
  for (std::size_t triangles = 0; looked < mesh.leaves().size() && triangles < kLookedAtOnce; ++looked) {
    const Leaf& leaf = *mesh.leaves()[looked];
    const triangulation::Point2 low = mesh.mesh().local({leaf.address.x(), leaf.address.z()});
    // Triangles straddle borders by less than half a side.
    const auto half = static_cast<std::int32_t>(leaf.address.side() / 2);
    const auto corner = [&](int i, int j) { return view.relative(low.x + i * half, low.z + j * half, 0); };
    if (view.sector.misses(std::array{corner(-1, -1), corner(-1, 3), corner(3, -1), corner(3, 3)})) continue;
    some.push_back(&leaf);
    triangles += mesh.mesh().triangulation().triangleCount(leaf.region);
  }
  pool->forEach(some.size(), 4, [&](std::size_t k) { mesh.mesh().evaluateAll(some[k]->region, view); });
}

// ---- triangulate ----

void Pipeline::State::change(const refinement::View& view, settings::IterationStats& figures) {
  std::vector<std::span<const std::uint32_t>> writeSets;
  std::erase_if(busy, [](Leaf* leaf) {
    const bool isPutOff = leaf->work.isEmpty();
    if (isPutOff) leaf->work.end();
    return isPutOff;
  });
  for (const Leaf* leaf : busy) writeSets.push_back(leaf->writeSet);
  refinement::AdaptiveMesh& m = mesh.mesh();
  const auto [tasks, order] = scheduling::colour(writeSets, m.triangulation().regionLimit());
  pool->forEachOrdered(order, [&, tasks = tasks.data()](std::size_t k) {
    thread_local triangulation::WriteSet set;
    Leaf& leaf = *busy[tasks[k]];
    set.allow(leaf.writeSet);
    if (k + 1 < busy.size()) m.prefetch(busy[tasks[k + 1]]->work);
    m.removeUnneeded(leaf.region, view, set, leaf.work);
    m.insertWanted(leaf.region, view, set, leaf.work);
    m.evaluateFresh(leaf.region, &view);  // while it is in the cache
  });
  for (std::uint32_t task : tasks) {
    Leaf& leaf = *busy[task];
    figures.deferred += static_cast<std::uint32_t>(leaf.work.deferred.size());
    m.insertDeferred(leaf.region, view, leaf.work);
    figures.inserted += leaf.work.inserted;
    figures.removed += leaf.work.removed;
    leaf.work.end();
  }
}

void Pipeline::State::publish(bool otherLeaves) {
  const auto& leafs = mesh.leaves();
  const auto& t = mesh.mesh().triangulation();
  const auto state = [&](const Leaf& leaf) {
    return ridgecast::mesh::LeafState{leaf.address, leaf.version, leaf.hash, t.triangleCount(leaf.region), leaf.points};
  };
  const std::vector<generation::CameraMesh::Changed> changed = mesh.takeChanged();
  for (const auto& [k, points] : changed) {
    leafs[k]->version = ++versions;
    if (points) leafs[k]->points = versions;
  }
  if (mesh.takeChangedOutside()) outside = ++versions;
  pool->forEach(changed.size(), 16, [&](std::size_t n) {
    Leaf& leaf = *leafs[changed[n].leaf];
    leaf.hash = mesh.mesh().hash(leaf.region);
  });
  if (otherLeaves) {  // those that stay are as they were, or changed
    std::vector<ridgecast::mesh::LeafState> before(leafs.size());
    before.swap(leaves);
    auto old = before.begin();
    for (std::size_t k = 0; k < leafs.size(); ++k) {
      const lattice::LeafAddress& address = mesh.addresses()[k];
      while (old != before.end() && old->address < address) ++old;
      leaves[k] = old != before.end() && old->address == address ? *old : state(*leafs[k]);
    }
  }
  for (const auto& [k, points] : changed) leaves[k] = state(*leafs[k]);
  expects(leaves.size() == leafs.size(), "what is published are all leaves");
  live = 0;
  for (const ridgecast::mesh::LeafState& leaf : leaves) live += leaf.triangles;
}

void Pipeline::State::settle(bool rests, refinement::View& view) {
  const bool isLookedAt = isThesis() || (closely && looked == mesh.leaves().size());
  settled = rests && isLookedAt;
  if (isLookedAt || !(rests || closely)) return;
  closely = true;
  view.closely = spacing();
  lookClosely(view);
}

settings::IterationStats Pipeline::State::describe(settings::IterationStats figures) const {
  figures.leaves = static_cast<std::uint32_t>(leaves.size());
  figures.visibleLeaves = static_cast<std::uint32_t>(std::ranges::count(seen, 1));
  figures.triangles = live;
  figures.effectiveThreshold = std::max(effective, left);
  figures.insertionLimit = static_cast<std::uint32_t>(insertionLimit);
  return figures;
}

}  // namespace ridgecast::pipeline
