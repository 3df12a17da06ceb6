#include "server/refinement/screening.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "server/refinement/candidates.h"

namespace ridgecast::refinement {

using camera::Vec3;
using triangulation::TriangleId;
using triangulation::TrianglePages;
using triangulation::Triangulation;
using triangulation::Vertex;

namespace {

double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Triangles smaller than this on the screen are left alone, unless they hide an error of a pixel: one seen edge-on may.
constexpr double kSpeck = 0.25;  // square pixels

// areaWeight() of a triangle with twice this area vector, metres.
double rootOfArea(const Vec3& area) { return std::sqrt(std::sqrt(0.5 * std::sqrt(dot(area, area))) * lattice::kStepsPerMetre); }

// So many triangles, and pages' bounds, are fetched ahead of the one at hand.
constexpr std::size_t kAhead = 8;

// Twice the area vector of a triangle.
Vec3 areaVector(const std::array<Vec3, 3>& corners) {
  const auto& [a, b, c] = corners;
  const Vec3 u{b.x - a.x, b.y - a.y, b.z - a.z}, w{c.x - a.x, c.y - a.y, c.z - a.z};
  return {u.y * w.z - u.z * w.y, u.z * w.x - u.x * w.z, u.x * w.y - u.y * w.x};
}

}  // namespace

View::View(const camera::Camera& camera, lattice::Point anchor, double travelled, double turned, bool onTheWay, bool byArea)
    : x(static_cast<std::int32_t>(camera.pose.x - anchor.x)),
      z(static_cast<std::int32_t>(camera.pose.z - anchor.z)),
      y(static_cast<float>(camera.pose.y * lattice::kStepsPerMetre)),
      pixelsPerRadian(camera::pixelsPerRadian(camera.projection)),
      wide(camera.pose, camera.projection, kWidening),
      sector(camera.pose, camera.projection),
      forward(camera::forward(camera.pose)),
      right(camera::right(camera.pose)),
      up(camera::up(camera.pose)),
      tanX(std::tan(camera.projection.verticalFov / 2) * camera.projection.aspect()),
      tanY(std::tan(camera.projection.verticalFov / 2)),
      travel(travelled),
      turn(turned),
      spare(std::min(std::atan(kWidening * tanX) - std::atan(tanX), std::atan(kWidening * tanY) - std::atan(tanY))),
      moving(onTheWay),
      area(byArea),
      gain(byArea ? pixelsPerRadian * std::sqrt(pixelsPerRadian) : pixelsPerRadian) {}

namespace {

struct PageLook {
  triangulation::TrianglePages::Mask wanted;
  float steepest2, seen2, nearest2;  // squared, of the candidates not wanted
};
struct Eye {
  std::int32_t x, z;
  float y, gain2, least;  // gain and threshold, squared
};

// One page, sixteen candidates at a time: the square of what is seen, and of the threshold, both times d^(2 p + 2). Dead slots are blank.
template <bool kByArea>
inline __attribute__((always_inline)) PageLook lookThrough(const CandidatePage& page, const Eye& eye) {
  constexpr unsigned kWidth = 16, kVectors = CandidatePage::kSlots / kWidth;
  typedef float Floats __attribute__((vector_size(4 * kWidth)));
  typedef std::int32_t Ints __attribute__((vector_size(4 * kWidth)));
  const auto& x = reinterpret_cast<const Ints(&)[kVectors]>(page.x);
  const auto& z = reinterpret_cast<const Ints(&)[kVectors]>(page.z);
  const auto& y = reinterpret_cast<const Ints(&)[kVectors]>(page.y);
  const auto& error = reinterpret_cast<const Floats(&)[kVectors]>(page.error);
  const Floats zero{}, nearest2 = zero + kNearest * kNearest;
  Floats steepest = zero, mostSeen = zero, nearest = zero + std::numeric_limits<float>::max();
  Ints wanted[kVectors], any{};
  for (unsigned k = 0; k < kVectors; ++k) {
    const Floats dx = __builtin_convertvector(x[k] - eye.x, Floats), dz = __builtin_convertvector(z[k] - eye.z, Floats),
                 dy = __builtin_convertvector(y[k], Floats) - eye.y;
    const Floats flat = dx * dx + dz * dz, d2 = flat + dy * dy, n = d2 < nearest2 ? nearest2 : d2;
    const Floats e = error[k] > zero ? error[k] : zero, e2 = e * e;
    Floats reach = n;  // d^(2 p)
    if constexpr (kByArea)
      for (unsigned lane = 0; lane < kWidth; ++lane) reach[lane] = n[lane] * __builtin_sqrtf(n[lane]);
    wanted[k] = eye.gain2 * e2 * flat >= eye.least * n * reach;
    any |= wanted[k];
    const Floats inverse = 1.0f / n, steep = wanted[k] ? zero : (kByArea ? e2 / reach : e2 * inverse), seen = steep * inverse * flat;
    steepest = steep > steepest ? steep : steepest;
    mostSeen = seen > mostSeen ? seen : mostSeen;
    nearest = n < nearest ? n : nearest;
  }
  // Halves against each other until all lanes hold the same.
  const Ints lanes{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  for (std::int32_t apart = kWidth / 2; apart > 0; apart /= 2) {
    const Ints other = lanes ^ apart;
    const Floats s = __builtin_shuffle(steepest, other), d = __builtin_shuffle(nearest, other), m = __builtin_shuffle(mostSeen, other);
    steepest = s > steepest ? s : steepest;
    mostSeen = m > mostSeen ? m : mostSeen;
    nearest = d < nearest ? d : nearest;
    any |= __builtin_shuffle(any, other);
  }
  PageLook result{0, steepest[0], mostSeen[0], nearest[0]};
  if (any[0] != 0)
    for (unsigned k = 0; k < CandidatePage::kSlots; ++k)
      result.wanted |= static_cast<triangulation::TrianglePages::Mask>(wanted[k / kWidth][k % kWidth] != 0) << k;
  return result;
}
// Compiled for several instruction sets, chosen when the program starts; the arithmetic is the same in each.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RIDGECAST_VECTOR_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define RIDGECAST_VECTOR_CLONES
#endif
RIDGECAST_VECTOR_CLONES PageLook screenPageInPixels(const CandidatePage& page, const Eye& eye) { return lookThrough<false>(page, eye); }
RIDGECAST_VECTOR_CLONES PageLook screenPageByArea(const CandidatePage& page, const Eye& eye) { return lookThrough<true>(page, eye); }

// Whether a triangle and its candidate `at`, on the terrain as on the mesh, cannot be seen behind other ground. `error`: at least a bound of the
// distance between the two. All in metres from the eye.
bool isHidden(const View& view, const std::array<Vec3, 3>& corners, const Vec3& at, double error) {
  return view.hides({at.x, at.y + error, at.z}) &&
         std::all_of(corners.begin(), corners.end(), [&](const Vec3& corner) { return view.hides(corner); });
}

void wake(PageScreen& known, CandidatePage& page) {
  for (triangulation::TrianglePages::Mask m = known.asleep; m != 0; m &= m - 1) {
    float& e = page.error[std::countr_zero(m)];
    e = std::abs(e);
  }
  known.asleep = 0;
}

void blankDead(PageScreen& known, CandidatePage& page, triangulation::TrianglePages::Mask alive) {
  for (triangulation::TrianglePages::Mask m = ~alive & ~known.blank; m != 0; m &= m - 1) {
    const auto k = std::countr_zero(m);
    page.error[k] = 0;
    page.x[k] = page.z[k] = page.y[k] = kFarAway;
  }
  known.blank = ~alive;
}

// A candidate that is wanted but not worth a vertex until the camera has moved so many steps.
void fallAsleep(PageDue& due, PageScreen& known, CandidatePage& page, unsigned k, float until, const View& view) {
  if (known.asleep == 0) {
    known.sleptTravel = view.travel;
    known.sleepsFor = until;
    due.turn = view.turn + view.wakeTurn();
  }
  known.sleepsFor = std::min(known.sleepsFor, until);
  known.asleep |= triangulation::TrianglePages::Mask{1} << k;
  page.error[k] = -page.error[k];
}

struct Judgement {
  double
      priority;  // 0: not worth a vertex now, for nothing of the triangle is seen: it lies outside the wide frustum, is hidden, or a speck
  float until;   // steps: the way after which it is judged again
};

// Of a candidate that is wanted.
Judgement judge(const Triangulation& mesh, const View& view, TriangleId t, const Surface::Candidate& c) {
  const Vec3 at = view.relative(c.point.x, c.point.z, c.y);
  const double d2 = std::max(dot(at, at), 0.25), d = std::sqrt(d2);
  const std::array<Vec3, 3> corners = cornersOf(mesh, view, t);
  double extent2 = 0;
  for (const Vec3& corner : corners) {
    const Vec3 side{corner.x - at.x, corner.y - at.y, corner.z - at.z};
    extent2 = std::max(extent2, dot(side, side));
  }
  const double nearest = std::max(0.0, d - std::sqrt(extent2)) * lattice::kStepsPerMetre;  // the triangle's distance, or less
  const auto asleep = [&](double share) { return Judgement{0, static_cast<float>(share * nearest)}; };
  const Vec3 area = areaVector(corners);
  const double lift = c.error * lattice::kMetresPerStep / (view.area ? rootOfArea(area) : 1);
  if (!view.wide.contains(at) && !view.wide.meets(corners, lift)) return asleep(view.wakeMove());
  const double perMetre = view.pixelsPerRadian / d, squarePixels = std::abs(dot(area, at)) / d * 0.5 * perMetre * perMetre;
  const double flat = at.x * at.x + at.z * at.z, pixels = lift * view.pixelsPerRadian * std::sqrt(flat) / d2;
  if ((squarePixels < kSpeck && pixels < 1) || isHidden(view, corners, at, lift)) return asleep(kWakeHidden);
  if (view.area) return {c.error * view.gain * std::sqrt(flat / (d2 * d2 * d)), 0};
  // Larger triangles first at equal error: their error covers more of the picture.
  return {pixels * std::sqrt(std::sqrt(squarePixels)), 0};
}

}  // namespace

std::array<Vec3, 3> cornersOf(const Triangulation& mesh, const View& view, TriangleId t) {
  std::array<Vec3, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vertex& v = mesh.vertex(mesh.triangle(t).v[k]);
    corners[k] = view.relative(v.x, v.z, v.y);
  }
  return corners;
}

void screenPixels(const Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view, double threshold,
                  std::vector<Pending>& out) {
  RegionScreen& screen = surface.regions[region];
  const double spared = sparedSlope(view, threshold);
  const bool same = screen.spared == spared;
  if (same && view.travel < screen.due.travel && view.turn < screen.due.turn) return;
  screen.spared = spared;
  screen.due = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  const TrianglePages& pages = mesh.trianglePages();
  thread_local std::vector<std::uint32_t> due;  // pages
  thread_local std::vector<TriangleId> wanted;
  due.clear();
  wanted.clear();
  const auto& all = pages.pagesOf(region);
  for (std::size_t n = 0; n < all.size(); ++n) {
    if (n + kAhead < all.size()) __builtin_prefetch(&surface.dues[all[n + kAhead]]);
    PageDue& known = surface.dues[all[n]];
    if (!same) setDue(known, surface.screens[all[n]], spared, view);
    if (view.travel < known.travel && view.turn < known.turn) {
      join(screen.due, known);
    } else {
      due.push_back(all[n]);
      __builtin_prefetch(&surface.screens[all[n]], 1);
    }
  }
  const Eye eye{view.x, view.z, view.y, static_cast<float>(view.gain * view.gain), static_cast<float>(threshold * threshold)};
  const std::size_t before = out.size();
  for (std::size_t n = 0; n < due.size(); ++n) {
    if (n + 1 < due.size()) {
      const char* ahead = reinterpret_cast<const char*>(&surface.candidates[due[n + 1]]);
      for (std::size_t k = 0; k < sizeof(CandidatePage); k += 256) __builtin_prefetch(ahead + k);
    }
    PageScreen& known = surface.screens[due[n]];
    CandidatePage& page = surface.candidates[due[n]];
    const triangulation::TrianglePages::Mask alive = pages.aliveMask(due[n]);
    known.asleep &= alive;
    if (known.asleep != 0 && (wakes(known, view) || view.turn >= surface.dues[due[n]].turn)) wake(known, page);
    blankDead(known, page, alive);
    const PageLook seen = view.area ? screenPageByArea(page, eye) : screenPageInPixels(page, eye);
    known.travel = view.travel;
    known.steepest = std::sqrt(seen.steepest2);
    known.seen = std::sqrt(seen.seen2);
    known.nearest = std::sqrt(seen.nearest2);
    for (triangulation::TrianglePages::Mask m = seen.wanted; m != 0; m &= m - 1) {
      const auto k = static_cast<unsigned>(std::countr_zero(m));
      wanted.push_back(due[n] * TrianglePages::kSlots + k);
      mesh.prefetch(wanted.back());
    }
  }
  // The triangles lie anywhere in memory: they are asked for well before they are judged.
  for (std::size_t n = 0; n < wanted.size() + kAhead; ++n) {
    if (n < wanted.size()) mesh.prefetchCorners(wanted[n]);
    if (n < kAhead) continue;
    const TriangleId t = wanted[n - kAhead];
    const Surface::Candidate c = surface.candidate(t);
    const auto [priority, until] = judge(mesh, view, t, c);
    if (priority > 0) {
      out.push_back({t, c.point, static_cast<float>(priority)});
    } else {
      const std::uint32_t page = t / TrianglePages::kSlots;
      fallAsleep(surface.dues[page], surface.screens[page], surface.candidates[page], t % TrianglePages::kSlots, until, view);
    }
  }
  for (std::uint32_t page : due) {
    setDue(surface.dues[page], surface.screens[page], spared, view);
    join(screen.due, surface.dues[page]);
  }
  std::sort(out.begin() + static_cast<std::ptrdiff_t>(before), out.end());
}

void screenThesis(const Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view, double threshold,
                  std::vector<Pending>& out) {
  constexpr double kWholePicture = 256;  // (4 x area)^2, as below
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
    const Surface::Candidate candidate = surface.candidate(t);
    if (mesh.trianglePages().fresh(t) || candidate.error <= 0) return;
    const std::array<Vec3, 3> corners = cornersOf(mesh, view, t);
    if (!view.wide.meets(corners, candidate.error * lattice::kMetresPerStep)) return;
    const std::array<Screen, 3> corner{project(corners[0]), project(corners[1]), project(corners[2])};
    double area = kWholePicture;
    if (corner[0].ahead && corner[1].ahead && corner[2].ahead) {
      const double a = distance(corner[0], corner[1]), b = distance(corner[1], corner[2]), c = distance(corner[2], corner[0]);
      area = std::max(0.0, (a + b + c) * (-a + b + c) * (a - b + c) * (a + b - c));  // Heron, without the root
    }
    const triangulation::Point2 p = candidate.point;
    const Screen on = project(view.relative(p.x, p.z, heightOnTriangle(mesh, t, p))),
                 lifted = project(view.relative(p.x, p.z, candidate.y));
    if (!on.ahead || !lifted.ahead) return;
    const double value = std::pow(area, kThesisArea) * kThesisDistance * distance(on, lifted);
    if (value >= threshold) out.push_back({t, p, static_cast<float>(value)});
  });
  std::sort(out.begin() + static_cast<std::ptrdiff_t>(before), out.end());
}

}  // namespace ridgecast::refinement
