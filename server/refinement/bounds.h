#pragma once
// Which pages an iteration need not check.
//
// An error as seen depends on where the camera is, which changes little from one iteration to the next. Whenever a page of 64 candidates is
// checked, its *bounds* are kept: the largest errors, as seen, of the candidates that were not wanted, and the smallest distance. They say
// how far the camera may travel before any of the page's candidates can reach the threshold: the page's *next check*. Until then the page
// is *skipped*. A region's next check is the earliest of its pages', so most regions cost one line of memory an iteration.
//
//     error as seen                            _,-   the bound: no candidate of the page is above it
//     threshold |.........................._,-'....
//               |                    __,--'
//               |        ___,,,---'''  |
//               |---''''     x         |             x: a candidate that is really there
//               +----------------------+---------->  way of the camera
//             check               next check
//
// A candidate at or above the threshold is *wanted*. When nothing of its triangle is seen (it lies outside the wide frustum, other ground
// hides all of it, or it is a speck on the screen) a vertex would be wasted: the candidate is *dormant*, its error is stored negative, and
// checks pass over it. It wakes when the camera has moved or turned far enough for that to change; the wide frustum leaves room for it.
// When the camera comes to rest, those that became dormant on the way are judged again, so that what is said of a mesh at rest is exact.
//
//     new triangle --> below the threshold --> wanted --> inserted, or postponed: wanted again next time
//                                               ^  |
//                   moved, turned or come to rest  nothing of the triangle is seen
//                                               |  v
//                                              dormant
//
// The bounds. Moving by m changes a distance d and a horizontal distance f by at most m, so no candidate can reach the threshold while
// either
//     error / (d - m)^p                   <=  steepest (nearest / (nearest - m))^p                                   or
//     error (f + m) / (d - m)^(p + 1)     <=  (seen + steepest m / nearest) (nearest / (nearest - m))^(p + 1)
// times the view's gain is below it; p is Measure::power(). The way travelled since the check bounds m. New candidates are folded into the
// bounds of their page. For losses (loss_store.h) the same holds with the limit below: none of a page's other vertices can come below it
// while
//     leastSlope (1 - m / flat) / (1 + m / nearest)^(p + 1)  >  limit / gain,
// for which leastSlope (1 - m (1 / flat + (p + 1) / nearest)) is enough.

#include <cmath>

#include "server/refinement/records.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

struct Place {  // steps, y absolute
  std::int32_t x, z, y;
};
// A vertical error at a point as seen, in the metric's unit (records.h). For kArea, `error` includes the triangle's weight. Steps.
double seenError(const Place& at, float error, const View& view);

// While the camera moves a page is checked only when the threshold may be passed by this factor.
inline constexpr double kSlack = 1.1;

// The largest error / distance^p that is skipped.
inline double skippedSlope(const View& view, double threshold) { return (view.moving ? kSlack * threshold : threshold) / view.gain; }

// Whether the camera has moved so far that a page's dormant candidates are judged again.
inline bool wakes(const PageScreen& page, const View& view) {
  return page.travel < 0 || view.travel - page.dormantSince > (view.moving ? page.dormantFor : 0);
}

inline void setNextCheck(NextCheck& next, const PageScreen& page, double skipped, const View& view) {
  const double power = view.measure.power();
  // (1 - x)^p >= 1 - p x
  const double level = page.nearest * (1 - page.steepest / skipped) / power,
               steep = page.nearest * (skipped - page.seen) / (page.steepest + (power + 1) * skipped);
  next.travel = page.travel < 0 ? kAlways : page.travel + std::max(level, steep);
  if (page.dormant == 0)
    next.turn = std::numeric_limits<double>::infinity();
  else if (wakes(page, view))
    next.travel = kAlways;
  else if (view.moving)
    next.travel = std::min(next.travel, page.dormantSince + page.dormantFor);
}
// Pages prefetched ahead of the current one.
inline constexpr std::size_t kPagesAhead = 2;

inline void join(NextCheck& earliest, const NextCheck& next) {
  earliest.travel = std::min(earliest.travel, next.travel);
  earliest.turn = std::min(earliest.turn, next.turn);
}

}  // namespace ridgecast::refinement
