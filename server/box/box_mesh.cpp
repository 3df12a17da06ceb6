#include "server/box/box_mesh.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "common/text/text.h"
#include "server/triangulation/triangulation.h"

namespace ridgecast::box {

using lattice::Step;
using triangulation::Change;
using triangulation::Point2;
using triangulation::TriangleId;
using triangulation::Vertex;
using triangulation::VertexId;

namespace {

constexpr int kAnchorBits = lattice::kFinestSideBits + lattice::kMaxLevel;
constexpr double kSnapShare = 1.0 / 16;          // of the error: what snapping a height may cost
constexpr double kSideShare = 0.7;               // of the error: allowed for the box's sides, as lines
constexpr double kQuickShare = 0.9;              // of the error: allowed at a triangle's few candidates
constexpr double kDenseShare = 0.93;             // of the error: allowed at its dense samples; the rest is for what lies between them
constexpr double kGreed = 0.6;                   // a batch takes every point with at least this share of the worst error
constexpr double kFinestDense = 64;              // steps between dense samples, at least...
constexpr double kMostDenseSamples = 4e7;        // ...and large boxes get not many more samples than this
constexpr int kLeastDense = 6, kMostDense = 64;  // divisions of a triangle's sides
constexpr int kRegionsAcross = 24;               // working squares along the longer side
constexpr std::size_t kTrianglesALeaf = 3000;
constexpr std::size_t kInsertions = 64;     // between two looks at the clock: some hundred microseconds at most
constexpr std::size_t kLeavesAtATime = 16;  // the same

std::string text(double v) { return text::rounded(v, 3); }

struct Worst {        // without initialisers: most of the array is never touched
  float error;        // metres
  std::int32_t x, z;  // where a vertex would fix it; only admissible places
  bool admissible;
  Point2 at() const { return {x, z}; }
};

}  // namespace

class Meshing::Mesher : private triangulation::Partition {
 public:
  Mesher(const terrain::Terrain& terrain, const Box& box, std::uint32_t most, scheduling::Pool& pool, Watch watch)
      : terrain_(terrain),
        most_(most),
        error_(box.error),
        passes_(box.rough ? 1 : 2),
        pool_(pool),
        watch_(std::move(watch)),
        mesh_(most + 64, *this) {
    all_.allowAll();
    const double fits = kSnapShare * box.error * lattice::kStepsPerMetre;  // at most half a spacing of heights
    while (std::ldexp(1.0, vertical_) <= fits && vertical_ < 12) ++vertical_;
    horizontal_ = vertical_ + 1;
    low_ = {lattice::floorTo(box.low.x, horizontal_), lattice::floorTo(box.low.z, horizontal_)};
    high_ = {-lattice::floorTo(-box.high.x, horizontal_), -lattice::floorTo(-box.high.z, horizontal_)};
    anchor_ = {lattice::floorTo(low_.x, kAnchorBits), lattice::floorTo(low_.z, kAnchorBits)};
    spacing_ = std::max(kFinestDense,
                        std::sqrt(static_cast<double>(high_.x - low_.x) * static_cast<double>(high_.z - low_.z) / kMostDenseSamples));
    const Step side = std::max(high_.x - low_.x, high_.z - low_.z);
    regionBits_ = std::max(10, static_cast<int>(std::bit_width(static_cast<std::uint64_t>(side / kRegionsAcross))));
    firstX_ = local(low_).x >> regionBits_;
    firstZ_ = local(low_).z >> regionBits_;
    across_ = (local(high_).x >> regionBits_) - firstX_ + 1;
    down_ = (local(high_).z >> regionBits_) - firstZ_ + 1;
    for (std::int32_t j = 0; j < down_; ++j)
      for (std::int32_t i = 0; i < across_; ++i)
        regions_.push_back(mesh_.addRegion({(firstX_ + i) << regionBits_, (firstZ_ + j) << regionBits_, 1 << regionBits_}));
    worst_ = std::make_unique_for_overwrite<Worst[]>(mesh_.triangleCapacity());
    corners_ = {local(low_), {local(low_).x, local(high_).z}, local(high_), {local(high_).x, local(low_).z}};
    const auto vertex = [&](Point2 p) { return Vertex{p.x, p.z, heightAt(p), triangulation::kNoEdge}; };
    mesh_.start(vertex(corners_[0]), vertex(corners_[1]), vertex(corners_[2]));
    now_.hint = mesh_.anyTriangle();
    now_.points = {corners_[3]};
  }

  std::optional<Result<BoxMesh>> work(Time until) {
    until_ = until;
    auto made = advance();
    if (!made && watch_.over()) return watch_.problem();
    return made;
  }

 private:
  triangulation::RegionId regionAt(Point2 p) const override {
    const std::int32_t i = (p.x >> regionBits_) - firstX_, j = (p.z >> regionBits_) - firstZ_;
    return i < 0 || j < 0 || i >= across_ || j >= down_ ? triangulation::kOutside
                                                        : regions_[static_cast<std::size_t>(std::int64_t{j} * across_ + i)];
  }
  bool pauses() const { return watch_.over() || std::chrono::steady_clock::now() >= until_; }

  std::optional<Result<BoxMesh>> advance() {
    if (!begin()) return {};
    constexpr Pass kPasses[] = {{0, kQuickShare}, {kMostDense, kDenseShare}};
    while (now_.pass < passes_) {
      const Result<bool> done = refine(kPasses[now_.pass]);
      if (!done) return done.error();
      if (!*done) return {};
      if (++now_.pass == passes_) break;
      for (triangulation::RegionId r : regions_) mesh_.trianglePages().forEach(r, [&](TriangleId t) { mesh_.trianglePages().setFresh(t); });
      samples_ = 0;
    }
    if (!file()) return {};
    return BoxMesh{std::move(leaves_), low_, high_, worst(), samples_, mesh_.liveTriangles()};
  }

  Point2 local(lattice::Point p) const { return {static_cast<std::int32_t>(p.x - anchor_.x), static_cast<std::int32_t>(p.z - anchor_.z)}; }
  std::int32_t heightAt(Point2 p) const {
    return static_cast<std::int32_t>(lattice::roundTo(terrain_.heightStep({anchor_.x + p.x, anchor_.z + p.z}), vertical_));
  }

  bool insert(Point2 p, TriangleId& hint) {
    const TriangleId t = mesh_.locate(p, hint, all_);
    VertexId v;
    const Change change = mesh_.insert({p.x, p.z, heightAt(p), triangulation::kNoEdge}, t, all_, &v);
    hint = change == Change::kDone ? mesh_.edgeOf(v) >> 2 : t;
    vertices_ += change == Change::kDone;
    return change == Change::kDone;
  }

  // Inserts the last corner, the sides' points and a coarse grid inside. False: the turn is over.
  bool begin() {
    while (!now_.begun) {
      for (; now_.next < now_.points.size(); ++now_.next) {
        if (now_.next % kInsertions == 0 && pauses()) return false;
        insert(now_.points[now_.next], now_.hint);
      }
      now_.points.clear();
      now_.next = 0;
      if (now_.side < corners_.size())
        divide(corners_[now_.side], corners_[(now_.side + 1) % corners_.size()], now_.points);
      else if (now_.side == corners_.size())
        spread(now_.points);
      else
        now_.begun = true;
      ++now_.side;
    }
    return true;
  }

  void spread(std::vector<Point2>& out) const {
    const Point2 low = corners_[0], high = corners_[2];
    const std::int32_t apart = 1 << (regionBits_ + 2);
    for (std::int32_t x = ((low.x / apart) + 1) * apart; x < high.x; x += apart)
      for (std::int32_t z = ((low.z / apart) + 1) * apart; z < high.z; z += apart) out.push_back({x, z});
  }

  // Chooses points between two corners so that the terrain along the side is close to the line through them.
  void divide(Point2 from, Point2 to, std::vector<Point2>& out) const {
    const bool alongX = from.z == to.z;
    if (alongX ? from.x > to.x : from.z > to.z) std::swap(from, to);  // adjoining boxes divide a shared side alike
    const Step begin = alongX ? from.x : from.z, end = alongX ? to.x : to.z;
    const Step spacing =
        std::max<Step>({Step{1} << horizontal_, static_cast<Step>(kFinestDense) / 2, lattice::floorTo((end - begin) >> 17, horizontal_)});
    std::vector<Step> x, z, at;
    for (Step s = begin; s < end; s += spacing) at.push_back(s);
    at.push_back(end);
    for (Step s : at) {
      x.push_back(anchor_.x + (alongX ? s : from.x));
      z.push_back(anchor_.z + (alongX ? from.z : s));
    }
    std::vector<std::int32_t> y(at.size());
    terrain_.heightSteps(x, z, y);
    const auto snapped = [&](std::size_t k) { return static_cast<double>(lattice::roundTo(y[k], vertical_)); };
    const double limit = kSideShare * error_ * lattice::kStepsPerMetre;
    std::vector<std::pair<std::size_t, std::size_t>> pieces{{0, at.size() - 1}};
    while (!pieces.empty()) {
      const auto [a, b] = pieces.back();
      pieces.pop_back();
      double worst = limit;
      std::size_t where = 0;
      for (std::size_t k = a + 1; k < b; ++k) {
        const double t = static_cast<double>(at[k] - at[a]) / static_cast<double>(at[b] - at[a]);
        const double off = std::abs(snapped(a) + t * (snapped(b) - snapped(a)) - y[k]);
        if (off > worst) {
          worst = off;
          where = k;
        }
      }
      if (where == 0) continue;
      out.push_back(alongX ? Point2{static_cast<std::int32_t>(at[where]), from.z} : Point2{from.x, static_cast<std::int32_t>(at[where])});
      pieces.push_back({a, where});
      pieces.push_back({where, b});
    }
  }

  struct Pass {
    int dense;     // 0: a few candidates for each triangle; otherwise the most divisions of its sides
    double share;  // of the error
  };
  // Inserts the worst points until nothing exceeds the pass's share of the error. False: the turn is over.
  Result<bool> refine(const Pass& pass) {
    const float limit = static_cast<float>(pass.share * error_);
    for (;;) {
      if (!insertBatch()) return false;
      if (now_.full) return tooMany();
      if (!evaluate(pass.dense)) return false;
      watch_.has(mesh_.liveTriangles());
      float most = 0, stuck = 0;
      for (triangulation::RegionId r : regions_)
        mesh_.trianglePages().forEach(r, [&](TriangleId t) {
          float& kind = worst_[t].admissible ? most : stuck;
          kind = std::max(kind, worst_[t].error);
        });
      if (most <= limit) {
        if (std::max(most, stuck) <= error_) return true;
        return Problem{Problem::Kind::kTooMuch,
                       "This ground has a step of " + text(stuck) + " m that no mesh on the lattice follows more closely; an error of " +
                           text(stuck * 1.05) + " m can be kept.",
                       stuck * 1.05};
      }
      now_.reached = most;
      ++now_.batches;
      chooseBatch(std::max(limit, static_cast<float>(kGreed) * most));
    }
  }

  void chooseBatch(float wanted) {
    for (triangulation::RegionId r : regions_) {
      const auto first = now_.batch.size();
      mesh_.trianglePages().forEach(r, [&](TriangleId t) {
        if (worst_[t].admissible && worst_[t].error > wanted) now_.batch.emplace_back(worst_[t].error, t);
      });
      std::sort(now_.batch.begin() + static_cast<std::ptrdiff_t>(first), now_.batch.end(), [&](const auto& a, const auto& b) {
        return a.first != b.first ? a.first > b.first : triangulation::smaller(worst_[a.second].at(), worst_[b.second].at());
      });
    }
  }

  // False: the turn is over.
  bool insertBatch() {
    for (; now_.next < now_.batch.size() && !now_.full; ++now_.next) {
      if (now_.next % kInsertions == 0 && pauses()) return false;
      const TriangleId t = now_.batch[now_.next].second;
      if (!mesh_.trianglePages().alive(t) || mesh_.trianglePages().fresh(t)) continue;  // changed by this batch: evaluated again
      const Point2 p = worst_[t].at();
      now_.full = mesh_.insert({p.x, p.z, heightAt(p), triangulation::kNoEdge}, t, all_) != Change::kDone || 2 * ++vertices_ > most_;
    }
    now_.batch.clear();
    now_.next = 0;
    return true;
  }

  Problem tooMany() const {
    const double fits = static_cast<double>(now_.reached) * 1.1;
    return {Problem::Kind::kTooMuch,
            "This box at an error of " + text(error_) + " m takes more than " + std::to_string(most_) +
                " triangles, the limit; with an error of " + text(fits) + " m, or in several smaller boxes, it fits.",
            now_.batches > 1 ? fits : 0};
  }

  // Finds the worst point of every fresh triangle. False: the turn ended before.
  bool evaluate(int dense) {
    std::atomic<std::uint64_t> samples{0};
    std::atomic<bool> done{true};
    pool_.forEach(regions_.size(), 1, [&](std::size_t k) {
      thread_local std::vector<TriangleId> fresh;
      fresh.clear();
      mesh_.trianglePages().forEachFresh(regions_[k], [&](TriangleId t) { fresh.push_back(t); });
      std::uint64_t n = 0;
      for (TriangleId t : fresh) {
        if (pauses()) {
          done = false;
          break;
        }
        mesh_.trianglePages().clearFresh(t);
        n += judge(t, dense);
      }
      samples += n;
    });
    samples_ += samples;
    return done;
  }

  // The centroids of the parts of a triangle with divided sides: all inside, evenly spread.
  std::uint64_t judge(TriangleId t, int dense) {
    const auto& corner = mesh_.triangle(t).v;
    const Vertex &a = mesh_.vertex(corner[0]), &b = mesh_.vertex(corner[1]), &c = mesh_.vertex(corner[2]);
    const double ux = double(b.x) - a.x, uz = double(b.z) - a.z, vx = double(c.x) - a.x, vz = double(c.z) - a.z, uy = double(b.y) - a.y,
                 vy = double(c.y) - a.y, area = uz * vx - ux * vz;
    const double longest = std::sqrt(std::max({ux * ux + uz * uz, vx * vx + vz * vz, (ux - vx) * (ux - vx) + (uz - vz) * (uz - vz)}));
    const int n = dense == 0 ? 2 : std::clamp(static_cast<int>(std::ceil(longest / spacing_)), kLeastDense, dense);
    thread_local std::vector<Step> x, z;
    thread_local std::vector<float> plane, height;
    x.clear();
    z.clear();
    plane.clear();
    const auto sample = [&](double s, double r) {
      const Point2 p{static_cast<std::int32_t>(std::lround(a.x + s * ux + r * vx)),
                     static_cast<std::int32_t>(std::lround(a.z + s * uz + r * vz))};
      if (!triangulation::holds(a.point(), b.point(), c.point(), p)) return;
      const double px = double(p.x) - a.x, pz = double(p.z) - a.z, wb = (pz * vx - px * vz) / area, wc = (px * uz - pz * ux) / area;
      x.push_back(anchor_.x + p.x);
      z.push_back(anchor_.z + p.z);
      plane.push_back(static_cast<float>((a.y + wb * uy + wc * vy) * lattice::kMetresPerStep));
    };
    const double part = 1.0 / (3 * n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; i + j < n; ++j) {
        sample((3 * i + 1) * part, (3 * j + 1) * part);
        if (i + j + 1 < n) sample((3 * i + 2) * part, (3 * j + 2) * part);
      }
    height.resize(x.size());
    terrain_.heights(x, z, height);
    Worst worst{0, 0, 0, false};
    std::size_t where = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
      const float error = std::abs(height[k] - plane[k]);
      if (error > worst.error) {
        worst.error = error;
        where = k;
      }
    }
    if (worst.error > 0) {
      const Point2 exact = local({x[where], z[where]}),
                   near = local({lattice::roundTo(x[where], horizontal_), lattice::roundTo(z[where], horizontal_)});
      const Point2 at = isAdmissible(a, b, c, near) ? near : exact;
      worst.x = at.x;
      worst.z = at.z;
      worst.admissible = isAdmissible(a, b, c, at);
    }
    worst_[t] = worst;
    return x.size();
  }

  static bool isAdmissible(const Vertex& a, const Vertex& b, const Vertex& c, Point2 p) {
    return triangulation::holds(a.point(), b.point(), c.point(), p) && !(p == a.point()) && !(p == b.point()) && !(p == c.point());
  }

  float worst() const {
    float most = 0;
    for (triangulation::RegionId r : regions_)
      mesh_.trianglePages().forEach(r, [&](TriangleId t) { most = std::max(most, worst_[t].error); });
    return most;
  }

  // Files the triangles by leaves of one level, chosen for a moderate number of triangles in each. False: the turn is over.
  bool file() {
    const double area = static_cast<double>(high_.x - low_.x) * static_cast<double>(high_.z - low_.z);
    const double parts = std::max(1.0, static_cast<double>(mesh_.liveTriangles()) / kTrianglesALeaf);
    int level = 0;
    while (level < lattice::kMaxLevel && std::ldexp(1.0, 2 * (lattice::kFinestSideBits + level)) < area / parts) ++level;
    for (; now_.next < regions_.size(); ++now_.next) {
      if (pauses()) return false;
      file(regions_[now_.next], level);
    }
    while (!filed_.empty()) {
      if (pauses()) return false;
      const std::size_t first = leaves_.size(), count = std::min(kLeavesAtATime, filed_.size());
      std::vector<std::vector<VertexId>> ids;
      for (std::size_t k = 0; k < count; ++k) {
        auto leaf = filed_.extract(filed_.begin());
        leaf.mapped().mesh.address = leaf.key();
        leaves_.push_back(std::move(leaf.mapped().mesh));
        ids.push_back(std::move(leaf.mapped().ids));
      }
      pool_.forEach(count, 1, [&](std::size_t k) { finish(leaves_[first + k], ids[k]); });
    }
    return true;
  }

  void file(triangulation::RegionId region, int level) {
    const Step side3 = 3 * (Step{1} << (lattice::kFinestSideBits + level));
    const auto floored = [](Step p, Step q) { return p >= 0 ? p / q : -((q - 1 - p) / q); };
    mesh_.trianglePages().forEach(region, [&](TriangleId t) {
      const auto& v = mesh_.triangle(t).v;
      Step x3 = 3 * anchor_.x, z3 = 3 * anchor_.z;
      for (VertexId id : v) {
        x3 += mesh_.vertex(id).x;
        z3 += mesh_.vertex(id).z;
      }
      Filing& leaf = filed_[{level, floored(x3, side3), floored(z3, side3)}];
      const auto first = static_cast<std::uint32_t>(leaf.ids.size());
      leaf.ids.insert(leaf.ids.end(), v, v + 3);
      leaf.mesh.triangles.push_back({first, first + 1, first + 2});
    });
  }

  void finish(mesh::LeafMesh& leaf, const std::vector<VertexId>& ids) const {
    for (VertexId id : ids) {
      const Vertex& v = mesh_.vertex(id);
      leaf.vertices.push_back({static_cast<std::int32_t>(anchor_.x + v.x - leaf.address.x()),
                               static_cast<std::int32_t>(anchor_.z + v.z - leaf.address.z()), v.y});
    }
    mesh::canonicalize(leaf);
  }

  struct Filing {
    mesh::LeafMesh mesh;
    std::vector<VertexId> ids;
  };
  // Where the work goes on after a pause.
  struct Position {
    std::size_t side = 0, pass = 0, next = 0;
    std::vector<Point2> points;                       // to be inserted first
    TriangleId hint = 0;                              // near the last of them
    std::vector<std::pair<float, TriangleId>> batch;  // to be inserted by refine
    std::uint32_t batches = 0;
    float reached = 0;  // the worst error before the batch, metres
    bool begun = false, full = false;
  };

  const terrain::Terrain& terrain_;
  const std::uint32_t most_;
  const double error_;  // metres
  const std::size_t passes_;
  scheduling::Pool& pool_;
  const Watch watch_;
  Time until_;  // the turn's end
  Position now_;
  int vertical_ = 0, horizontal_ = 0;  // the vertices' spacing, as powers of two in steps
  lattice::Point low_, high_, anchor_;
  std::array<Point2, 4> corners_;
  double spacing_ = 0;  // of dense samples, steps
  int regionBits_ = 0;
  std::int32_t firstX_ = 0, firstZ_ = 0, across_ = 0, down_ = 0;
  std::vector<triangulation::RegionId> regions_;
  triangulation::Triangulation mesh_;
  triangulation::WriteSet all_;
  std::unique_ptr<Worst[]> worst_;  // by triangle; valid for those that are not fresh
  std::uint64_t samples_ = 0;
  std::uint32_t vertices_ = 3;
  std::map<lattice::LeafAddress, Filing> filed_;
  std::vector<mesh::LeafMesh> leaves_;
};

Problem Watch::problem() const {
  if (stop.stop_requested()) return {Problem::Kind::kStopped, "Nobody waits for this snapshot any more."};
  return {Problem::Kind::kTooSlow,
          "This snapshot was not ready after " + text(seconds) +
              " seconds, the most that one may take; ask again when the server has less to do, or for less: a larger "
              "threshold or error, a smaller box."};
}

Meshing::Meshing(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool, Watch watch)
    : mesher_(std::make_unique<Mesher>(terrain, box, mostTriangles, pool, std::move(watch))) {}
Meshing::~Meshing() = default;

std::optional<Result<BoxMesh>> Meshing::work(Time until) { return mesher_->work(until); }

Result<BoxMesh> meshBox(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool,
                        const Watch& watch) {
  return std::move(*Meshing(terrain, box, mostTriangles, pool, watch).work(Meshing::Time::max()));
}

}  // namespace ridgecast::box
