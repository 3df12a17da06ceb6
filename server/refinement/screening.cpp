// Which candidates are worth a vertex for this camera: a straight pass over the pages that bounds.h does not skip. The metrics' definitions
// are in metric.h.
//
// All metrics leave out what is not seen: where neither the triangle nor the ground over it, as far from it as its candidate is, meets the
// wide frustum. (To ask where the candidate lies is not enough: a triangle under the camera may have its candidate behind the camera and
// still fill the picture.)
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "common/outcome/contract.h"
#include "server/refinement/adaptive_mesh.h"
#include "server/refinement/bounds.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using camera::Vec3;
using triangulation::TrianglePages;

namespace {

// Triangles smaller than this on the screen are left alone, unless they hide an error of a pixel: one seen edge-on may.
constexpr double kSpeck = 0.25;  // square pixels
// Dormant candidates that are hidden or specks wake when the camera has moved this share of the distance to their triangle.
constexpr double kWakeHidden = 0.15;
constexpr double kThesisArea = 0.5, kThesisDistance = 40;
// So many triangles, and pages' bounds, are fetched ahead of the one at hand.
constexpr std::size_t kChecksAhead = 8;

double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Twice the area vector of a triangle.
Vec3 areaVector(const std::array<Vec3, 3>& corners) {
  const auto& [a, b, c] = corners;
  const Vec3 u{b.x - a.x, b.y - a.y, b.z - a.z}, w{c.x - a.x, c.y - a.y, c.z - a.z};
  return {u.y * w.z - u.z * w.y, u.z * w.x - u.x * w.z, u.x * w.y - u.y * w.x};
}

// Of a triangle with twice this area vector, metres.
double weightOf(const Measure& measure, const Vec3& area) {
  return measure.weight(0.5 * std::sqrt(dot(area, area)) * lattice::kStepsPerMetre * lattice::kStepsPerMetre);
}

// Whether a triangle and its candidate `at`, on the terrain as on the mesh, cannot be seen behind other ground. `error`: at least a bound
// of the distance between the two. All in metres from the eye.
bool isHidden(const View& view, const std::array<Vec3, 3>& corners, const Vec3& at, double error) {
  return view.hides({at.x, at.y + error, at.z}) &&
         std::all_of(corners.begin(), corners.end(), [&](const Vec3& corner) { return view.hides(corner); });
}

// A candidate that is wanted but not worth a vertex until the camera has moved so many steps.
void makeDormant(NextCheck& next, PageScreen& known, unsigned index, float& error, float until, const View& view) {
  if (known.dormant == 0) {
    known.dormantSince = view.travel;
    known.dormantFor = until;
    next.turn = view.turn + view.wakeTurn();
  }
  known.dormantFor = std::min(known.dormantFor, until);
  known.dormant |= PageScreen::Mask{1} << index;
  error = -error;
}

struct Judgement {
  double priority;  // 0: not worth a vertex now
  float until;      // steps: the way after which a dormant candidate is judged again
};

// Of a candidate that is wanted.
Judgement judge(const triangulation::Triangulation& mesh, const View& view, triangulation::TriangleId t, const Candidate& c) {
  const Vec3 at = view.relative(c.point.x, c.point.z, c.y);
  const double d2 = std::max(dot(at, at), 0.25), d = std::sqrt(d2);
  const std::array<Vec3, 3> corners = cornersOf(mesh, view, t);
  double extent2 = 0;
  for (const Vec3& corner : corners) {
    const Vec3 side{corner.x - at.x, corner.y - at.y, corner.z - at.z};
    extent2 = std::max(extent2, dot(side, side));
  }
  const double nearest = std::max(0.0, d - std::sqrt(extent2)) * lattice::kStepsPerMetre;  // the triangle's distance, or less
  const auto dormant = [&](double share) { return Judgement{0, static_cast<float>(share * nearest)}; };
  const Vec3 area = areaVector(corners);
  const double lift = c.error * lattice::kMetresPerStep / weightOf(view.measure, area);
  if (!view.wide.contains(at) && !view.wide.meets(corners, lift)) return dormant(view.wakeMove());
  const double perMetre = view.pixelsPerRadian / d, squarePixels = std::abs(dot(area, at)) / d * 0.5 * perMetre * perMetre;
  const double flat = at.x * at.x + at.z * at.z, pixels = lift * view.pixelsPerRadian * std::sqrt(flat) / d2;
  if ((squarePixels < kSpeck && pixels < 1) || isHidden(view, corners, at, lift)) return dormant(kWakeHidden);
  if (view.measure.byArea) return {c.error * view.gain * std::sqrt(flat / (d2 * d2 * d)), 0};
  // Larger triangles first at equal error: their error covers more of the picture.
  return {pixels * std::sqrt(std::sqrt(squarePixels)), 0};
}

}  // namespace

std::uint32_t AdaptiveMesh::findWork(std::span<const Search> searches, const View& view, double threshold) {
  expects(searches.size() <= 32, "a search has its bit");
  struct Due {  // pages
    PageList candidates, losses;
  };
  thread_local std::vector<Due> due;
  if (due.size() < searches.size()) due.resize(searches.size());
  const bool isThesis = metric_ == Metric::kThesis;
  for (std::size_t k = 0; k < searches.size(); ++k) {
    const auto& [region, isSeen, removalLimit, work] = searches[k];
    due[k].candidates.clear();
    due[k].losses.clear();
    if (isSeen && !isThesis) collectDue(region, view, skippedSlope(view, threshold), due[k].candidates);
    collectDueLosses(region, view, removalLimit, due[k].losses);
  }
  const auto first = [](const PageList& pages) { return std::span(pages).first(std::min(kPagesAhead, pages.size())); };
  for (std::size_t k = 0; k < searches.size(); ++k) {
    for (std::uint32_t page : first(due[k].candidates)) prefetchCandidates(page);
    for (std::uint32_t page : first(due[k].losses)) prefetchVertices(page);
  }
  std::uint32_t found = 0;
  for (std::size_t k = 0; k < searches.size(); ++k) {
    const auto& [region, isSeen, removalLimit, work] = searches[k];
    const bool screens = isSeen && isThesis, checks = !due[k].candidates.empty(), judges = !due[k].losses.empty();
    if (!screens && !checks && !judges) continue;
    if (screens) screenThesis(region, view, threshold, work->pending);
    if (checks) screenPixels(region, due[k].candidates, view, threshold, work->pending);
    if (judges) {
      work->removalLimit = removalLimit;
      findRemovable(region, due[k].losses, view, *work);
    }
    if (!work->isEmpty()) found |= 1u << k;
  }
  return found;
}

double AdaptiveMesh::postpone(const Pending& wanted, RegionId region, const View& view, bool pageAnew) {
  const Candidate c = candidate(wanted.triangle);
  if (pageAnew) {
    wakeCandidate(wanted.triangle, region);
  } else {
    const std::uint32_t page = mesh_.trianglePages().pageOf(wanted.triangle);
    foldCandidate(checks_[page], screens_[page], regions_[region], c, view);
  }
  return seenError({c.point.x, c.point.z, c.y}, c.error, view);
}

inline void AdaptiveMesh::prefetchCandidates(std::uint32_t page) const {
  for (const Candidates* block : candidatesOf(page))
    for (std::uint32_t k = 0; block && k < TrianglePages::kBlock / Candidates::kSlots; ++k) __builtin_prefetch(block + k);
}

void AdaptiveMesh::screenPixels(RegionId region, const PageList& due, const View& view, double threshold, std::vector<Pending>& out) {
  thread_local std::vector<TriangleId> wanted;
  wanted.clear();
  for (std::size_t n = 0; n < due.size(); ++n) {
    if (n + kPagesAhead < due.size()) prefetchCandidates(due[n + kPagesAhead]);
    checkPage(due[n], view, threshold, wanted);
  }
  judgeWanted(wanted, view, out);
  RegionState& state = regions_[region];
  for (std::uint32_t page : due) {
    setNextCheck(checks_[page], screens_[page], state.skipped, view);
    join(state.nextCheck, checks_[page]);
  }
  std::sort(out.begin(), out.end());
}

// Which of the region's pages to check now. The region's next check becomes the earliest of the others'.
void AdaptiveMesh::collectDue(RegionId region, const View& view, double skipped, PageList& due) {
  RegionState& state = regions_[region];
  const bool same = state.skipped == skipped;
  if (same && view.travel < state.nextCheck.travel && view.turn < state.nextCheck.turn) return;
  state.skipped = skipped;
  state.nextCheck = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  const auto& all = mesh_.trianglePages().pagesOf(region);
  for (std::size_t n = 0; n < all.size(); ++n) {
    if (n + kChecksAhead < all.size()) __builtin_prefetch(&checks_[all[n + kChecksAhead]]);
    NextCheck& next = checks_[all[n]];
    if (!same) setNextCheck(next, screens_[all[n]], skipped, view);
    if (view.travel < next.travel && view.turn < next.turn) {
      join(state.nextCheck, next);
    } else {
      due.push_back(all[n]);
      mesh_.trianglePages().prefetch(all[n]);
      __builtin_prefetch(&screens_[all[n]], 1);
    }
  }
}

// The page's dormant candidates are candidates again.
void AdaptiveMesh::wakeDormant(std::uint32_t page) {
  mesh_.trianglePages().forEachIn(page, screens_[page].dormant, [&](TriangleId t) { errorOf(t) = std::abs(errorOf(t)); });
  screens_[page].dormant = 0;
}

inline void AdaptiveMesh::blankDead(std::uint32_t page, Mask alive) {
  const Mask dead = mesh_.trianglePages().slotsOf(page) & ~alive;
  mesh_.trianglePages().forEachIn(page, dead & ~screens_[page].blank, [&](TriangleId t) {
    Candidates& four = candidates_[t / Candidates::kSlots];
    const std::uint32_t k = t % Candidates::kSlots;
    four.error[k] = 0;
    four.x[k] = four.z[k] = four.y[k] = kFarAway;
  });
  screens_[page].blank = dead;
}

// Appends the page's wanted candidates, and keeps the bounds of the others.
void AdaptiveMesh::checkPage(std::uint32_t number, const View& view, double threshold, std::vector<TriangleId>& wanted) {
  PageScreen& known = screens_[number];
  const Mask alive = mesh_.trianglePages().aliveMask(number);
  known.dormant &= alive;
  if (known.dormant != 0 && (wakes(known, view) || view.turn >= checks_[number].turn)) wakeDormant(number);
  blankDead(number, alive);
  const Eye eye{view.x, view.z, view.y, static_cast<float>(view.gain * view.gain), static_cast<float>(threshold * threshold)};
  const PageLook seen = lookThrough(view.measure, candidatesOf(number), eye);
  known.travel = view.travel;
  known.steepest = std::sqrt(seen.steepest2);
  known.seen = std::sqrt(seen.seen2);
  known.nearest = std::sqrt(seen.nearest2);
  mesh_.trianglePages().forEachIn(number, seen.wanted, [&](TriangleId t) {
    wanted.push_back(t);
    mesh_.prefetch(t);
  });
}

// Appends those that are worth a vertex; the others become dormant.
void AdaptiveMesh::judgeWanted(const std::vector<TriangleId>& wanted, const View& view, std::vector<Pending>& out) {
  // The triangles lie anywhere in memory: they are fetched well before they are judged.
  for (std::size_t n = 0; n < wanted.size() + kChecksAhead; ++n) {
    if (n < wanted.size()) mesh_.prefetchCorners(wanted[n]);
    if (n < kChecksAhead) continue;
    const TriangleId t = wanted[n - kChecksAhead];
    const Candidate c = candidate(t);
    const auto [priority, until] = judge(mesh_, view, t, c);
    if (priority > 0) {
      out.push_back({t, c.point, static_cast<float>(priority)});
    } else {
      const std::uint32_t page = mesh_.trianglePages().pageOf(t);
      makeDormant(checks_[page], screens_[page], mesh_.trianglePages().indexOf(t), errorOf(t), until, view);
    }
  }
}

void AdaptiveMesh::screenThesis(RegionId region, const View& view, double threshold, std::vector<Pending>& out) const {
  constexpr double kWholePicture = 256;  // (4 x area)^2, as below
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
  mesh_.trianglePages().forEach(region, [&](TriangleId t) {
    const Candidate c = candidate(t);
    if (mesh_.trianglePages().fresh(t) || c.error <= 0) return;
    const std::array<Vec3, 3> corners = cornersOf(mesh_, view, t);
    if (!view.wide.meets(corners, c.error * lattice::kMetresPerStep)) return;
    const std::array<Screen, 3> corner{project(corners[0]), project(corners[1]), project(corners[2])};
    double area = kWholePicture;
    if (corner[0].ahead && corner[1].ahead && corner[2].ahead) {
      const double u = distance(corner[0], corner[1]), v = distance(corner[1], corner[2]), w = distance(corner[2], corner[0]);
      area = std::max(0.0, (u + v + w) * (-u + v + w) * (u - v + w) * (u + v - w));  // Heron, without the root
    }
    const triangulation::Point2 p = c.point;
    const Screen on = project(view.relative(p.x, p.z, heightOnTriangle(mesh_, t, p))), lifted = project(view.relative(p.x, p.z, c.y));
    if (!on.ahead || !lifted.ahead) return;
    const double value = std::pow(area, kThesisArea) * kThesisDistance * distance(on, lifted);
    if (value >= threshold) out.push_back({t, p, static_cast<float>(value)});
  });
  std::sort(out.begin(), out.end());
}

}  // namespace ridgecast::refinement
