// A triangle's candidate, chosen once, when the triangle is new. It depends on the camera only where a view looks closely.
//
// Several points of a triangle are tried (its centroid and one towards each corner, so that a bump beside the middle is seen), snapped to
// the lattice of the region's level, and the one with the largest vertical error is kept. A snapped point outside its triangle or on a
// corner is no candidate. The thesis's metric tries one point only: 0.6 of the way from the centroid to the corners' average weighted by
// curvature (Cavallin and Pettersson 2019, figure 3.17).
//
// Few points miss what is narrow, ridges and walls. A view that looks closely (View::closely) tries points all over the triangle in the
// directions that it draws, and keeps the one whose error it sees most of. Ground narrower than the distance between those points may still
// be missed.
#include "server/refinement/chooser.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/mesh/leaf_mesh.h"
#include "common/outcome/contract.h"
#include "common/terrain/vector_clones.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using triangulation::Point2;
using triangulation::TriangleId;
using triangulation::Vertex;
using triangulation::VertexId;

namespace {

// (least height / spacing)^2 from which on snapping is harmless: a fifth of the height is then 1.4 spacings.
constexpr double kRoomy = 49;
constexpr unsigned kPoints = 4;                                // tried in a triangle
constexpr std::size_t kRecordsAhead = 32, kCornersAhead = 16;  // triangles
constexpr std::size_t kBatch = 64;                             // triangles at a time; scratch stays in the first-level cache

// A batch of triangles as a structure of arrays.
struct Batch {
  std::int32_t ax[kBatch], az[kBatch], ay[kBatch], bx[kBatch], bz[kBatch], by[kBatch], cx[kBatch], cz[kBatch], cy[kBatch];
  std::int32_t px[kPoints][kBatch], pz[kPoints][kBatch];  // the points tried, snapped
  float y[kPoints][kBatch];                               // of the mesh there, steps
  double roomy[kBatch];                                   // >= 0: see choosePoints
};

// floor(v + 1/2), then to the nearest multiple of 2^bits; |v| < 2^30.
inline std::int32_t snapTo(double v, int bits, std::int32_t half) {
  const double w = v + 0.5;
  std::int32_t i = static_cast<std::int32_t>(w);
  i -= static_cast<double>(i) > w;
  return ((i + half) >> bits) << bits;
}
constexpr std::int32_t halfOf(int bits) { return bits == 0 ? 0 : std::int32_t{1} << (bits - 1); }

// The points to try in each triangle, and the mesh's height there: the plane y = a.y + gx (x - a.x) + gz (z - a.z).
// Snapping moves a point by at most 0.71 of the spacing. All points tried lie at least a fifth of a height away from each side, so in a
// triangle whose least height is well above the spacing (`roomy`) they stay inside, apart and off the corners, and need no test.
RIDGECAST_VECTOR_CLONES
void choosePoints(Batch& batch, int count, int bits) {
  const std::int32_t half = halfOf(bits);
  const double spacing2 = std::ldexp(kRoomy, 2 * bits);
#pragma omp simd
  for (int i = 0; i < count; ++i) {
    const double ax = batch.ax[i], az = batch.az[i], ay = batch.ay[i];
    const double bx = batch.bx[i] - ax, bz = batch.bz[i] - az, by = batch.by[i] - ay;
    const double cx = batch.cx[i] - ax, cz = batch.cz[i] - az, cy = batch.cy[i] - ay;
    const double area = bz * cx - bx * cz, gx = (bz * cy - cz * by) / area, gz = (cx * by - bx * cy) / area;
    const double ex = cx - bx, ez = cz - bz;
    const double b2 = bx * bx + bz * bz, c2 = cx * cx + cz * cz, e2 = ex * ex + ez * ez;
    const double bc2 = b2 > c2 ? b2 : c2, longest2 = bc2 > e2 ? bc2 : e2;
    batch.roomy[i] = area * area - longest2 * spacing2;
    const double sx = 3 * ax + bx + cx, sz = 3 * az + bz + cz;
    const auto attempt = [&](unsigned k, double x, double z) __attribute__((always_inline)) {
      const std::int32_t px = snapTo(x, bits, half), pz = snapTo(z, bits, half);
      batch.px[k][i] = px;
      batch.pz[k][i] = pz;
      batch.y[k][i] = static_cast<float>(ay + gx * (px - ax) + gz * (pz - az));
    };
    attempt(0, sx / 3, sz / 3);
    attempt(1, (sx + 2 * ax) / 5, (sz + 2 * az) / 5);
    attempt(2, (sx + 2 * (ax + bx)) / 5, (sz + 2 * (az + bz)) / 5);
    attempt(3, (sx + 2 * (ax + cx)) / 5, (sz + 2 * (az + cz)) / 5);
  }
}

// A point that may become a vertex: inside the closed triangle, on no corner.
bool admissible(const Vertex& a, const Vertex& b, const Vertex& c, Point2 p) {
  return triangulation::holds(a.point(), b.point(), c.point(), p) && !(p == a.point()) && !(p == b.point()) && !(p == c.point());
}

struct Trial {
  std::uint32_t slot;  // of the triangle in the list
  Point2 point;
  float y;  // steps, of the mesh there
};

// The points of the lattice around a place, the nearest first.
std::array<Point2, 4> pointsAround(double x, double z, int bits) {
  const double spacing = static_cast<double>(std::int32_t{1} << bits);
  const Point2 p{snapTo(x, bits, halfOf(bits)), snapTo(z, bits, halfOf(bits))};
  const std::int32_t dx = static_cast<std::int32_t>(x < p.x ? -spacing : spacing),
                     dz = static_cast<std::int32_t>(z < p.z ? -spacing : spacing);
  return {p, {p.x + dx, p.z}, {p.x, p.z + dz}, {p.x + dx, p.z + dz}};
}

// Points all over the part of a triangle in the directions that are drawn, no farther apart than view.closely on the screen if they were
// seen face on: what stands up is seen from the side, and may be in the picture where the mesh is not. The triangle is halved across its
// longest side until its pieces are small enough.
void lookClosely(const triangulation::Triangulation& mesh, triangulation::TriangleId t, std::uint32_t slot, int bits, const View& view,
                 std::vector<Trial>& trials) {
  using camera::Vec3;
  thread_local std::vector<std::array<Vec3, 3>> pieces;  // corners in metres from the eye
  const auto& v = mesh.triangle(t).v;
  const Vertex &a = mesh.vertex(v[0]), &b = mesh.vertex(v[1]), &c = mesh.vertex(v[2]);
  const double apart = view.closely / view.pixelsPerRadian, spacing = std::ldexp(lattice::kMetresPerStep, bits);
  pieces.assign(1, {view.relative(a.x, a.z, a.y), view.relative(b.x, b.z, b.y), view.relative(c.x, c.z, c.y)});
  bool whole = true;
  while (!pieces.empty()) {
    const std::array<Vec3, 3> p = pieces.back();
    pieces.pop_back();
    if (view.sector.misses(p)) continue;
    double longest2 = 0, flat2 = 0;
    std::size_t across = 0;  // the corner across from the longest side
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 &from = p[(k + 1) % 3], &to = p[(k + 2) % 3];
      const double dx = to.x - from.x, dy = to.y - from.y, dz = to.z - from.z, side2 = dx * dx + dy * dy + dz * dz;
      if (side2 > longest2) longest2 = side2, across = k;
      flat2 = std::max(flat2, dx * dx + dz * dz);
    }
    const Vec3 middle{(p[0].x + p[1].x + p[2].x) / 3, (p[0].y + p[1].y + p[2].y) / 3, (p[0].z + p[1].z + p[2].z) / 3};
    const double longest = std::sqrt(longest2),
                 distance = std::sqrt(middle.x * middle.x + middle.y * middle.y + middle.z * middle.z) - 2.0 / 3 * longest;
    if (longest <= apart * std::max(distance, 0.5) || flat2 <= spacing * spacing) {
      if (whole) return;  // the few that are tried anyway are as close
      for (const Point2 q : pointsAround(view.x + middle.x * lattice::kStepsPerMetre, view.z + middle.z * lattice::kStepsPerMetre, bits))
        if (admissible(a, b, c, q)) {
          trials.push_back({slot, q, static_cast<float>(planeHeight(a, b, c, q))});
          break;
        }
      continue;
    }
    whole = false;
    const Vec3 &from = p[(across + 1) % 3], &to = p[(across + 2) % 3], &third = p[across];
    const Vec3 half{(from.x + to.x) / 2, (from.y + to.y) / 2, (from.z + to.z) / 2};
    pieces.push_back({third, from, half});
    pieces.push_back({third, half, to});
  }
}

// What is seen of the error at a point, before the view's gain; nearly nothing where other ground hides it. `y`: the terrain's height,
// `onMesh`: the mesh's; steps.
float asSeen(const View& view, Point2 p, std::int32_t y, float onMesh, float error) {
  constexpr float kHidden = 1e-6f;  // those hidden are still told apart
  const camera::Vec3 at = view.relative(p.x, p.z, std::max(static_cast<float>(y), onMesh));
  const double flat2 = at.x * at.x + at.z * at.z, d2 = std::max(flat2 + at.y * at.y, 0.25);
  return error * static_cast<float>(std::sqrt(flat2) / (d2 * view.measure.rise(std::sqrt(d2)))) * (view.hides(at) ? kHidden : 1);
}

}  // namespace

struct Chooser::Scratch {  // grown once, kept by the worker
  std::span<const TriangleId> triangles;
  lattice::Point anchor;
  int level, bits;
  Batch batch;
  std::vector<Trial> trials;  // those of a triangle together
  std::vector<lattice::Step> x, z;
  std::vector<std::int32_t> y;
  std::vector<Candidate> best;
  std::vector<std::uint64_t> terms;
  std::vector<Point2> points;
  std::vector<Tint> tints;
  std::vector<float> smeared;  // of each trial, steps: what its colour counts for; empty: nothing
};

Chooser::Chooser(const triangulation::Triangulation& mesh, std::shared_ptr<const terrain::Terrain> terrain, Metric metric,
                 double colourError)
    : mesh_(mesh),
      terrain_(std::move(terrain)),
      metric_(metric),
      colour_(terrain_, colourError),
      curvatures_(metric == Metric::kThesis ? mesh.vertexCapacity() : 0) {
  expects(metric != Metric::kDefault, "a mesh is made by a metric of its own");
}

void Chooser::setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) {
  expects(terrain != nullptr, "a mesh has ground");
  terrain_ = std::move(terrain);
  colour_.setTerrain(terrain_);
  changed_.assign(changed.begin(), changed.end());
}

std::vector<std::int32_t> Chooser::heightsAt(std::span<const lattice::Point> points) {
  std::vector<lattice::Step> x, z;
  for (const lattice::Point& p : points) {
    x.push_back(p.x);
    z.push_back(p.z);
  }
  std::vector<std::int32_t> y(points.size());
  terrain_->heightSteps(x, z, y);
  heights_ += y.size();
  return y;
}

void Chooser::addCurvatures(std::span<const VertexId> vertices, lattice::Point anchor) {
  if (metric_ != Metric::kThesis) return;
  std::vector<lattice::Step> x, z;
  for (VertexId v : vertices) {
    x.push_back(anchor.x + mesh_.vertex(v).x);
    z.push_back(anchor.z + mesh_.vertex(v).z);
  }
  std::vector<float> out(vertices.size());
  terrain::curvatures(*terrain_, x, z, lattice::Step{1} << lattice::kStepBits, out);
  heights_ += 9 * vertices.size();
  for (std::size_t k = 0; k < vertices.size(); ++k) curvatures_[vertices[k]] = out[k];
}

void Chooser::moveCurvatures(std::span<const triangulation::Move> moves) {
  if (metric_ != Metric::kThesis) return;
  for (const auto& [from, to] : moves) curvatures_[to] = curvatures_[from];
}

Chooser::Choice Chooser::choose(std::span<const TriangleId> triangles, lattice::Point anchor, int level, const View* view) {
  thread_local Scratch scratch;
  scratch.triangles = triangles;
  scratch.anchor = anchor;
  scratch.level = level;
  scratch.bits = lattice::horizontalBits(level);
  scratch.trials.clear();
  scratch.terms.resize(triangles.size());
  const View* const closely = metric_ != Metric::kThesis && view && view->closely > 0 ? view : nullptr;
  for (std::size_t k = 0; k < std::min(kRecordsAhead, triangles.size()); ++k) mesh_.prefetch(triangles[k]);
  for (std::size_t k = 0; k < std::min(kCornersAhead, triangles.size()); ++k) mesh_.prefetchCorners(triangles[k]);
  for (std::size_t begin = 0; begin < triangles.size(); begin += kBatch) {
    const std::size_t count = std::min(kBatch, triangles.size() - begin);
    readBatch(begin, count, scratch);
    if (metric_ == Metric::kThesis) {
      for (std::size_t i = 0; i < count; ++i) tryThesisPoint(static_cast<std::uint32_t>(begin + i), scratch);
    } else {
      choosePoints(scratch.batch, static_cast<int>(count), scratch.bits);
      tryPoints(begin, count, closely, scratch);
    }
  }
  judgeTrials(closely, scratch);
  HeightRange seen;
  for (const std::int32_t y : scratch.y) seen.add({y, y});
  return {scratch.best, scratch.terms, seen};
}

// Corners into the batch, terms. Records lie anywhere in memory: they are fetched some triangles ahead of the one at hand.
inline void Chooser::readBatch(std::size_t begin, std::size_t count, Scratch& scratch) const {
  Batch& batch = scratch.batch;
  const std::span<const TriangleId> triangles = scratch.triangles;
  const auto hashOf = [&scratch](const Vertex& p) { return mesh::hashVertex({scratch.anchor.x + p.x, scratch.anchor.z + p.z, p.y}); };
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t k = begin + i;
    if (k + kRecordsAhead < triangles.size()) mesh_.prefetch(triangles[k + kRecordsAhead]);
    if (k + kCornersAhead < triangles.size()) mesh_.prefetchCorners(triangles[k + kCornersAhead]);
    const auto& v = mesh_.triangle(triangles[k]).v;
    const Vertex &a = mesh_.vertex(v[0]), &b = mesh_.vertex(v[1]), &c = mesh_.vertex(v[2]);
    batch.ax[i] = a.x, batch.az[i] = a.z, batch.ay[i] = a.y;
    batch.bx[i] = b.x, batch.bz[i] = b.z, batch.by[i] = b.y;
    batch.cx[i] = c.x, batch.cz[i] = c.z, batch.cy[i] = c.y;
    const std::uint64_t ma = hashOf(a), mb = hashOf(b), mc = hashOf(c);
    const bool ab = triangulation::smaller(a.point(), b.point()), ac = triangulation::smaller(a.point(), c.point()),
               bc = triangulation::smaller(b.point(), c.point());
    const bool aFirst = ab & ac, bFirst = !ab & bc;
    scratch.terms[k] = mesh::hashMixed(aFirst ? ma : bFirst ? mb : mc, aFirst ? mb : bFirst ? mc : ma, aFirst ? mc : bFirst ? ma : mb);
  }
}

inline void Chooser::tryPoints(std::size_t begin, std::size_t count, const View* closely, Scratch& scratch) const {
  const Batch& batch = scratch.batch;
  std::vector<Trial>& trials = scratch.trials;
  for (std::size_t i = 0; i < count; ++i) {
    const auto slot = static_cast<std::uint32_t>(begin + i);
    const std::size_t first = trials.size();
    for (unsigned k = 0; k < kPoints; ++k) {
      const Point2 p{batch.px[k][i], batch.pz[k][i]};
      if (batch.roomy[i] <= 0) {
        const auto& v = mesh_.triangle(scratch.triangles[slot]).v;
        if (!admissible(mesh_.vertex(v[0]), mesh_.vertex(v[1]), mesh_.vertex(v[2]), p)) continue;
        if (std::any_of(trials.begin() + static_cast<std::ptrdiff_t>(first), trials.end(),
                        [&](const Trial& other) { return other.point == p; }))
          continue;
      }
      trials.push_back({slot, p, batch.y[k][i]});
    }
    if (!changed_.empty()) tryChanged(slot, scratch);
    if (closely) lookClosely(mesh_, scratch.triangles[slot], slot, scratch.bits, *closely, trials);
  }
}

// An edit may be far narrower than the triangle that it lies in: points of its own are tried, too.
void Chooser::tryChanged(std::uint32_t slot, Scratch& scratch) const {
  constexpr int kAcross = 6;
  constexpr lattice::Step kNarrow = 1 << 18;  // wider ones are found without
  const int bits = scratch.bits;
  const auto& v = mesh_.triangle(scratch.triangles[slot]).v;
  const Vertex &a = mesh_.vertex(v[0]), &b = mesh_.vertex(v[1]), &c = mesh_.vertex(v[2]);
  const lattice::Area box = boxOf(a, b, c, scratch.anchor);
  for (const lattice::Area& area : changed_) {
    if (!area.meets(box) || area.x1 - area.x0 > kNarrow || area.z1 - area.z0 > kNarrow) continue;
    const lattice::Point low{std::max(area.x0, box.x0), std::max(area.z0, box.z0)},
        high{std::min(area.x1, box.x1), std::min(area.z1, box.z1)};
    for (int j = 0; j < kAcross; ++j)
      for (int i = 0; i < kAcross; ++i) {
        const auto along = [](lattice::Step from, lattice::Step to, int k) {
          const lattice::Step at = from + (to - from) * (2 * k + 1) / (2 * kAcross);
          return static_cast<double>(at);
        };
        const Point2 p{snapTo(along(low.x, high.x, i) - static_cast<double>(scratch.anchor.x), bits, halfOf(bits)),
                       snapTo(along(low.z, high.z, j) - static_cast<double>(scratch.anchor.z), bits, halfOf(bits))};
        if (admissible(a, b, c, p)) scratch.trials.push_back({slot, p, static_cast<float>(planeHeight(a, b, c, p))});
      }
  }
}

void Chooser::tryThesisPoint(std::uint32_t slot, Scratch& scratch) const {
  const int bits = scratch.bits;
  const auto& v = mesh_.triangle(scratch.triangles[slot]).v;
  const Vertex &a = mesh_.vertex(v[0]), &b = mesh_.vertex(v[1]), &c = mesh_.vertex(v[2]);
  const double wa = curvatures_[v[0]] + 1e-6, wb = curvatures_[v[1]] + 1e-6, wc = curvatures_[v[2]] + 1e-6, w = wa + wb + wc;
  const double sx = double(a.x) + b.x + c.x, sz = double(a.z) + b.z + c.z;
  const Point2 p{snapTo(0.4 * sx / 3 + 0.6 * (wa * a.x + wb * b.x + wc * c.x) / w, bits, halfOf(bits)),
                 snapTo(0.4 * sz / 3 + 0.6 * (wa * a.z + wb * b.z + wc * c.z) / w, bits, halfOf(bits))};
  if (admissible(a, b, c, p)) scratch.trials.push_back({slot, p, static_cast<float>(planeHeight(a, b, c, p))});
}

// The worst of each triangle's points, by the terrain's heights there.
inline void Chooser::judgeTrials(const View* closely, Scratch& scratch) {
  const std::vector<Trial>& trials = scratch.trials;
  auto &px = scratch.x, &pz = scratch.z;
  auto& py = scratch.y;
  std::vector<Candidate>& best = scratch.best;
  px.resize(trials.size());
  pz.resize(trials.size());
  py.resize(trials.size());
  for (std::size_t k = 0; k < trials.size(); ++k) {
    px[k] = scratch.anchor.x + trials[k].point.x;
    pz[k] = scratch.anchor.z + trials[k].point.z;
  }
  terrain_->heightSteps(px, pz, py);
  heights_.fetch_add(trials.size(), std::memory_order_relaxed);
  scratch.smeared.clear();  // the worker may have done another camera's mesh before
  if (colour_.on()) judgeColours(scratch);
  best.assign(scratch.triangles.size(), {{kFarAway, kFarAway}, kFarAway, 0.0f});
  const auto errorAt = [&scratch, level = scratch.level](std::size_t k) {
    const float error = std::abs(scratch.trials[k].y - static_cast<float>(lattice::snapHeight(scratch.y[k], level)));
    return scratch.smeared.empty() ? error : std::max(error, scratch.smeared[k]);
  };
  for (std::size_t k = 0; k < trials.size();) {
    const std::uint32_t slot = trials[k].slot;
    std::size_t worst = k;
    float most = 0;
    for (; k < trials.size() && trials[k].slot == slot; ++k) {
      const float error = errorAt(k), worth = closely ? asSeen(*closely, trials[k].point, py[k], trials[k].y, error) : error;
      worst = worth > most ? k : worst;
      most = std::max(most, worth);
    }
    if (most > 0) best[slot] = {trials[worst].point, py[worst], errorAt(worst)};
  }
  if (const Measure measure(metric_); measure.byArea)
    for (std::size_t k = 0; k < best.size(); ++k) best[k].error *= static_cast<float>(measure.weight(areaOf(mesh_, scratch.triangles[k])));
}

// What the colours of the trials count for.
void Chooser::judgeColours(Scratch& scratch) const {
  auto& points = scratch.points;
  points.clear();
  for (const TriangleId t : scratch.triangles)
    for (const VertexId v : mesh_.triangle(t).v) points.push_back(mesh_.vertex(v).point());
  for (const Trial& trial : scratch.trials) points.push_back(trial.point);
  scratch.tints.resize(points.size());
  colour_.tints(scratch.anchor, points, scratch.level, scratch.tints);
  scratch.smeared.resize(scratch.trials.size());
  const Tint* const of = scratch.tints.data();
  for (std::size_t k = 0; k < scratch.trials.size(); ++k) {
    const Trial& trial = scratch.trials[k];
    const auto& v = mesh_.triangle(scratch.triangles[trial.slot]).v;
    const Tint* const corner = of + 3 * trial.slot;
    scratch.smeared[k] =
        static_cast<float>(colour_.at({{{mesh_.vertex(v[0]), corner[0]}, {mesh_.vertex(v[1]), corner[1]}, {mesh_.vertex(v[2]), corner[2]}}},
                                      trial.point, of[3 * scratch.triangles.size() + k]));
  }
}

}  // namespace ridgecast::refinement
