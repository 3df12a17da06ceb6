#pragma once
// Members' changes of the ground: operations in whole steps. An operation sets the height at each *post*; posts stand every kPostSteps
// along x and z, with bicubic heights between them (edited_terrain.h). All of it is integer arithmetic, so the same operations in the same
// order give the same ground, bit for bit.
//
// Cost: an operation examines the posts of its area (areaOf), at most kMaxPosts; those that read the ground also evaluate the terrain
// there.

#include <algorithm>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/terrain/materials.h"

namespace ridgecast::edits {

inline constexpr int kPostBits = 7;  // steps between posts, as a power of two: 0.5 m
inline constexpr lattice::Step kPostSteps = lattice::Step{1} << kPostBits;
inline constexpr std::int32_t kMaxRise = std::int32_t{1} << 20;  // steps, +-: 4,096 m from the terrain's own height
inline constexpr lattice::Step kMinRadius = kPostSteps, kMaxRadius = lattice::Step{1} << 16;  // 0.5 to 256 m
inline constexpr lattice::Step kBank = lattice::Step{1} << 13;    // how far level ground and roads reach beyond their border: 32 m
inline constexpr lattice::Step kRunOut = lattice::Step{1} << 11;  // of that, in which banks run out to ground that they have not met: 8 m
inline constexpr lattice::Step kMaxLength = lattice::Step{1} << 19;  // of a road: 2,048 m
inline constexpr std::size_t kMaxCorners = 256, kMaxStations = 1024;
inline constexpr std::uint32_t kMaxSlope = 1u << 16;  // 1/256: 256 m a metre, a wall
inline constexpr std::uint32_t kMaxStampSide = 256;   // samples
inline constexpr std::int64_t kMaxPosts = std::int64_t{1} << 21;
inline constexpr std::uint32_t kMaxPasses = 16;                          // of smoothing
inline constexpr std::uint32_t kMaterials = terrain::kMaterials.size();  // 1..8; 0: the ground's own

// Adds `amount` within `core` of the middle, less towards `radius` (smoothstep), nothing beyond. Negative: lowers.
struct Raise {
  lattice::Point at;
  lattice::Step radius = 0, core = 0;
  std::int32_t amount = 0;
  friend bool operator==(const Raise&, const Raise&) = default;
};

// A bowl of this depth inside `radius`, with a rim a quarter as high that runs out at 1.5 radii. Added to what is there.
struct Crater {
  lattice::Point at;
  lattice::Step radius = 0;
  std::int32_t depth = 0;
  friend bool operator==(const Crater&, const Crater&) = default;
};

// Level at `height` inside a polygon, or a circle around its only corner. Outside, up to kBank from the border, the ground keeps within
// a bank that rises and falls from there by `slope`; over the last kRunOut, whatever is left runs out evenly.
struct Level {
  std::vector<lattice::Point> corners;
  lattice::Step radius = 0;   // of a circle; polygons: 0
  std::int32_t height = 0;    // steps
  std::uint32_t slope = 256;  // 1/256: rise of the bank, metres in 256 m
  friend bool operator==(const Level&, const Level&) = default;
};

// Each height becomes the mean of its neighbours, weighted 1 2 1 along both axes, `passes` times.
struct Smooth {
  lattice::Point at;
  lattice::Step radius = 0;  // at most a quarter of kMaxRadius
  std::uint32_t passes = 4;  // 1..kMaxPasses
  friend bool operator==(const Smooth&, const Smooth&) = default;
};

// A band `width` wide along a line of stations with heights, banks as of Level. A line without heights is to be surveyed first.
struct Road {
  std::vector<lattice::Vertex> line;  // at least 2
  bool surveyed = false;              // false: heights are ignored
  lattice::Step width = 0;
  std::uint32_t grade = 26;   // 1/256: the greatest slope along the line that survey() gives it
  std::uint32_t slope = 171;  // 1/256: of the banks
  friend bool operator==(const Road&, const Road&) = default;
};

// A small height map, added to what is there: samples `spacing` posts apart, linear between them, its middle at `at`.
struct Stamp {
  lattice::Point at;
  std::uint32_t width = 0, height = 0;  // samples along x and z, 2..kMaxStampSide
  std::uint32_t spacing = 1;            // posts, 1..16
  std::vector<std::int32_t> samples;    // steps, along x first
  friend bool operator==(const Stamp&, const Stamp&) = default;
};

// The edit of this number no longer counts; undoing this undo restores it.
struct Undo {
  std::uint64_t edit = 0;
  friend bool operator==(const Undo&, const Undo&) = default;
};

struct Operation {
  std::variant<Raise, Crater, Level, Smooth, Road, Stamp, Undo> what;
  std::uint32_t material = 0;  // of the ground that it changes
  friend bool operator==(const Operation&, const Operation&) = default;
};

// A rectangle of posts, half-open.
struct Posts {
  std::int64_t x0 = 0, z0 = 0, x1 = 0, z1 = 0;
  bool empty() const { return x0 >= x1 || z0 >= z1; }
  bool meets(const Posts& o) const { return x0 < o.x1 && o.x0 < x1 && z0 < o.z1 && o.z0 < z1; }
  std::int64_t count() const { return empty() ? 0 : (x1 - x0) * (z1 - z0); }
  Posts wider(std::int64_t by) const { return {x0 - by, z0 - by, x1 + by, z1 + by}; }
  Posts within(const Posts& o) const { return {std::max(x0, o.x0), std::max(z0, o.z0), std::min(x1, o.x1), std::min(z1, o.z1)}; }
  void add(const Posts& o);
  friend bool operator==(const Posts&, const Posts&) = default;
};

// The ground that posts are part of: what lies between them depends on two to either side.
constexpr lattice::Area groundOf(const Posts& p) {
  return p.x0 >= p.x1 || p.z0 >= p.z1
             ? lattice::Area()
             : lattice::Area{(p.x0 - 2) * kPostSteps, (p.z0 - 2) * kPostSteps, (p.x1 + 1) * kPostSteps, (p.z1 + 1) * kPostSteps};
}

// Error: one sentence with what is wrong and what would be right. Every number of a valid operation is safe to compute with.
Outcome<void> check(const Operation& operation);

// The posts that an operation may change. It reads no others, except Smooth, which reads `passes` more around them. An undo: none.
Posts areaOf(const Operation& operation);
inline std::int64_t marginOf(const Operation& o) { return std::holds_alternative<Smooth>(o.what) ? std::get<Smooth>(o.what).passes : 0; }

// The road with stations at most 8 m apart whose heights follow the ground as far as its grade allows: its greatest cut is as deep as its
// greatest fill is high, so no other line of that grade has a smaller one.
// `ground`: heights in steps of the stations that stationsOf() names.
std::vector<lattice::Point> stationsOf(const Road& road);
Road survey(const Road& road, const std::vector<std::int32_t>& ground);

// Whether making `asked` can give `made`: the same or, for a road without heights, a surveyed one. Both are valid.
bool isMadeOf(const Operation& asked, const Operation& made);

// Whether the change of height depends on the height there, and not on the place alone.
bool readsGround(const Operation& operation);

// The square root, rounded down.
std::int64_t rootOf(std::int64_t square);

// Applies one operation to single posts; made once, used for many. All but Smooth and Undo.
class Brush {
 public:
  explicit Brush(const Operation& operation);
  // Cost of examining one post, relative to a simple operation: polygons and roads have many sides.
  std::uint64_t effort() const { return 1 + segments_.size() / 128; }
  // Whether any post within `radius` steps of a place may change. Until the next call, at() may be called only for those.
  bool reaches(lattice::Point middle, lattice::Step radius);
  struct Result {
    std::int32_t height = 0;  // steps
    bool paints = false;      // the operation's material is the ground's now
  };
  // The result for height `ground` at a post; nothing: it stays. Operations that do not read the ground take any number.
  std::optional<Result> at(lattice::Point post, std::int32_t ground) const;

 private:
  struct Nearest {
    std::int64_t distance = 0;  // steps; of nearestOf() its square
    std::int32_t height = 0;    // of the line there
  };
  struct Segment {
    std::int64_t x, z, dx, dz, square;
    std::int32_t y, dy;
  };
  static Nearest nearestOf(const Segment& segment, std::int64_t x, std::int64_t z);
  Nearest toLine(std::int64_t x, std::int64_t z) const;
  bool inside(std::int64_t x, std::int64_t z) const;

  const Operation& operation_;
  lattice::Point origin_;  // what lines are counted from
  std::vector<Segment> segments_, near_;
};

}  // namespace ridgecast::edits
