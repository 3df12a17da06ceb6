#include "server/box/box_mesh.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

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
    all_.allowAll();
    regions_.addTo(mesh_);
    later_.resize(regions_.size());
    asked_.resize(regions_.size());
    answered_.resize(regions_.size());
    worst_ = std::make_unique_for_overwrite<Worst[]>(mesh_.triangleCapacity());
    const auto vertex = [&](Point2 p) { return Vertex{p.x, p.z, heightAt(p), triangulation::kNoEdge}; };
    mesh_.start(vertex(plan_.corners[0]), vertex(plan_.corners[1]), vertex(plan_.corners[2]));
    now_.hint = mesh_.anyTriangle();
    now_.points = {plan_.corners[3]};
  }

  std::optional<Result<BoxMesh>> work(Time until) {
    until_ = until;
    wentOn_ = false;
    auto made = advance();
    if (!made && watch_.over()) return watch_.problem();
    return made;
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

  enum class Stage { kSampling, kOutline, kFirst, kSweeps, kVerdicts, kMending, kThinning, kFiling };

  // However short a turn is, something is done in it.
  bool pauses() { return watch_.over() || (std::chrono::steady_clock::now() >= until_ && wentOn_.exchange(true)); }

  std::optional<Result<BoxMesh>> advance() {
    for (;;) switch (now_.stage) {
        case Stage::kSampling:
          if (!sample()) return {};
          if (!now_.begun && samples_.slack() > kRough * plan_.kept && samples_.halves(plan_.samples / 4)) {
            now_.sampled = 0;
            break;
          }
          now_.stage = now_.begun ? Stage::kVerdicts : Stage::kOutline;
          break;
        case Stage::kOutline:
          if (!outline() || !glanceAll()) return {};
          if (now_.full) return tooManyTriangles(plan_.error, plan_.most, 0);
          now_.stage = Stage::kFirst;
          now_.outline = vertices_;
          collect(plan_.kept);
          break;
        case Stage::kFirst:  // one by one, until there is room for many hands
          if (!insertWorst(plan_.kept, now_.outline + kVerticesARegion * static_cast<std::uint32_t>(regions_.size()))) return {};
          if (now_.full) return tooManyTriangles(plan_.error, plan_.most, static_cast<double>(now_.reached) * 1.1);
          now_.heap.clear();
          now_.stage = Stage::kSweeps;
          break;
        case Stage::kSweeps:
          if (now_.limit == 0) {
            const float most = worst(true);
            if (most <= plan_.kept) {
              now_.stage = Stage::kVerdicts;
              forgetVerdicts();
              break;
            }
            // A few triangles that other regions left behind are not worth a sweep of their own.
            now_.reached = std::min(most, now_.lowest);
            now_.limit = now_.lowest = std::max(plan_.kept, kFall * now_.reached);
          }
          if (!sweep(true)) return {};
          if (now_.full) return tooManyTriangles(plan_.error, plan_.most, static_cast<double>(now_.reached) * 1.1);
          break;
        case Stage::kVerdicts:
          if (!judgeAll()) return {};
          if (refine()) {
            if (samples_.count() > plan_.samples) return tooRough(plan_.error, plan_.samples);
            now_.stage = Stage::kSampling;
          } else if (worst(true) <= plan_.kept) {
            if (const float stuck = worst(false); stuck > plan_.kept) return tooSteep(stuck);
            now_.stage = Stage::kThinning;
          } else {
            now_.limit = plan_.kept;
            now_.stage = Stage::kMending;
          }
          break;
        case Stage::kMending:
          if (!sweep(false)) return {};
          if (now_.full) return tooManyTriangles(plan_.error, plan_.most, static_cast<double>(now_.reached) * 1.1);
          now_.stage = Stage::kVerdicts;
          break;
        case Stage::kThinning:
          if (!byColour([&](std::size_t home) { return thin(mesh_, regions_, home, judge_, plan_.kept, worst_.get()), true; })) return {};
          now_.stage = Stage::kFiling;
          now_.next = 0;
          break;
        case Stage::kFiling:
          if (!file()) return {};
          return made();
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

  // False: the turn is over.
  bool sample() {
    if (now_.sampled == samples_.size()) return true;
    const std::size_t some = std::max<std::size_t>(1, kSamplesATime / samples_[now_.sampled].count()),
                      parts = (samples_.size() - now_.sampled + some - 1) / some;
    const auto fill = [&](std::size_t part) {
      const std::size_t first = now_.sampled + part * some;
      for (std::size_t k = first; k < std::min(first + some, samples_.size()); ++k) samples_.fill(k);
      return true;
    };
    if (!once(parts, fill)) return false;
    now_.sampled = samples_.size();
    return true;
  }

  // The last corner and the sides' points. False: the turn is over.
  bool outline() {
    while (!now_.begun) {
      for (; now_.next < now_.points.size(); ++now_.next) {
        if (now_.next % kInsertions == 0 && pauses()) return false;
        const Point2 p = now_.points[now_.next];
        const TriangleId t = mesh_.locate(p, now_.hint, all_);
        VertexId made;
        const Change change = mesh_.insert({p.x, p.z, heightAt(p), triangulation::kNoEdge}, t, all_, &made);
        now_.hint = change == Change::kDone ? mesh_.edgeOf(made) >> 2 : t;
        vertices_ += change == Change::kDone;
      }
      now_.full = 2 * vertices_ > plan_.most;
      now_.points.clear();
      now_.next = 0;
      if (now_.full || now_.side == plan_.corners.size())
        now_.begun = true;
      else {
        if (!now_.division)
          now_.division.emplace(terrain_, plan_.frame,
                                Side{plan_.corners[now_.side], plan_.corners[(now_.side + 1) % plan_.corners.size()],
                                     kSideShare * plan_.error, plan_.vertical});
        if (!now_.division->work([this] { return pauses(); })) return false;
        now_.points = now_.division->take();
        now_.division.reset();
      }
      // Many points along a side would see the other ones: a grid keeps their triangles short.
      if (now_.side == 0 && now_.points.size() > kManyOnASide) {
        const auto grid = regions_.corners(plan_.corners[0], plan_.corners[2]);
        now_.points.insert(now_.points.begin(), grid.begin(), grid.end());
      }
      ++now_.side;
    }
    return true;
  }

  // f(k) for all k < n at the same time. False: one returned false, for the turn is over.
  template <class F>
  bool all(std::size_t n, F&& f) {
    std::atomic<bool> done{true};
    pool_.forEach(n, 1, [&](std::size_t k) {
      if (!f(k)) done = false;
    });
    return done;
  }
  // The same, each once, in as many turns as it takes.
  template <class F>
  bool once(std::size_t n, F&& f) {
    now_.did.resize(n);
    const auto unlessDone = [&](std::size_t k) {
      if (!now_.did[k]) now_.did[k] = !pauses() && f(k);
      return now_.did[k] != 0;
    };
    if (!all(n, unlessDone)) return false;
    now_.did.clear();
    return true;
  }
  // f(t) for the fresh triangles of a region, which are judged by it. False: the turn is over.
  template <class F>
  bool forEachFresh(std::size_t k, F&& f) {
    thread_local std::vector<TriangleId> fresh;
    fresh.clear();
    mesh_.trianglePages().forEachFresh(regions_[k], [&](TriangleId t) { fresh.push_back(t); });
    for (std::size_t n = 0; n < fresh.size(); ++n) {
      if (n % kVerdicts == 0 && pauses()) return false;
      f(fresh[n]);
    }
    return true;
  }
  // At every fresh triangle. False: the turn is over.
  bool glanceAll() {
    return all(regions_.size(), [&](std::size_t k) { return forEachFresh(k, [&](TriangleId t) { glance(t); }); });
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
  void collect(float limit) {
    for (RegionId r : regions_) forEachWanted(r, limit, [&](const Wanted& w) { now_.heap.push_back(w); });
    std::make_heap(now_.heap.begin(), now_.heap.end());
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

  // The worst of all first, until the heap is empty or there are so many vertices. False: the turn is over.
  bool insertWorst(float limit, std::uint32_t enough, bool again = true) {
    while (!now_.heap.empty() && vertices_ < enough) {
      if (++now_.next % kInsertions == 0 && pauses()) return false;
      const Wanted w = take(now_.heap);
      if (!stands(w)) continue;
      now_.reached = w.error;
      VertexId made;
      if (insert(w, all_, made) != Change::kDone || 2 * ++vertices_ > plan_.most) {
        now_.full = true;
        return true;
      }
      if (again) glanceAround(made, limit, now_.heap, [](TriangleId) { return true; });
    }
    return true;
  }

  // f(region) for all, those of one colour at the same time, from the colour in hand on. False: one returned false, for the turn is over.
  template <class F>
  bool byColour(F&& f) {
    for (; now_.colour < Regions::kColours && !now_.full; ++now_.colour) {
      const auto& regions = regions_.colour(now_.colour);
      if (!once(regions.size(), [&](std::size_t k) { return f(regions[k]); })) return false;
      vertices_ = mesh_.liveVertices();
      now_.full = 2 * vertices_ > plan_.most;
    }
    return true;
  }

  // Inserts what is worse than the limit, region by region, those of one colour at the same time. `again`: what comes anew is glanced at
  // and may follow; otherwise it stays fresh. False: the turn is over.
  bool sweep(bool again) {
    if (!byColour([&](std::size_t home) { return sweep(home, again); })) return false;
    if (now_.full) return true;
    // What reaches beyond nine regions.
    for (auto& later : later_) {
      now_.heap.insert(now_.heap.end(), later.begin(), later.end());
      later.clear();
    }
    std::make_heap(now_.heap.begin(), now_.heap.end());
    if (!insertWorst(now_.limit, 0xffffffffu, again)) return false;
    watch_.has(mesh_.liveTriangles());
    now_.colour = 0;
    now_.limit = 0;
    return true;
  }

  // False: the turn is over; to be called again, for what is left.
  bool sweep(std::size_t home, bool again) {
    thread_local triangulation::WriteSet set;
    thread_local std::vector<RegionId> around;
    thread_local std::vector<Wanted> heap;
    regions_.around(home, around);
    set.allow(around);
    heap.clear();
    forEachWanted(regions_[home], now_.limit, [&](const Wanted& w) { heap.push_back(w); });
    std::make_heap(heap.begin(), heap.end());
    for (std::size_t n = 1; !heap.empty(); ++n) {
      if (n % kInsertions == 0 && pauses()) return false;
      const Wanted w = take(heap);
      if (!stands(w)) continue;
      VertexId made;
      const Change change = insert(w, set, made);
      if (change == Change::kDeferred) later_[home].push_back(w);
      if (change == Change::kDone && again)
        glanceAround(made, now_.limit, heap, [&](TriangleId t) { return mesh_.regionOf(t) == regions_[home]; });
    }
    return true;
  }

  void forgetVerdicts() {
    for (RegionId r : regions_) mesh_.trianglePages().forEach(r, [&](TriangleId t) { mesh_.trianglePages().setFresh(t); });
  }
  // Every fresh triangle, and every open question whose block is refined by now. False: the turn is over.
  bool judgeAll() {
    return all(regions_.size(), [&](std::size_t k) {
      thread_local std::vector<Open> tooCoarse;
      const auto ask = [&](TriangleId t) {
        for (const Open& open : tooCoarse) asked_[k].push_back({t, open});
        tooCoarse.clear();
      };
      for (; !answered_[k].empty(); answered_[k].pop_back()) {
        if (answered_[k].size() % kVerdicts == 0 && pauses()) return false;
        const auto& [t, open] = answered_[k].back();
        const Worst found = judge_.verdict(cornersOf(t), open, tooCoarse);
        if (found.error > worst_[t].error) worst_[t] = found;
        ask(t);
      }
      return forEachFresh(k, [&](TriangleId t) {
        worst_[t] = judge_.verdict(cornersOf(t), tooCoarse);
        mesh_.trianglePages().clearFresh(t);
        ask(t);
        watch_.checks(1);
      });
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
  // False: the turn is over.
  bool file() {
    if (!filing_) filing_.emplace(mesh_, plan_.frame, plan_.low, plan_.high, regions_.size());
    if (now_.next == 0 && !once(regions_.size(), [&](std::size_t k) { return filing_->add(k, regions_[k]), true; })) return false;
    now_.next = 1;
    while (!filing_->finish(pool_))
      if (pauses()) return false;
    return true;
  }

  // Where the work goes on after a pause.
  struct Position {
    Stage stage = Stage::kSampling;
    std::size_t sampled = 0;  // tiles
    std::size_t side = 0, next = 0;
    std::optional<Division> division;                       // of the side
    std::vector<Point2> points;                             // of the outline, to be inserted
    TriangleId hint = 0;                                    // near the last of them
    std::vector<Wanted> heap;                               // to be inserted one by one
    std::size_t colour = 0;                                 // of the sweep
    std::vector<std::uint8_t> did;                          // of what is done at the same time; bytes, for threads write them side by side
    float limit = 0;                                        // of the sweep, metres; 0: there is none
    float lowest = std::numeric_limits<float>::infinity();  // of the limits so far
    std::uint32_t outline = 0;                              // vertices of it
    float reached = 0;                                      // the worst error before it
    bool begun = false, full = false;
  };

  const terrain::Terrain& terrain_;
  scheduling::Pool& pool_;
  const Watch watch_;
  Time until_;                        // the turn's end
  std::atomic<bool> wentOn_ = false;  // after it, once
  Position now_;
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
  std::optional<Filing> filing_;
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
