#include "server/refinement/screening.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace ridgecast::refinement {

using camera::Vec3;
using triangulation::Pages;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::Vertex;

namespace {

double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Those asleep wake when the camera has moved this share of the distance to the nearest one, or turned this far (radians): together
// 7.5 degrees, and the wide frustum is 8 degrees wider on each side than the one that is drawn at 60 degrees.
constexpr double kWakeMove = 0.08, kWakeTurn = 0.05;
// Where blank slots lie, so that they are nobody's nearest; steps, its square's square fits a float.
constexpr std::int32_t kFarAway = 1 << 29;
// Triangles smaller on screen than this are left alone.
constexpr double kLeastArea = 0.25;     // square pixels

// Twice the area vector of a triangle, in steps.
Vec3 areaVector(const Triangulation& mesh, TriangleId t) {
  const auto& v = mesh.triangle(t).v;
  const Vertex &a = mesh.vertex(v[0]), &b = mesh.vertex(v[1]), &c = mesh.vertex(v[2]);
  const Vec3 u{double(b.x) - a.x, double(b.y) - a.y, double(b.z) - a.z}, w{double(c.x) - a.x, double(c.y) - a.y, double(c.z) - a.z};
  return {u.y * w.z - u.z * w.y, u.z * w.x - u.x * w.z, u.x * w.y - u.y * w.x};
}

}  // namespace

View::View(const camera::Camera& camera, lattice::Point anchor, double travelled, double turned, bool onTheWay)
    : x(static_cast<std::int32_t>(camera.pose.x - anchor.x)),
      z(static_cast<std::int32_t>(camera.pose.z - anchor.z)),
      y(static_cast<float>(camera.pose.y * lattice::kStepsPerMetre)),
      pixelsPerRadian(camera::pixelsPerRadian(camera.projection)),
      wide(camera.pose, camera.projection, kWidening),
      forward(camera::forward(camera.pose)),
      right(camera::right(camera.pose)),
      up(camera::up(camera.pose)),
      tanX(std::tan(camera.projection.verticalFov / 2) * camera.projection.aspect()),
      tanY(std::tan(camera.projection.verticalFov / 2)),
      travel(travelled),
      turn(turned),
      moving(onTheWay) {}

namespace {

struct PageResult {
  std::uint64_t wanted;
  float steepest2, nearest2;        // squared
};

// One page of arrays. Squared pixels times d^4 against the squared threshold times d^4: no root. Dead slots are blank. Compiled for several instruction sets, chosen when the program starts; the arithmetic is the same in each.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
__attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#endif
PageResult screenPage(const std::int32_t* __restrict x, const std::int32_t* __restrict z, const std::int32_t* __restrict y,
                      const float* __restrict error, std::int32_t cx, std::int32_t cz, float cy, float ppr2, float least) {
  std::uint64_t bits[Pages::kSlots];
  float most = 0, least2 = std::numeric_limits<float>::max();
#pragma omp simd reduction(max : most) reduction(min : least2)
  for (unsigned s = 0; s < Pages::kSlots; ++s) {
    const float dx = static_cast<float>(x[s] - cx), dz = static_cast<float>(z[s] - cz), dy = static_cast<float>(y[s]) - cy;
    const float flat = dx * dx + dz * dz, d2 = flat + dy * dy, n = d2 < kNearest * kNearest ? kNearest * kNearest : d2;
    const float e = error[s] > 0 ? error[s] : 0.0f, e2 = e * e;
    const bool wanted = ppr2 * e2 * flat >= least * n * n;
    const float steep = wanted ? 0.0f : e2 / n;
    most = steep > most ? steep : most;
    least2 = n < least2 ? n : least2;
    bits[s] = wanted ? std::uint64_t{1} << s : 0;
  }
  std::uint64_t mask = 0;
  for (unsigned s = 0; s < Pages::kSlots; ++s) mask |= bits[s];
  return {mask, most, least2};
}

}  // namespace

void screenPixels(const Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view, double threshold,
                  std::vector<Pending>& out) {
  const Pages& pages = mesh.trianglePages();
  const float ppr2 = static_cast<float>(view.pixelsPerRadian * view.pixelsPerRadian), least = static_cast<float>(threshold * threshold);
  const std::size_t before = out.size();
  const double spared = view.moving ? kSlack * threshold : threshold;
  for (std::uint32_t page : pages.pagesOf(region)) {
    PageScreen& known = surface.screens[page];
    if (known.asleep != 0 && (view.travel - known.sleptTravel > kWakeMove * known.nearest || view.turn - known.sleptTurn > kWakeTurn)) {
      for (std::uint64_t m = known.asleep; m != 0; m &= m - 1) {
        float& e = surface.error[page * Pages::kSlots + static_cast<std::uint32_t>(std::countr_zero(m))];
        e = std::abs(e);
      }
      known.asleep = 0;
      known.travel = -1;
    }
    if (known.travel >= 0) {
      const double moved = view.travel - known.travel;
      if (moved < known.nearest && view.pixelsPerRadian * known.steepest * known.nearest < spared * (known.nearest - moved)) continue;
    }
    const std::uint32_t base = page * Pages::kSlots;
    const std::uint64_t alive = pages.aliveMask(page);
    known.asleep &= alive;
    for (std::uint64_t m = ~alive & ~known.blank; m != 0; m &= m - 1) {
      const std::uint32_t t = base + static_cast<std::uint32_t>(std::countr_zero(m));
      surface.error[t] = 0;
      surface.x[t] = surface.z[t] = surface.y[t] = kFarAway;
    }
    known.blank = ~alive;
    const PageResult r = screenPage(&surface.x[base], &surface.z[base], &surface.y[base], &surface.error[base], view.x, view.z, view.y, ppr2, least);
    known.travel = view.travel;
    known.steepest = std::sqrt(r.steepest2);
    known.nearest = std::sqrt(r.nearest2);
    const auto fallAsleep = [&](TriangleId t) {
      if (known.asleep == 0) {
        known.sleptTravel = view.travel;
        known.sleptTurn = view.turn;
      }
      known.asleep |= std::uint64_t{1} << (t % Pages::kSlots);
      surface.error[t] = -surface.error[t];
    };
    for (std::uint64_t mask = r.wanted; mask != 0; mask &= mask - 1) {
      const TriangleId t = base + static_cast<std::uint32_t>(std::countr_zero(mask));
      const Vec3 at = view.relative(surface.x[t], surface.z[t], surface.y[t]);
      if (!view.wide.contains(at)) {
        fallAsleep(t);
        continue;
      }
      // Both in metres: the candidate's direction and the area that it sees.
      const double d2 = std::max(dot(at, at), 0.25), d = std::sqrt(d2);
      const Vec3 area = areaVector(mesh, t);
      const double seen = std::abs(dot(area, at)) / d * 0.5 * lattice::kMetresPerStep * lattice::kMetresPerStep;
      const double squarePixels = seen * view.pixelsPerRadian * view.pixelsPerRadian / d2;
      if (squarePixels < kLeastArea) {
        fallAsleep(t);
        continue;
      }
      const double flat = at.x * at.x + at.z * at.z;
      const double pixels = surface.error[t] * lattice::kMetresPerStep * view.pixelsPerRadian * std::sqrt(flat) / d2;
      // Larger triangles first at equal error: their error covers more of the picture.
      out.push_back({t, {surface.x[t], surface.z[t]}, static_cast<float>(pixels * std::sqrt(std::sqrt(squarePixels)))});
      known.travel = -1;  // until it is inserted, or no longer wanted
    }
  }
  std::sort(out.begin() + static_cast<std::ptrdiff_t>(before), out.end());
}

void screenThesis(const Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view, double threshold,
                  std::vector<Pending>& out) {
  const std::size_t before = out.size();
  struct Screen {
    double x, y;
    bool ahead;
  };
  const auto project = [&](const Vec3& p) {
    const double depth = dot(p, view.forward);
    if (depth < 0.05) return Screen{0, 0, false};
    return Screen{dot(p, view.right) / (depth * view.tanX), dot(p, view.up) / (depth * view.tanY), true};
  };
  const auto distance = [](const Screen& a, const Screen& b) { return std::hypot(a.x - b.x, a.y - b.y); };
  mesh.trianglePages().forEach(region, [&](TriangleId t) {
    if (mesh.trianglePages().fresh(t) || surface.error[t] <= 0) return;
    Screen corner[3];
    bool inside = false;
    for (int k = 0; k < 3; ++k) {
      const Vertex& v = mesh.vertex(mesh.triangle(t).v[k]);
      const Vec3 p = view.relative(v.x, v.z, v.y);
      inside = inside || view.wide.contains(p);
      corner[k] = project(p);
    }
    if (!inside || !corner[0].ahead || !corner[1].ahead || !corner[2].ahead) return;
    const double a = distance(corner[0], corner[1]), b = distance(corner[1], corner[2]), c = distance(corner[2], corner[0]);
    const double area = std::max(0.0, (a + b + c) * (-a + b + c) * (a - b + c) * (a + b - c));  // Heron, without the root
    const triangulation::Point2 p{surface.x[t], surface.z[t]};
    const Screen on = project(view.relative(p.x, p.z, heightOnTriangle(mesh, t, p))), lifted = project(view.relative(p.x, p.z, surface.y[t]));
    if (!on.ahead || !lifted.ahead) return;
    const double value = std::pow(area, kThesisArea) * kThesisDistance * distance(on, lifted);
    if (value >= threshold) out.push_back({t, p, static_cast<float>(value)});
  });
  std::sort(out.begin() + static_cast<std::ptrdiff_t>(before), out.end());
}

}  // namespace ridgecast::refinement
