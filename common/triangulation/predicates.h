#pragma once
// Exact orientation and in-circle tests on integer coordinates, and the tie rule that makes the Delaunay triangulation unique.
//
// Coordinates are steps relative to an anchor, |x|, |z| < 2^26, so that differences have 27 bits: orientation is exact in 64-bit integers;
// in-circle is filtered in doubles with 128-bit integers behind. Orientation is positive when a, b, c run counter-clockwise seen from above
// (+X right, +Z towards the viewer).
//
// Ties: of four cocircular points the smallest (by x, then z) is lifted infinitesimally less than the others, so the diagonal that
// holds it is kept. Symbolic perturbation of the lifting map (Edelsbrunner and Muecke 1990, Devillers and Teillaud 2011).

#include <cmath>
#include <cstdint>

namespace ridgecast::triangulation {

struct Point2 {
  std::int32_t x = 0;
  std::int32_t z = 0;
};
inline bool operator==(const Point2& a, const Point2& b) { return a.x == b.x && a.z == b.z; }
inline bool smaller(const Point2& a, const Point2& b) { return a.x < b.x || (a.x == b.x && a.z < b.z); }

// Twice the signed area: > 0 counter-clockwise, 0 collinear.
inline std::int64_t orientation(const Point2& a, const Point2& b, const Point2& c) {
  return (std::int64_t{b.z} - a.z) * (std::int64_t{c.x} - a.x) - (std::int64_t{b.x} - a.x) * (std::int64_t{c.z} - a.z);
}

// Whether the closed triangle a, b, c (counter-clockwise) holds p.
inline bool holds(const Point2& a, const Point2& b, const Point2& c, const Point2& p) {
  return orientation(a, b, p) >= 0 && orientation(b, c, p) >= 0 && orientation(c, a, p) >= 0;
}

// Sign of the in-circle determinant by 128-bit integers.
int inCircleExact(const Point2& a, const Point2& b, const Point2& c, const Point2& d);

// The tie rule for cocircular a, b, c (counter-clockwise) and d.
inline bool insideWhenCocircular(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  const Point2* m = &a;
  if (smaller(b, *m)) m = &b;
  if (smaller(c, *m)) m = &c;
  if (smaller(d, *m)) return true;
  if (m == &a) return orientation(b, c, d) < 0;
  if (m == &b) return orientation(c, a, d) < 0;
  return orientation(a, b, d) < 0;
}

// Whether d lies inside the circle through a, b, c (counter-clockwise), ties settled; never ambiguous for distinct points.
//
// The determinant as a 2 x 2 one of cross and dot products (as in CGAL's side_of_oriented_circle). While differences are below 2^25 the
// products are exact in doubles, so only the last two multiplications and the subtraction round: three roundings of at most 2^-53 of
// |AD| + |BC|. Larger differences, which a terrain's triangles do not have, go straight to integers.
inline bool inCircle(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  const std::int32_t bp = b.z - a.z, bq = b.x - a.x, cp = c.z - a.z, cq = c.x - a.x, dp = d.z - a.z, dq = d.x - a.x;
  constexpr std::int32_t kWide = 1 << 25;
  const auto wide = [](std::int32_t v) { return int{static_cast<std::uint32_t>(v + kWide) >= 2u * kWide}; };
  if (!(wide(bp) | wide(bq) | wide(cp) | wide(cq) | wide(dp) | wide(dq))) {
    const double bpd = bp, bqd = bq, cpd = cp, cqd = cq, dpd = dp, dqd = dq;
    const double A = bpd * dqd - bqd * dpd, B = dpd * (dpd - bpd) + dqd * (dqd - bqd);
    const double C = bpd * cqd - bqd * cpd, D = cpd * (cpd - bpd) + cqd * (cqd - bqd);
    const double AD = A * D, BC = B * C, det = AD - BC, bound = 3.4e-16 * (std::abs(AD) + std::abs(BC));
    if (det > bound) return true;
    if (det < -bound) return false;
  }
  const int exact = inCircleExact(a, b, c, d);
  return exact != 0 ? exact > 0 : insideWhenCocircular(a, b, c, d);
}

// Whether d lies strictly between a and b, given that the three are collinear.
inline bool strictlyBetween(const Point2& a, const Point2& b, const Point2& d) {
  const Point2 &low = smaller(a, b) ? a : b, &high = smaller(a, b) ? b : a;
  return smaller(low, d) && smaller(d, high);
}

}  // namespace ridgecast::triangulation
