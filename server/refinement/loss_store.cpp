#include "server/refinement/loss_store.h"

#include <algorithm>
#include <bit>
#include <cassert>

#include "common/outcome/contract.h"
#include "server/refinement/bounds.h"

namespace ridgecast::refinement {

using triangulation::Move;
using triangulation::RegionId;
using triangulation::Vertex;
using triangulation::VertexId;
using triangulation::VertexPages;

namespace {

constexpr std::size_t kLossesAhead = 8;  // pages whose bounds are fetched ahead of the one at hand
constexpr float kNone = std::numeric_limits<float>::max();

Place placeOf(const Vertex& v) { return {v.x, v.z, v.y}; }

// Slopes are errors as seen, the measure / the view's gain. All squared.
struct Seen {
  float slope2, flat2, distance2;
};
inline Seen see(const Place& p, float loss, const View& view) {
  const float dx = static_cast<float>(p.x - view.x), dz = static_cast<float>(p.z - view.z), dy = static_cast<float>(p.y) - view.y;
  const float flat = dx * dx + dz * dz, d2 = std::max(flat + dy * dy, kNearest * kNearest), reach = view.measure.reach(d2);
  return {loss * loss * flat / (d2 * reach), flat, d2};
}

void setNextCheck(PageLosses& page, double skipped, double power) {
  page.nextCheck = page.travel < 0 ? kAlways : page.travel + (1 - skipped / page.leastSlope) / (1 / page.flat + (power + 1) / page.nearest);
}

}  // namespace

double seenError(const Place& at, float error, const View& view) { return view.gain * std::sqrt(see(at, error, view).slope2); }

LossStore::LossStore(const triangulation::Triangulation& mesh)
    : mesh_(mesh), pages_(mesh.vertexPages()), losses_(mesh.vertexCapacity() / VertexPages::kSlots), extras_(mesh.vertexCapacity()) {}

std::size_t LossStore::memoryBytes() const {
  return pages_.pagesInUse() * sizeof(PageLosses) + std::size_t{pages_.blocksInUse()} * VertexPages::kBlock * sizeof(VertexExtra);
}

void LossStore::put(VertexId v, std::int32_t fineY, int level, float loss) {
  const std::uint32_t page = pages_.pageOf(v);
  if (std::popcount(pages_.aliveMask(page)) == 1) losses_[page] = {};  // what another region left there is forgotten
  assert(pages_.alive(v));
  expects(level >= 0 && level <= lattice::kMaxLevel, "a vertex is snapped to the level of a leaf");
  expects(std::abs(fineY) <= lattice::kMaxHeight, "the terrain's heights are the lattice's");
  VertexExtra& extra = extras_[v];
  extra.loss = loss;
  extra.fineY = fineY;
  extra.level = static_cast<std::uint32_t>(level) & 31;
}

void LossStore::setFixed(VertexId v, bool fixed, RegionState& state) {
  if (fixed == isFixed(v)) return;
  extras_[v].loss = fixed ? kFixed : 0;
  wake(v, state);
}

std::int32_t LossStore::raise(VertexId v, std::int32_t fineY, RegionState& state) {
  VertexExtra& extra = extras_[v];
  if (!isFixed(v)) extra.loss = 0;
  wake(v, state);
  extra.fineY = fineY;
  return lattice::snapHeight(extra.fineY, static_cast<int>(extra.level));
}

std::int32_t LossStore::snapTo(VertexId v, int level) {
  expects(level >= 0 && level < static_cast<int>(extras_[v].level), "a vertex is snapped to a finer level");
  extras_[v].level = static_cast<std::uint32_t>(level) & 31;
  return lattice::snapHeight(extras_[v].fineY, level);
}

void LossStore::move(std::span<const Move> moves, RegionState& state) {
  for (const auto& [from, to] : moves) extras_[to] = extras_[from];
  forEachPage(pages_, moves, [&](std::uint32_t, std::span<const Move> run) { wake(run.front().to, state); });
}

void LossStore::findRemovable(const PageList& due, RegionState& state, const View& view, Work& work) {
  for (std::size_t n = 0; n < due.size(); ++n) {
    if (n + kPagesAhead < due.size()) prefetchPage(due[n + kPagesAhead]);
    checkPage(due[n], view, work.removalLimit / view.gain, work.removable);
    setNextCheck(losses_[due[n]], state.skippedLoss, view.measure.power());
    state.nextLossCheck = std::min(state.nextLossCheck, losses_[due[n]].nextCheck);
  }
}

void LossStore::prefetchPage(std::uint32_t page) const {
  for (std::uint32_t k = 0; k < VertexPages::kBlocks; ++k) {
    const std::uint32_t block = pages_.blockOf(page, k);
    if (block == triangulation::kNoSlot) continue;
    mesh_.prefetchVertices(block);
    static_assert(VertexPages::kBlock * sizeof(VertexExtra) == 64);
    __builtin_prefetch(&extras_[block * VertexPages::kBlock]);
  }
}

void LossStore::collectDue(RegionId region, RegionState& state, const View& view, double removalLimit, PageList& due) {
  const double slope = removalLimit / view.gain, skipped = view.moving ? slope / kSlack : slope;
  const bool same = state.skippedLoss == skipped;
  if (!(slope > 0) || (same && view.travel < state.nextLossCheck)) return;
  state.skippedLoss = skipped;
  state.nextLossCheck = std::numeric_limits<double>::infinity();
  const auto& all = pages_.pagesOf(region);
  for (std::size_t n = 0; n < all.size(); ++n) {
    if (n + kLossesAhead < all.size()) __builtin_prefetch(&losses_[all[n + kLossesAhead]]);
    PageLosses& known = losses_[all[n]];
    if (!same) setNextCheck(known, skipped, view.measure.power());
    if (view.travel < known.nextCheck) {
      state.nextLossCheck = std::min(state.nextLossCheck, known.nextCheck);
    } else {
      due.push_back(all[n]);
      pages_.prefetch(all[n]);
    }
  }
}

// Appends the page's vertices below the slope, and keeps the bounds of the others.
inline void LossStore::checkPage(std::uint32_t page, const View& view, double slope, std::vector<VertexId>& out) {
  const auto most = static_cast<float>(slope * slope);
  float least = kNone, flattest = kNone, nearest = kNone;
  pages_.forEachIn(page, pages_.aliveMask(page), [&](VertexId v) {
    const float loss = extras_[v].loss;
    if (v == triangulation::kInfinite || std::isinf(loss)) return;
    const Seen seen = see(placeOf(mesh_.vertex(v)), loss, view);
    if (seen.slope2 < most) {
      out.push_back(v);
    } else {
      least = std::min(least, seen.slope2);
      flattest = std::min(flattest, seen.flat2);
      nearest = std::min(nearest, seen.distance2);
    }
  });
  losses_[page] = {0, view.travel, std::sqrt(least), std::sqrt(flattest), std::sqrt(nearest)};
}

void LossStore::fold(VertexId v, float loss, RegionState& state, const View& view) {
  extras_[v].loss = loss;
  PageLosses& page = losses_[pages_.pageOf(v)];
  if (page.travel >= 0 && std::isfinite(loss)) {
    const auto moved = static_cast<float>(view.travel - page.travel);
    if (4 * moved >= std::min(page.flat, page.nearest)) {
      page.travel = -1;
    } else {
      if (moved > 0) {  // the bounds as they are after that way
        const float away = 1 + moved / page.nearest;
        page.leastSlope *= (1 - moved / page.flat) / (away * away * view.measure.rise(away));
        page.flat -= moved;
        page.nearest -= moved;
        page.travel = view.travel;
      }
      const Seen seen = see(placeOf(mesh_.vertex(v)), loss, view);
      page.leastSlope = std::min(page.leastSlope, std::sqrt(seen.slope2));
      page.flat = std::min(page.flat, std::sqrt(seen.flat2));
      page.nearest = std::min(page.nearest, std::sqrt(seen.distance2));
    }
    setNextCheck(page, state.skippedLoss, view.measure.power());
  }
  state.nextLossCheck = std::min(state.nextLossCheck, page.nextCheck);
}

}  // namespace ridgecast::refinement
