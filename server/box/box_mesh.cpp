#include "server/box/box_mesh.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "common/outcome/contract.h"
#include "common/outcome/turns.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/box/filing.h"
#include "server/box/judge.h"
#include "server/box/outline.h"
#include "server/box/plan.h"
#include "server/box/regions.h"
#include "server/box/samples.h"
#include "server/box/thinning.h"

namespace ridgecast::box {

using triangulation::Change;
using triangulation::HalfEdge;
using triangulation::Point2;
using triangulation::RegionId;
using triangulation::TriangleId;
using triangulation::Vertex;
using triangulation::VertexId;

namespace {

constexpr double kSideShare = 0.7;             // of the error: allowed for the box's sides, as lines
constexpr float kFall = 0.75f;                 // what must be inserted falls by this from sweep to sweep
constexpr float kRough = 0.4f;                 // of the error: where slack is more on average, nearly all samples would be refined
constexpr std::uint32_t kVerticesARegion = 6;  // from which they work side by side
constexpr std::size_t kManyOnASide = 200;
// Between two looks at the clock: some hundred microseconds, or a few milliseconds.
constexpr std::size_t kInsertions = 64, kVerdicts = 16, kSamplesATime = 1024;

}  // namespace

class Meshing::Mesher {
 public:
  Mesher(const terrain::Terrain& terrain, const Box& box, std::uint32_t most, scheduling::Pool& pool, Watch watch)
      : terrain_(terrain),
        pool_(pool),
        watch_(std::move(watch)),
        plan_(box, terrain, most),
        samples_(terrain, plan_.frame, plan_.corners[0], plan_.corners[2], plan_.bits),
        judge_(samples_, plan_.corners[0], plan_.corners[2], plan_.kept),
        regions_(plan_.corners[0], plan_.corners[2]),
        mesh_(most + 64, regions_) {
    expects(box.low.x < box.high.x && box.low.z < box.high.z, "a box covers something");
    all_.allowAll();
    regions_.addTo(mesh_);
    later_.resize(regions_.size());
    asked_.resize(regions_.size());
    answered_.resize(regions_.size());
    worst_ = std::make_unique_for_overwrite<Worst[]>(mesh_.triangleCapacity());
    const auto vertex = [&](Point2 p) { return Vertex{p.x, p.z, heightAt(p), triangulation::kNoEdge}; };
    mesh_.start(vertex(plan_.corners[0]), vertex(plan_.corners[1]), vertex(plan_.corners[2]));
  }

  std::optional<Result<BoxMesh>> work(Time until) {
    until_ = until;
    wentOn_ = false;
    if (turns_.next()) return watch_.over() ? std::optional<Result<BoxMesh>>(watch_.problem()) : std::nullopt;
    if (full_) return tooManyTriangles(plan_.error, plan_.most, static_cast<double>(reached_) * 1.1);
    if (problem_) return *problem_;
    return made();
  }

 private:
  struct Wanted {
    float error;
    Point2 at;
    TriangleId triangle;
    friend bool operator<(const Wanted& a, const Wanted& b) {  // the worst first out of a heap
      return a.error != b.error ? a.error < b.error : triangulation::smaller(b.at, a.at);
    }
  };

  struct Question {
    TriangleId triangle;
    Open open;
  };

  // However short a turn is, something is done in it.
  bool pauses() { return watch_.over() || (std::chrono::steady_clock::now() >= until_ && wentOn_.exchange(true)); }

  // All of it. Ends early when the mesh is full, or with a problem.
  Turns run() {
    do
      for (Turns turns = sample(0); turns.next();) co_yield 0;
    while (samples_.slack() > kRough * plan_.kept && samples_.halves(plan_.samples / 4));
    for (Turns turns = approximate(); turns.next();) co_yield 0;
    for (forgetVerdicts(); !full_;) {
      for (Turns turns = judgeAll(); turns.next();) co_yield 0;
      const std::size_t sampled = samples_.size();  // tiles
      if (refine()) {
        if (samples_.count() > plan_.samples) problem_ = tooRough(plan_.error, plan_.samples);
        if (problem_) co_return;
        for (Turns turns = sample(sampled); turns.next();) co_yield 0;
      } else if (worst(true) <= plan_.kept) {
        break;
      } else {
        for (Turns turns = sweep(plan_.kept, false); turns.next();) co_yield 0;
      }
    }
    if (full_) co_return;
    if (const float stuck = worst(false); stuck > plan_.kept) problem_ = tooSteep(stuck);
    if (problem_) co_return;
    for (Turns turns = byColour([this](std::size_t k) { return thin(mesh_, regions_, k, judge_, plan_.kept, worst_.get()), true; });
         turns.next();)
      co_yield 0;
    filing_.emplace(mesh_, plan_.frame, plan_.low, plan_.high, regions_.size());
    for (Turns turns = each(regions_.size(), [this](std::size_t k) { return filing_->add(k, regions_[k]), true; }); turns.next();)
      co_yield 0;
    while (!filing_->finish(pool_))
      if (pauses()) co_yield 0;
  }

  // Until no triangle's worst sample is beyond the limit.
  Turns approximate() {
    for (Turns turns = outline(); turns.next();) co_yield 0;
    if (full_) co_return;
    for (Turns turns = each(regions_.size(), [this](std::size_t k) { return forEachFresh(k, [this](TriangleId t) { glance(t); }); });
         turns.next();)
      co_yield 0;
    // One by one, until there is room for many hands.
    std::vector<Wanted> heap;
    for (RegionId r : regions_) forEachWanted(r, plan_.kept, [&](const Wanted& w) { heap.push_back(w); });
    const std::uint32_t enough = vertices_ + kVerticesARegion * static_cast<std::uint32_t>(regions_.size());
    for (Turns turns = insertWorst(heap, plan_.kept, enough, true); turns.next();) co_yield 0;
    float lowest = std::numeric_limits<float>::infinity();  // of the limits so far
    while (!full_) {
      const float most = worst(true);
      if (most <= plan_.kept) break;
      // A few triangles that other regions left behind are not worth a sweep of their own.
      reached_ = std::min(most, lowest);
      lowest = std::max(plan_.kept, kFall * reached_);
      for (Turns turns = sweep(lowest, true); turns.next();) co_yield 0;
    }
  }

  std::int32_t heightAt(Point2 p) const {
    const std::optional<float> known = samples_.at(p);
    return static_cast<std::int32_t>(
        lattice::roundTo(known ? terrain::toSteps(*known) : terrain_.heightStep(plan_.frame.global(p)), plan_.vertical));
  }
  Corners cornersOf(TriangleId t) const {
    const auto& v = mesh_.triangle(t).v;
    return {cornerOf(mesh_, v[0]), cornerOf(mesh_, v[1]), cornerOf(mesh_, v[2])};
  }

  // The tiles from `first` on.
  Turns sample(std::size_t first) {
    if (first == samples_.size()) co_return;
    const std::size_t some = std::max<std::size_t>(1, kSamplesATime / samples_[first].count()),
                      parts = (samples_.size() - first + some - 1) / some;
    const auto fill = [this, first, some](std::size_t part) {
      const std::size_t begin = first + part * some;
      for (std::size_t k = begin; k < std::min(begin + some, samples_.size()); ++k) samples_.fill(k);
      return true;
    };
    for (Turns turns = each(parts, fill); turns.next();) co_yield 0;
  }

  // The last corner and the sides' points.
  Turns outline() {
    TriangleId hint = mesh_.anyTriangle();
    std::vector<Point2> points{plan_.corners[3]};
    for (std::size_t side = 0;; ++side) {
      for (std::size_t n = 0; n < points.size(); ++n) {
        if (n % kInsertions == 0 && pauses()) co_yield 0;
        const Point2 p = points[n];
        const TriangleId t = mesh_.locate(p, hint, all_);
        VertexId made;
        const Change change = mesh_.insert({p.x, p.z, heightAt(p), triangulation::kNoEdge}, t, all_, &made);
        hint = change == Change::kDone ? mesh_.edgeOf(made) >> 2 : t;
        vertices_ += change == Change::kDone;
      }
      full_ = 2 * vertices_ > plan_.most;
      if (full_ || side == plan_.corners.size()) co_return;
      Division division(terrain_, plan_.frame,
                        {plan_.corners[side], plan_.corners[(side + 1) % plan_.corners.size()], kSideShare * plan_.error, plan_.vertical});
      for (Turns turns = division.work([this] { return pauses(); }); turns.next();) co_yield 0;
      points = division.take();
      // Many points along a side would see the other ones: a grid keeps their triangles short.
      if (side == 0 && points.size() > kManyOnASide) {
        const auto grid = regions_.corners(plan_.corners[0], plan_.corners[2]);
        points.insert(points.begin(), grid.begin(), grid.end());
      }
    }
  }

  // f(k) for all k < n at the same time; where one returns false, because the turn is over, it is called again in the next.
  template <class F>
  Turns each(std::size_t n, F f) {
    std::vector<std::uint8_t> did(n);  // bytes, for threads write them side by side
    for (;;) {
      pool_.forEach(n, 1, [this, &did, &f](std::size_t k) {
        if (!did[k]) did[k] = !pauses() && f(k);
      });
      if (std::ranges::find(did, 0) == did.end()) co_return;
      co_yield 0;
    }
  }
  // f(t) for the fresh triangles of a region, which are judged by it; as f of each().
  template <class F>
  bool forEachFresh(std::size_t k, F&& f) {
    thread_local std::vector<TriangleId> fresh;
    fresh.clear();
    mesh_.trianglePages().forEachFresh(regions_[k], [&](TriangleId t) { fresh.push_back(t); });
    for (std::size_t n = 0; n < fresh.size(); ++n) {
      f(fresh[n]);
      if ((n + 1) % kVerdicts == 0 && pauses()) return false;
    }
    return true;
  }

  void glance(TriangleId t) {
    mesh_.trianglePages().clearFresh(t);
    worst_[t] = judge_.glance(cornersOf(t));
  }
  bool stands(const Wanted& w) const {
    return mesh_.trianglePages().alive(w.triangle) && !mesh_.trianglePages().fresh(w.triangle) && worst_[w.triangle].at() == w.at &&
           worst_[w.triangle].error == w.error;
  }
  Change insert(const Wanted& w, triangulation::WriteSet& set, VertexId& made) {
    return mesh_.insert({w.at.x, w.at.z, heightAt(w.at), triangulation::kNoEdge}, w.triangle, set, &made);
  }
  template <class F>
  void forEachWanted(RegionId r, float limit, F&& f) const {
    mesh_.trianglePages().forEach(r, [&](TriangleId t) {
      if (!mesh_.trianglePages().fresh(t) && worst_[t].admissible && worst_[t].error > limit) f(Wanted{worst_[t].error, worst_[t].at(), t});
    });
  }
  static Wanted take(std::vector<Wanted>& heap) {
    std::pop_heap(heap.begin(), heap.end());
    const Wanted w = heap.back();
    heap.pop_back();
    return w;
  }
  // Onto the heap goes what is worse than the limit, if mine(t).
  template <class F>
  void glanceAround(VertexId v, float limit, std::vector<Wanted>& heap, F&& mine) {
    mesh_.forEachAround(v, [&](HalfEdge h) {
      const TriangleId t = h >> 2;
      glance(t);
      if (!worst_[t].admissible || worst_[t].error <= limit || !mine(t)) return;
      heap.push_back({worst_[t].error, worst_[t].at(), t});
      std::push_heap(heap.begin(), heap.end());
    });
  }

  // The worst of all first, until the heap is empty or there are so many vertices. `again`: as for sweep().
  Turns insertWorst(std::vector<Wanted>& heap, float limit, std::uint32_t enough, bool again) {
    std::make_heap(heap.begin(), heap.end());
    for (std::size_t n = 1; !heap.empty() && vertices_ < enough; ++n) {
      if (n % kInsertions == 0 && pauses()) co_yield 0;
      const Wanted w = take(heap);
      if (!stands(w)) continue;
      reached_ = w.error;
      VertexId made;
      full_ = insert(w, all_, made) != Change::kDone || 2 * ++vertices_ > plan_.most;
      if (full_) co_return;
      if (again) glanceAround(made, limit, heap, [](TriangleId) { return true; });
    }
  }

  // f(region) for all, those of one colour at the same time; as f of each().
  template <class F>
  Turns byColour(F f) {
    for (std::size_t colour = 0; colour < Regions::kColours && !full_; ++colour) {
      const auto& regions = regions_.colour(colour);
      for (Turns turns = each(regions.size(), [&f, &regions](std::size_t k) { return f(regions[k]); }); turns.next();) co_yield 0;
      vertices_ = mesh_.liveVertices();
      full_ = 2 * vertices_ > plan_.most;
    }
  }

  // Inserts what is worse than the limit, region by region, those of one colour at the same time. `again`: what comes anew is glanced at
  // and may follow; otherwise it stays fresh.
  Turns sweep(float limit, bool again) {
    for (Turns turns = byColour([=, this](std::size_t home) { return sweep(home, limit, again); }); turns.next();) co_yield 0;
    if (full_) co_return;
    std::vector<Wanted> heap;  // what reaches beyond nine regions
    for (auto& later : later_) {
      heap.insert(heap.end(), later.begin(), later.end());
      later.clear();
    }
    for (Turns turns = insertWorst(heap, limit, 0xffffffffu, again); turns.next();) co_yield 0;
    if (!full_) watch_.has(mesh_.liveTriangles());
  }
  // In one region; as f of each().
  bool sweep(std::size_t home, float limit, bool again) {
    thread_local triangulation::WriteSet set;
    thread_local std::vector<RegionId> around;
    thread_local std::vector<Wanted> heap;
    regions_.around(home, around);
    set.allow(around);
    heap.clear();
    forEachWanted(regions_[home], limit, [&](const Wanted& w) { heap.push_back(w); });
    std::make_heap(heap.begin(), heap.end());
    for (std::size_t n = 1; !heap.empty(); ++n) {
      if (n % kInsertions == 0 && pauses()) return false;
      const Wanted w = take(heap);
      if (!stands(w)) continue;
      VertexId made;
      const Change change = insert(w, set, made);
      if (change == Change::kDeferred) later_[home].push_back(w);
      if (change == Change::kDone && again)
        glanceAround(made, limit, heap, [&](TriangleId t) { return mesh_.regionOf(t) == regions_[home]; });
    }
    return true;
  }

  void forgetVerdicts() {
    for (RegionId r : regions_) mesh_.trianglePages().forEach(r, [&](TriangleId t) { mesh_.trianglePages().setFresh(t); });
  }
  // Every fresh triangle, and every open question whose block is refined by now.
  Turns judgeAll() {
    for (Turns turns = each(regions_.size(), [this](std::size_t k) { return judge(k); }); turns.next();) co_yield 0;
  }
  // In one region; as f of each().
  bool judge(std::size_t k) {
    thread_local std::vector<Open> tooCoarse;
    const auto ask = [&](TriangleId t) {
      for (const Open& open : tooCoarse) asked_[k].push_back({t, open});
      tooCoarse.clear();
    };
    while (!answered_[k].empty()) {
      const auto [t, open] = answered_[k].back();
      answered_[k].pop_back();
      const Worst found = judge_.verdict(cornersOf(t), open, tooCoarse);
      if (found.error > worst_[t].error) worst_[t] = found;
      ask(t);
      if (answered_[k].size() % kVerdicts == 0 && pauses()) return false;
    }
    return forEachFresh(k, [&](TriangleId t) {
      worst_[t] = judge_.verdict(cornersOf(t), tooCoarse);
      mesh_.trianglePages().clearFresh(t);
      ask(t);
      watch_.checks(1);
    });
  }
  // Whether there were blocks that must be finer.
  bool refine() {
    bool any = false;
    for (std::size_t k = 0; k < regions_.size(); ++k) {
      for (const Question& q : asked_[k])
        if (samples_.finer(q.open.block) < 0) samples_.refine(q.open.block);
      any = any || !asked_[k].empty();
      std::swap(asked_[k], answered_[k]);
    }
    return any;
  }

  float worst(bool admissible) {
    std::vector<float> most(regions_.size());
    pool_.forEach(most.size(), 8, [&](std::size_t k) {
      float here = 0;  // not in memory that others write to
      mesh_.trianglePages().forEach(regions_[k], [&](TriangleId t) {
        if (worst_[t].admissible == admissible) here = std::max(here, worst_[t].error);
      });
      most[k] = here;
    });
    return *std::max_element(most.begin(), most.end());
  }

  BoxMesh made() {
    return {.leaves = filing_->take(),
            .low = plan_.low,
            .high = plan_.high,
            .error = std::min(std::max(worst(true), worst(false)) + plan_.noise, plan_.error),
            .proven = samples_.proves(),
            .spacing = static_cast<double>(samples_.spacing()) * lattice::kMetresPerStep,
            .samples = samples_.count(),
            .triangles = mesh_.liveTriangles()};
  }
  const terrain::Terrain& terrain_;
  scheduling::Pool& pool_;
  const Watch watch_;
  Time until_;                        // the turn's end
  std::atomic<bool> wentOn_ = false;  // after it, once
  const Plan plan_;
  Samples samples_;
  const Judge judge_;
  Regions regions_;
  std::vector<std::vector<Wanted>> later_;               // by region
  std::vector<std::vector<Question>> asked_, answered_;  // by region
  triangulation::Triangulation mesh_;
  triangulation::WriteSet all_;
  std::unique_ptr<Worst[]> worst_;  // by triangle; valid for those that are not fresh
  std::uint32_t vertices_ = 3;
  bool full_ = false;
  float reached_ = 0;  // the worst error before the last insertion, metres
  std::optional<Problem> problem_;
  std::optional<Filing> filing_;
  Turns turns_ = run();
};

Meshing::Meshing(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool, Watch watch)
    : mesher_(std::make_unique<Mesher>(terrain, box, mostTriangles, pool, std::move(watch))) {}
Meshing::~Meshing() = default;

std::optional<Result<BoxMesh>> Meshing::work(Time until) { return mesher_->work(until); }

Result<BoxMesh> meshBox(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool,
                        const Watch& watch) {
  return std::move(*Meshing(terrain, box, mostTriangles, pool, watch).work(Meshing::Time::max()));
}

}  // namespace ridgecast::box
