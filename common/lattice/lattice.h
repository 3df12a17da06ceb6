#pragma once
// The integer lattice on which everything is stored, triangulated and sent.
//
// Unit    a *step* is 2^-8 m (3.90625 mm), horizontally and vertically.
// Axes    glTF's: right-handed, +X right, +Y up, +Z towards the viewer; metres outside, steps inside. Triangles are
//         counter-clockwise seen from above (from +Y): orientation(a, b, c) > 0.
// Angles  radians inside, degrees in files, flags and URLs. Yaw 0 looks along -Z, positive yaw turns left (counter-clockwise
//         seen from above), positive pitch looks up.
// Range   horizontal positions within +-2^50 steps (4.4e12 m); heights within +-2^25 steps (131 km).
//   Leaves  squares of the quadtree, (level, i, j). Level 0 is 32 m, the finest; a *higher level is coarser* (web maps count the other
//           way). Squares are half-open: least x and z belong to them.
// All functions are pure and total over these ranges. Callers check untrusted input with positionIsValid / addressIsValid first.

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace ridgecast::lattice {

using Step = std::int64_t;

inline constexpr int kStepBits = 8;  // steps a metre, as a power of two
inline constexpr double kStepsPerMetre = 256.0;
inline constexpr double kMetresPerStep = 1.0 / 256.0;
constexpr double metres(Step steps) { return static_cast<double>(steps) * kMetresPerStep; }
inline constexpr int kFinestSideBits = 13;  // a level 0 leaf is 2^13 steps = 32 m wide
inline constexpr int kMaxLevel = 10;        // 32,768 m; coarser leaves do not exist
inline constexpr int kCellBits = 20;        // terrain functions see cells of 2^20 steps = 4,096 m
inline constexpr Step kMaxPosition = Step{1} << 50;
inline constexpr std::int32_t kMaxHeight = std::int32_t{1} << 25;

// A point of the horizontal plane, in steps.
struct Point {
  Step x = 0;
  Step z = 0;
  friend constexpr auto operator<=>(const Point&, const Point&) = default;  // by x, then z: the order that settles every tie
};

// A vertex of a mesh in the world, in steps.
struct Vertex {
  Step x = 0;
  Step z = 0;
  std::int32_t y = 0;
  friend constexpr auto operator<=>(const Vertex&, const Vertex&) = default;
};

// A rectangle of the horizontal plane, half-open, in steps.
struct Area {
  Step x0 = 0, z0 = 0, x1 = 0, z1 = 0;
  constexpr bool holds(Point p) const { return p.x >= x0 && p.x < x1 && p.z >= z0 && p.z < z1; }
  constexpr bool meets(const Area& o) const { return x0 < o.x1 && o.x0 < x1 && z0 < o.z1 && o.z0 < z1; }
  friend constexpr bool operator==(const Area&, const Area&) = default;
};

// A place that may become a vertex.
struct Candidate {
  Vertex at;         // on the true terrain
  float pixels = 0;  // between it and the mesh, on the screen, looked at straight on
  friend bool operator==(const Candidate&, const Candidate&) = default;
};

constexpr bool positionIsValid(Step x, Step z) {
  return x >= -kMaxPosition && x <= kMaxPosition && z >= -kMaxPosition && z <= kMaxPosition;
}

// Greatest multiple of 2^bits that is not greater than v.
constexpr Step floorTo(Step v, int bits) { return (v >> bits) << bits; }
// Nearest multiple of 2^bits, halves upwards.
constexpr Step roundTo(Step v, int bits) { return bits == 0 ? v : floorTo(v + (Step{1} << (bits - 1)), bits); }

// The spacing of a leaf's vertices at this level, as a power of two in steps: exact at level 0, coarser far away, where it is invisible and
// every bit costs bandwidth.
constexpr int horizontalBits(int level) { return level == 0 ? 0 : level + 4; }
constexpr int verticalBits(int level) { return level == 0 ? 0 : level + 3; }
constexpr std::int32_t snapHeight(std::int32_t y, int level) { return static_cast<std::int32_t>(roundTo(y, verticalBits(level))); }

struct LeafAddress {
  std::int32_t level = 0;
  std::int64_t i = 0;  // x index: the square's least x is i * side
  std::int64_t j = 0;  // z index

  constexpr int sideBits() const { return kFinestSideBits + level; }
  constexpr Step side() const { return Step{1} << sideBits(); }
  constexpr Step x() const { return i * side(); }  // least x, in steps
  constexpr Step z() const { return j * side(); }
  constexpr bool contains(Point p) const { return (p.x >> sideBits()) == i && (p.z >> sideBits()) == j; }
  // The exact centroid rule, given the sums of the three corners' coordinates.
  constexpr bool containsCentroid(Step sumX, Step sumZ) const {
    return sumX >= 3 * x() && sumX < 3 * (x() + side()) && sumZ >= 3 * z() && sumZ < 3 * (z() + side());
  }
  constexpr LeafAddress parent() const { return {level + 1, i >> 1, j >> 1}; }
  // quadrant: bit 0 is x, bit 1 is z.
  constexpr LeafAddress child(int quadrant) const { return {level - 1, 2 * i + (quadrant & 1), 2 * j + (quadrant >> 1)}; }
  constexpr bool isAncestorOf(LeafAddress other) const {
    return other.level <= level && (other.i >> (level - other.level)) == i && (other.j >> (level - other.level)) == j;
  }
  // Canonical order: by level, then i, then j.
  friend constexpr auto operator<=>(const LeafAddress&, const LeafAddress&) = default;
};

constexpr LeafAddress leafAt(Point p, int level) { return {level, p.x >> (kFinestSideBits + level), p.z >> (kFinestSideBits + level)}; }
constexpr bool addressIsValid(LeafAddress a) {
  if (a.level < 0 || a.level > kMaxLevel) return false;
  const std::int64_t limit = kMaxPosition >> a.sideBits();
  return a.i >= -limit && a.i <= limit && a.j >= -limit && a.j <= limit;
}

// What a terrain function receives: the cell of 4,096 m and the fraction inside it, exact in a float.
constexpr std::int32_t cellOf(Step v) { return static_cast<std::int32_t>(v >> kCellBits); }
constexpr float fractionOf(Step v) {
  return static_cast<float>(static_cast<std::int32_t>(v & ((Step{1} << kCellBits) - 1))) * (1.0f / (1 << kCellBits));
}

// A bijective 64-bit mix (the finaliser of SplitMix64, Steele et al. 2014).
constexpr std::uint64_t mix(std::uint64_t v) {
  v += 0x9e3779b97f4a7c15ull;
  v = (v ^ (v >> 30)) * 0xbf58476d1ce4e5b9ull;
  v = (v ^ (v >> 27)) * 0x94d049bb133111ebull;
  return v ^ (v >> 31);
}

struct LeafAddressHash {
  std::size_t operator()(const LeafAddress& a) const {
    return static_cast<std::size_t>(
        mix(static_cast<std::uint64_t>(a.level) + mix(static_cast<std::uint64_t>(a.i) + mix(static_cast<std::uint64_t>(a.j)))));
  }
};

}  // namespace ridgecast::lattice
