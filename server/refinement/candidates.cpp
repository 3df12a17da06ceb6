#include "server/refinement/candidates.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "common/mesh/leaf_mesh.h"
#include "server/refinement/screening.h"

// Compiled for several instruction sets, chosen when the program starts; nothing is contracted, so the results are the same in each.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RIDGECAST_VECTOR_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define RIDGECAST_VECTOR_CLONES
#endif

namespace ridgecast::refinement {

using triangulation::orientation;
using triangulation::Point2;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::Vertex;

double planeHeight(const Vertex& a, const Vertex& b, const Vertex& c, Point2 p) {
  const double bx = double(b.x) - a.x, bz = double(b.z) - a.z, cx = double(c.x) - a.x, cz = double(c.z) - a.z, px = double(p.x) - a.x,
               pz = double(p.z) - a.z;
  const double area = bz * cx - bx * cz;
  const double wb = (pz * cx - px * cz) / area, wc = (bz * px - bx * pz) / area;
  return a.y + wb * (double(b.y) - a.y) + wc * (double(c.y) - a.y);
}

double areaWeight(const Vertex& a, const Vertex& b, const Vertex& c) {
  const double bx = double(b.x) - a.x, bz = double(b.z) - a.z, by = double(b.y) - a.y, cx = double(c.x) - a.x, cz = double(c.z) - a.z,
               cy = double(c.y) - a.y;
  const double nx = by * cz - bz * cy, ny = bz * cx - bx * cz, nz = bx * cy - by * cx;
  return std::sqrt(std::sqrt(0.5 * std::sqrt(nx * nx + ny * ny + nz * nz)));
}

double heightOnTriangle(const Triangulation& mesh, TriangleId t, Point2 p) {
  const auto& v = mesh.triangle(t).v;
  return planeHeight(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]), p);
}

namespace {

// (least height / spacing)^2 from which on snapping is harmless: a fifth of the height is then 1.4 spacings.
constexpr double kRoomy = 49;
constexpr unsigned kPoints = 4;                               // tried in a triangle
constexpr std::size_t kRecordsAhead = 16, kCornersAhead = 8;  // triangles
constexpr std::size_t kBatch = 64;                            // triangles at a time; scratch stays in the first-level cache

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
  if (orientation(a.point(), b.point(), p) < 0 || orientation(b.point(), c.point(), p) < 0 || orientation(c.point(), a.point(), p) < 0)
    return false;
  return !(p == a.point()) && !(p == b.point()) && !(p == c.point());
}

struct Trial {
  std::uint32_t slot;  // of the triangle in `fresh`
  Point2 point;
  float y;  // steps, of the mesh there
};

struct Scratch {
  Batch batch;
  std::vector<TriangleId> fresh;
  std::vector<Trial> trials;
  std::vector<lattice::Step> x, z;
  std::vector<std::int32_t> y;
  std::vector<Surface::Candidate> best;
  std::vector<float> most;  // what each is worth
};

// The points of the lattice around a place, the nearest first.
std::array<Point2, 4> pointsAround(double x, double z, int bits) {
  const double spacing = static_cast<double>(std::int32_t{1} << bits);
  const Point2 p{snapTo(x, bits, halfOf(bits)), snapTo(z, bits, halfOf(bits))};
  const std::int32_t dx = static_cast<std::int32_t>(x < p.x ? -spacing : spacing),
                     dz = static_cast<std::int32_t>(z < p.z ? -spacing : spacing);
  return {p, {p.x + dx, p.z}, {p.x, p.z + dz}, {p.x + dx, p.z + dz}};
}

// Points all over the part of a triangle in the directions that are drawn, no farther apart than view.closely on the screen were they seen face on: what
// stands up is seen from the side, and may be in the picture where the mesh is not. The triangle is halved across its longest side until its pieces are
// small enough.
void lookClosely(const Triangulation& mesh, TriangleId t, std::uint32_t slot, int bits, const View& view, std::vector<Trial>& trials) {
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

// What is seen of the error at a point, but for the view's gain: where other ground hides it nearly nothing. `y`: the terrain's height, `onMesh`: the
// mesh's; steps.
float asSeen(const View& view, Point2 p, std::int32_t y, float onMesh, float error) {
  constexpr float kHidden = 1e-6f;  // those hidden are still told apart
  const camera::Vec3 at = view.relative(p.x, p.z, std::max(static_cast<float>(y), onMesh));
  const double flat2 = at.x * at.x + at.z * at.z, d2 = std::max(flat2 + at.y * at.y, 0.25);
  return error * static_cast<float>(std::sqrt(flat2) / (d2 * (view.area ? std::sqrt(std::sqrt(d2)) : 1))) * (view.hides(at) ? kHidden : 1);
}

// The thesis's one point.
void tryThesisPoint(const Triangulation& mesh, const Surface& surface, TriangleId t, std::uint32_t slot, int bits,
                    std::vector<Trial>& trials) {
  const auto& v = mesh.triangle(t).v;
  const Vertex &a = mesh.vertex(v[0]), &b = mesh.vertex(v[1]), &c = mesh.vertex(v[2]);
  const double wa = surface.curvature[v[0]] + 1e-6, wb = surface.curvature[v[1]] + 1e-6, wc = surface.curvature[v[2]] + 1e-6,
               w = wa + wb + wc;
  const double sx = double(a.x) + b.x + c.x, sz = double(a.z) + b.z + c.z;
  const Point2 p{snapTo(0.4 * sx / 3 + 0.6 * (wa * a.x + wb * b.x + wc * c.x) / w, bits, halfOf(bits)),
                 snapTo(0.4 * sz / 3 + 0.6 * (wa * a.z + wb * b.z + wc * c.z) / w, bits, halfOf(bits))};
  if (admissible(a, b, c, p)) trials.push_back({slot, p, static_cast<float>(planeHeight(a, b, c, p))});
}

}  // namespace

std::uint64_t evaluateFresh(Triangulation& mesh, Surface& surface, const terrain::Terrain& terrain, triangulation::RegionId region,
                            int level, Metric metric, const View* view, HeightRange& ground) {
  thread_local Scratch scratch;  // grown once, kept by the worker
  auto& [batch, fresh, trials, px, pz, py, best, most] = scratch;
  fresh.clear();
  trials.clear();
  auto& pages = mesh.trianglePages();
  pages.takeFreshPages(region, [&](std::uint32_t page) {
    const triangulation::TrianglePages::Mask mask = pages.freshMask(page);
    if (mask == pages.aliveMask(page)) surface.beginScreen(page, view ? view->travel : -1);
    for (triangulation::TrianglePages::Mask m = mask; m != 0; m &= m - 1)
      fresh.push_back(page * CandidatePage::kSlots + static_cast<TriangleId>(std::countr_zero(m)));
  });
  if (fresh.empty()) return 0;
  const int bits = lattice::horizontalBits(level);
  const bool closely = view && view->closely > 0;
  // Records lie anywhere in memory: they are asked for some triangles ahead of the one at hand.
  const auto askRecord = [&](std::size_t k) {
    if (k < fresh.size()) mesh.prefetch(fresh[k]);
  };
  const auto askCorners = [&](std::size_t k) {
    if (k >= fresh.size()) return;
    const TriangleId t = fresh[k];
    mesh.prefetchCorners(t);
    for (triangulation::VertexId v : mesh.triangle(t).v) __builtin_prefetch(&surface.vertices[v]);
    __builtin_prefetch(&surface.hash[t]);
  };
  for (std::size_t k = 0; k < kRecordsAhead; ++k) askRecord(k);
  for (std::size_t k = 0; k < kCornersAhead; ++k) askCorners(k);
  for (std::size_t begin = 0; begin < fresh.size(); begin += kBatch) {
    const std::size_t count = std::min(kBatch, fresh.size() - begin);
    for (std::size_t i = 0; i < count; ++i) {
      const TriangleId t = fresh[begin + i];
      askRecord(begin + i + kRecordsAhead);
      askCorners(begin + i + kCornersAhead);
      pages.clearFresh(t);
      const auto& v = mesh.triangle(t).v;
      const Vertex &a = mesh.vertex(v[0]), &b = mesh.vertex(v[1]), &c = mesh.vertex(v[2]);
      batch.ax[i] = a.x, batch.az[i] = a.z, batch.ay[i] = a.y;
      batch.bx[i] = b.x, batch.bz[i] = b.z, batch.by[i] = b.y;
      batch.cx[i] = c.x, batch.cz[i] = c.z, batch.cy[i] = c.y;
      const std::uint64_t ma = surface.vertices[v[0]].mixed, mb = surface.vertices[v[1]].mixed, mc = surface.vertices[v[2]].mixed;
      const bool ab = triangulation::smaller(a.point(), b.point()), ac = triangulation::smaller(a.point(), c.point()),
                 bc = triangulation::smaller(b.point(), c.point());
      const bool aFirst = ab & ac, bFirst = !ab & bc;
      surface.setHash(t, mesh::hashMixed(aFirst ? ma : bFirst ? mb : mc, aFirst ? mb : bFirst ? mc : ma, aFirst ? mc : bFirst ? ma : mb));
    }
    if (metric == Metric::kThesis) {
      for (std::size_t i = 0; i < count; ++i)
        tryThesisPoint(mesh, surface, fresh[begin + i], static_cast<std::uint32_t>(begin + i), bits, trials);
      continue;
    }
    choosePoints(batch, static_cast<int>(count), bits);
    for (std::size_t i = 0; i < count; ++i) {
      const auto slot = static_cast<std::uint32_t>(begin + i);
      const std::size_t first = trials.size();
      for (unsigned k = 0; k < kPoints; ++k) {
        const Point2 p{batch.px[k][i], batch.pz[k][i]};
        if (batch.roomy[i] <= 0) {
          const auto& v = mesh.triangle(fresh[slot]).v;
          if (!admissible(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]), p)) continue;
          if (std::any_of(trials.begin() + static_cast<std::ptrdiff_t>(first), trials.end(),
                          [&](const Trial& other) { return other.point == p; }))
            continue;
        }
        trials.push_back({slot, p, batch.y[k][i]});
      }
      if (closely) lookClosely(mesh, fresh[slot], slot, bits, *view, trials);
    }
  }
  px.resize(trials.size());
  pz.resize(trials.size());
  py.resize(trials.size());
  for (std::size_t k = 0; k < trials.size(); ++k) {
    px[k] = surface.anchor.x + trials[k].point.x;
    pz[k] = surface.anchor.z + trials[k].point.z;
  }
  terrain.heightSteps(px, pz, py);
  best.assign(fresh.size(), {{0, 0}, 0, 0.0f});
  if (closely) most.assign(fresh.size(), 0.0f);
  for (std::size_t k = 0; k < trials.size(); ++k) {
    const auto& [slot, p, y] = trials[k];
    const float error = std::abs(y - static_cast<float>(lattice::snapHeight(py[k], level)));
    float& least = closely ? most[slot] : best[slot].error;
    const float worth = closely ? asSeen(*view, p, py[k], y, error) : error;
    if (worth <= least) continue;
    least = worth;
    best[slot] = {p, py[k], error};
  }
  if (metric == Metric::kArea)
    for (std::size_t k = 0; k < fresh.size(); ++k) {
      const auto& v = mesh.triangle(fresh[k]).v;
      best[k].error *= static_cast<float>(areaWeight(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2])));
    }
  RegionScreen& screen = surface.regions[region];
  const auto askCandidate = [&](std::size_t k) {
    if (k < fresh.size()) surface.prefetchCandidate(fresh[k]);
  };
  for (std::size_t k = 0; k < 4; ++k) askCandidate(k);
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    askCandidate(k + 4);
    Surface::Candidate& c = best[k];
    if (!(c.error > 0)) c = {{kFarAway, kFarAway}, kFarAway, 0.0f};
    surface.setCandidate(fresh[k], c);
    if (view)
      foldCandidate(surface.dues[fresh[k] / CandidatePage::kSlots], surface.screens[fresh[k] / CandidatePage::kSlots], screen, c, *view);
    else
      surface.wakeCandidate(fresh[k], region);
  }
  for (const std::int32_t y : py) ground.add({y, y});
  return trials.size();
}

}  // namespace ridgecast::refinement
