// Which candidates are worth a vertex for this camera: a straight pass over the pages that bounds.h does not skip. The metrics' definitions
// are in metric.h.
//
// All metrics leave out what is not seen: where neither the triangle nor the ground over it, as far from it as its candidate is, meets the
// wide frustum. (To ask where the candidate lies is not enough: a triangle under the camera may have its candidate behind the camera and
// still fill the picture.)
#include "server/refinement/candidate_store.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/outcome/contract.h"
#include "server/refinement/bounds.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using camera::Vec3;
using triangulation::Move;
using triangulation::RegionId;
using triangulation::TriangleId;
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

CandidateStore::CandidateStore(const triangulation::Triangulation& mesh)
    : mesh_(mesh),
      pages_(mesh.trianglePages()),
      candidates_(mesh.triangleCapacity() / Candidates::kSlots),
      checks_(mesh.triangleCapacity() / TrianglePages::kSlots),
      screens_(mesh.triangleCapacity() / TrianglePages::kSlots),
      hashes_(mesh.triangleCapacity()) {}

std::size_t CandidateStore::memoryBytes() const {
  return pages_.pagesInUse() * (sizeof(NextCheck) + sizeof(PageScreen)) +
         std::size_t{pages_.blocksInUse()} * TrianglePages::kBlock * (sizeof(Candidates) / Candidates::kSlots + sizeof(std::uint64_t));
}

// Which pages a region gets depends on threads, and what is done next may not.
void CandidateStore::begin(std::uint32_t page, double travel) {
  constexpr double never = std::numeric_limits<double>::infinity();
  checks_[page] = {never, never};
  screens_[page] = {travel, 0, 0, std::numeric_limits<float>::max(), 0, 0, 0, 0, 0, 0};
}

void CandidateStore::fold(TriangleId t, const Candidate& c, RegionState& state, const View& view) {
  PageScreen& page = screens_[pages_.pageOf(t)];
  NextCheck& next = checks_[pages_.pageOf(t)];
  if (page.travel >= 0) {
    const auto moved = static_cast<float>(view.travel - page.travel);
    if (2 * moved >= page.nearest) {
      page.travel = -1;
    } else {
      if (moved > 0) {  // the bounds as they are after that way
        const float closer = page.nearest / (page.nearest - moved);
        const float faster = view.measure.reach(closer);
        page.seen = (page.seen + page.steepest * moved / page.nearest) * faster * closer;
        page.steepest *= faster;
        page.nearest -= moved;
        page.travel = view.travel;
      }
      const float dx = static_cast<float>(c.point.x - view.x), dz = static_cast<float>(c.point.z - view.z),
                  dy = static_cast<float>(c.y) - view.y;
      const float flat = dx * dx + dz * dz, d = std::max(std::sqrt(flat + dy * dy), kNearest), steep = c.error / view.measure.reach(d);
      page.steepest = std::max(page.steepest, steep);
      page.seen = std::max(page.seen, steep * std::sqrt(flat) / d);
      page.nearest = std::min(page.nearest, d);
    }
    setNextCheck(next, page, state.skipped, view);
  }
  join(state.nextCheck, next);
}

void CandidateStore::move(std::span<const Move> moves, RegionState& state) {
  expects(pages_.regionOf(moves.front().to) == pages_.regionOf(moves.back().to), "what moves goes to one region");
  forEachPage(pages_, moves, [&](std::uint32_t number, std::span<const Move> run) {
    Mask slots = 0;
    for (const Move& move : run) slots |= Mask{1} << pages_.indexOf(move.to);
    const Mask evaluated = pages_.aliveMask(number) & ~pages_.freshMask(number);
    if ((evaluated & ~slots) == 0) begin(number, -1);  // new ones beside them have not been looked at
    for (const auto& [from, to] : run) {
      Candidate c = at(from);
      c.error = std::abs(c.error);  // a candidate that moves is not dormant
      put(to, c, hashes_[from]);
    }
    wake(run.front().to, state);
  });
}

void CandidateStore::translate(std::int32_t dx, std::int32_t dz) {
  for (RegionId region = 0; region < pages_.regionLimit(); ++region)
    if (pages_.hasRegion(region))
      pages_.forEach(region, [&](TriangleId t) {
        if (pages_.fresh(t)) return;  // it has no candidate yet
        Candidates& four = candidates_[t / Candidates::kSlots];
        four.x[t % Candidates::kSlots] += dx;
        four.z[t % Candidates::kSlots] += dz;
      });
}

// The sum over the region's triangles, of which only what changed is summed again.
std::uint64_t CandidateStore::hash(RegionId region) {
  std::uint64_t sum = 0;
  for (std::uint32_t number : pages_.pagesOf(region)) {
    PageScreen& page = screens_[number];
    const Mask alive = pages_.aliveMask(number);
    if (alive == 0) begin(number, page.travel);  // opened, and not used yet: what is there is another region's
    pages_.forEachIn(number, page.hashed & ~alive, [&](TriangleId t) { page.hash -= hashes_[t]; });
    page.hashed &= alive;
    sum += page.hash;
  }
  return sum;
}

void CandidateStore::prefetchPage(std::uint32_t page) const {
  for (const Candidates* block : blocks(page))
    for (std::uint32_t k = 0; block && k < TrianglePages::kBlock / Candidates::kSlots; ++k) __builtin_prefetch(block + k);
}

void CandidateStore::findWanted(const PageList& due, RegionState& state, const View& view, double threshold, std::vector<Pending>& out) {
  thread_local std::vector<TriangleId> wanted;
  wanted.clear();
  for (std::size_t n = 0; n < due.size(); ++n) {
    if (n + kPagesAhead < due.size()) prefetchPage(due[n + kPagesAhead]);
    checkPage(due[n], view, threshold, wanted);
  }
  judgeWanted(wanted, view, out);
  for (std::uint32_t page : due) {
    setNextCheck(checks_[page], screens_[page], state.skipped, view);
    join(state.nextCheck, checks_[page]);
  }
  std::sort(out.begin(), out.end());
}

void CandidateStore::collectDue(RegionId region, RegionState& state, const View& view, double skipped, PageList& due) {
  const bool same = state.skipped == skipped;
  if (same && view.travel < state.nextCheck.travel && view.turn < state.nextCheck.turn) return;
  state.skipped = skipped;
  state.nextCheck = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  const auto& all = pages_.pagesOf(region);
  for (std::size_t n = 0; n < all.size(); ++n) {
    if (n + kChecksAhead < all.size()) __builtin_prefetch(&checks_[all[n + kChecksAhead]]);
    NextCheck& next = checks_[all[n]];
    if (!same) setNextCheck(next, screens_[all[n]], skipped, view);
    if (view.travel < next.travel && view.turn < next.turn) {
      join(state.nextCheck, next);
    } else {
      due.push_back(all[n]);
      pages_.prefetch(all[n]);
      __builtin_prefetch(&screens_[all[n]], 1);
    }
  }
}

// The page's dormant candidates are candidates again.
void CandidateStore::wakeDormant(std::uint32_t page) {
  pages_.forEachIn(page, screens_[page].dormant, [&](TriangleId t) { errorOf(t) = std::abs(errorOf(t)); });
  screens_[page].dormant = 0;
}

inline void CandidateStore::blankDead(std::uint32_t page, Mask alive) {
  const Mask dead = pages_.slotsOf(page) & ~alive;
  pages_.forEachIn(page, dead & ~screens_[page].blank, [&](TriangleId t) {
    Candidates& four = candidates_[t / Candidates::kSlots];
    const std::uint32_t k = t % Candidates::kSlots;
    four.error[k] = 0;
    four.x[k] = four.z[k] = four.y[k] = kFarAway;
  });
  screens_[page].blank = dead;
}

// Appends the page's wanted candidates, and keeps the bounds of the others.
void CandidateStore::checkPage(std::uint32_t number, const View& view, double threshold, std::vector<TriangleId>& wanted) {
  PageScreen& known = screens_[number];
  const Mask alive = pages_.aliveMask(number);
  known.dormant &= alive;
  if (known.dormant != 0 && (wakes(known, view) || view.turn >= checks_[number].turn)) wakeDormant(number);
  blankDead(number, alive);
  const Eye eye{view.x, view.z, view.y, static_cast<float>(view.gain * view.gain), static_cast<float>(threshold * threshold)};
  const PageLook seen = lookThrough(view.measure, blocks(number), eye);
  known.travel = view.travel;
  known.steepest = std::sqrt(seen.steepest2);
  known.seen = std::sqrt(seen.seen2);
  known.nearest = std::sqrt(seen.nearest2);
  pages_.forEachIn(number, seen.wanted, [&](TriangleId t) {
    wanted.push_back(t);
    mesh_.prefetch(t);
  });
}

// Appends those that are worth a vertex; the others become dormant.
void CandidateStore::judgeWanted(const std::vector<TriangleId>& wanted, const View& view, std::vector<Pending>& out) {
  // The triangles lie anywhere in memory: they are fetched well before they are judged.
  for (std::size_t n = 0; n < wanted.size() + kChecksAhead; ++n) {
    if (n < wanted.size()) mesh_.prefetchCorners(wanted[n]);
    if (n < kChecksAhead) continue;
    const TriangleId t = wanted[n - kChecksAhead];
    const Candidate c = at(t);
    const auto [priority, until] = judge(mesh_, view, t, c);
    if (priority > 0) {
      out.push_back({t, c.point, static_cast<float>(priority)});
    } else {
      const std::uint32_t page = pages_.pageOf(t);
      makeDormant(checks_[page], screens_[page], pages_.indexOf(t), errorOf(t), until, view);
    }
  }
}

void CandidateStore::findByThesis(RegionId region, const View& view, double threshold, std::vector<Pending>& out) const {
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
  pages_.forEach(region, [&](TriangleId t) {
    const Candidate c = at(t);
    if (pages_.fresh(t) || c.error <= 0) return;
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
