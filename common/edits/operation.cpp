#include "common/edits/operation.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

namespace ridgecast::edits {

using lattice::Point;
using lattice::Step;

namespace {

constexpr std::int64_t kOne = 1 << 15;  // of weights

std::string metresText(std::int64_t steps) {
  std::string out = std::to_string(static_cast<double>(steps) / lattice::kStepsPerMetre);
  out.erase(out.find_last_not_of('0') + 1);
  if (out.back() == '.') out.pop_back();
  return out;
}

bool onLattice(Point p) { return lattice::positionIsValid(p.x, p.z); }

Outcome<void> checkPlace(Point p) {
  if (onLattice(p)) return {};
  return Error{"An edit's place lies beyond the lattice; positions lie within 2^50 steps, 4.39e12 m, of 0."};
}

Outcome<void> checkLength(const char* what, Step value, Step least, Step most) {
  if (value >= least && value <= most) return {};
  return Error{std::string("An edit's ") + what + " is " + metresText(value) + " m; it must be " + metresText(least) + " to " +
               metresText(most) + " m."};
}

Outcome<void> checkSlope(const char* what, std::uint32_t slope) {
  if (slope >= 1 && slope <= kMaxSlope) return {};
  return Error{std::string("An edit's ") + what + " is " + std::to_string(slope) + "/256; it must be 1/256 to 256."};
}

// A line or polygon: valid places, not too long.
template <class Corner>
Outcome<void> checkLine(const char* what, const std::vector<Corner>& line, std::size_t least, std::size_t most) {
  if (line.size() < least || line.size() > most)
    return Error{std::string(what) + " has " + std::to_string(line.size()) + " corners; it must have " + std::to_string(least) + " to " +
                 std::to_string(most) + "."};
  for (const Corner& c : line) {
    if (auto place = checkPlace({c.x, c.z}); !place) return place;
    if (std::abs(c.x - line[0].x) > kMaxLength || std::abs(c.z - line[0].z) > kMaxLength)
      return Error{std::string(what) + " spans more than " + metresText(kMaxLength) + " m; make several edits."};
  }
  return {};
}

Outcome<void> first(std::initializer_list<Outcome<void>> checks) {
  for (const Outcome<void>& c : checks)
    if (!c) return c;
  return {};
}

Outcome<void> checkKind(const Raise& o) {
  return first({checkPlace(o.at), checkLength("radius", o.radius, kMinRadius, kMaxRadius), checkLength("core", o.core, 0, o.radius),
                checkLength("amount", o.amount, -kMaxRise, kMaxRise)});
}
Outcome<void> checkKind(const Crater& o) {
  return first({checkPlace(o.at), checkLength("radius", o.radius, kMinRadius, kMaxRadius), checkLength("depth", o.depth, 1, kMaxRise)});
}
Outcome<void> checkKind(const Level& o) {
  auto rest = first({checkLength("height", o.height, -lattice::kMaxHeight, lattice::kMaxHeight), checkSlope("slope", o.slope)});
  if (!rest) return rest;
  if (o.corners.size() == 1) return first({checkPlace(o.corners[0]), checkLength("radius", o.radius, kMinRadius, kMaxRadius)});
  if (o.radius != 0) return Error{"Level ground is a polygon of 3 or more corners, or a circle with one corner, its middle, and a radius."};
  return checkLine("A polygon of level ground", o.corners, 3, kMaxCorners);
}
Outcome<void> checkKind(const Smooth& o) {
  if (o.passes < 1 || o.passes > kMaxPasses) return Error{"Smoothing takes 1 to 16 passes, not " + std::to_string(o.passes) + "."};
  return first({checkPlace(o.at), checkLength("radius", o.radius, kMinRadius, kMaxRadius / 4)});
}
Outcome<void> checkKind(const Road& o) {
  auto rest =
      first({checkLine("A road", o.line, 2, o.surveyed ? kMaxStations : kMaxCorners),
             checkLength("width", o.width, kMinRadius, kMaxRadius / 4), checkSlope("grade", o.grade), checkSlope("slope", o.slope)});
  if (!rest) return rest;
  double length = 0;
  for (std::size_t k = 1; k < o.line.size(); ++k)
    length += std::hypot(static_cast<double>(o.line[k].x - o.line[k - 1].x), static_cast<double>(o.line[k].z - o.line[k - 1].z));
  if (length > static_cast<double>(kMaxLength))
    return Error{"A road is longer than " + metresText(kMaxLength) + " m; build it in pieces, each from the end of the one before."};
  if (o.surveyed)
    for (const lattice::Vertex& v : o.line)
      if (auto height = checkLength("height", v.y, -lattice::kMaxHeight, lattice::kMaxHeight); !height) return height;
  return {};
}
Outcome<void> checkKind(const Stamp& o) {
  const auto fits = [](std::uint32_t side) { return side >= 2 && side <= kMaxStampSide; };
  if (!fits(o.width) || !fits(o.height) || o.samples.size() != std::size_t{o.width} * o.height)
    return Error{"A stamp has 2 to 256 samples along each side, and as many in all as these say."};
  if (o.spacing < 1 || o.spacing > 16) return Error{"A stamp's samples stand 1 to 16 posts (0.5 to 8 m) apart."};
  for (const std::int32_t v : o.samples)
    if (auto height = checkLength("sample", v, -kMaxRise, kMaxRise); !height) return height;
  return checkPlace(o.at);
}
Outcome<void> checkKind(const Undo& o) {
  if (o.edit > 0) return {};
  return Error{"Edits are numbered from 1; there is none with the number 0."};
}

std::int64_t floorPost(Step v) { return v >> kPostBits; }
std::int64_t ceilPost(Step v) { return (v + kPostSteps - 1) >> kPostBits; }
Posts around(Point p, Step reach) {
  return {ceilPost(p.x - reach), ceilPost(p.z - reach), floorPost(p.x + reach) + 1, floorPost(p.z + reach) + 1};
}
template <class Line>
Posts aroundLine(const Line& line, Step reach) {
  Posts out;
  for (const auto& c : line) out.add(around({c.x, c.z}, reach));
  return out;
}

// The ground held between a bank that rises and one that falls from `height`; where these have not met it, they run out to it at last.
std::int32_t banked(std::int32_t ground, std::int32_t height, std::int64_t distance, std::uint32_t slope) {
  const std::int64_t give = (distance * slope) >> 8;
  const std::int64_t by = std::clamp<std::int64_t>(ground, height - give, height + give) - ground;
  return static_cast<std::int32_t>(ground + by * std::min(kBank - distance, kRunOut) / kRunOut);
}

std::int64_t squareOf(std::int64_t x, std::int64_t z) { return x * x + z * z; }

}  // namespace

void Posts::add(const Posts& o) {
  if (o.empty()) return;
  if (empty()) {
    *this = o;
    return;
  }
  x0 = std::min(x0, o.x0), z0 = std::min(z0, o.z0), x1 = std::max(x1, o.x1), z1 = std::max(z1, o.z1);
}

std::int64_t rootOf(std::int64_t square) {
  auto root = static_cast<std::int64_t>(std::sqrt(static_cast<double>(square)));
  while (root * root > square) --root;
  while ((root + 1) * (root + 1) <= square) ++root;
  return root;
}

Outcome<void> check(const Operation& operation) {
  if (operation.material > kMaterials)
    return Error{"An edit's material is " + std::to_string(operation.material) + "; there are 1 to 8, and 0 for the ground's own."};
  if (auto kind = std::visit([](const auto& o) { return checkKind(o); }, operation.what); !kind) return kind;
  const Posts area = areaOf(operation);
  // Roads look at the posts near their line alone.
  if (!std::holds_alternative<Road>(operation.what) && area.count() > kMaxPosts)
    return Error{"An edit's area holds " + std::to_string(area.count()) + " posts of 0.25 m2; the most is " + std::to_string(kMaxPosts) +
                 ": make several edits."};
  return {};
}

Posts areaOf(const Operation& operation) {
  struct Area {
    Posts operator()(const Raise& o) const { return around(o.at, o.radius); }
    Posts operator()(const Crater& o) const { return around(o.at, o.radius + o.radius / 2); }
    Posts operator()(const Level& o) const { return aroundLine(o.corners, o.radius + kBank); }
    Posts operator()(const Smooth& o) const { return around(o.at, o.radius); }
    Posts operator()(const Road& o) const { return aroundLine(o.line, o.width / 2 + kBank); }
    Posts operator()(const Stamp& o) const {
      const std::int64_t x = floorPost(o.at.x) - std::int64_t{o.width - 1} * o.spacing / 2,
                         z = floorPost(o.at.z) - std::int64_t{o.height - 1} * o.spacing / 2;
      return {x, z, x + std::int64_t{o.width - 1} * o.spacing + 1, z + std::int64_t{o.height - 1} * o.spacing + 1};
    }
    Posts operator()(const Undo&) const { return {}; }
  };
  return std::visit(Area(), operation.what);
}

bool readsGround(const Operation& o) {
  return std::holds_alternative<Level>(o.what) || std::holds_alternative<Road>(o.what) || std::holds_alternative<Smooth>(o.what);
}

std::vector<Point> stationsOf(const Road& road) {
  constexpr Step kApart = 8 << lattice::kStepBits;
  std::vector<Point> out{{road.line[0].x, road.line[0].z}};
  for (std::size_t k = 1; k < road.line.size(); ++k) {
    const lattice::Vertex &a = road.line[k - 1], &b = road.line[k];
    const Step dx = b.x - a.x, dz = b.z - a.z, pieces = std::max<Step>(1, (rootOf(squareOf(dx, dz)) + kApart - 1) / kApart);
    for (Step piece = 1; piece <= pieces; ++piece) out.push_back({a.x + dx * piece / pieces, a.z + dz * piece / pieces});
  }
  return out;
}

Road survey(const Road& road, const std::vector<std::int32_t>& ground) {
  const std::vector<Point> stations = stationsOf(road);
  std::vector<std::int64_t> give{0}, high(ground.begin(), ground.end()), low = high;
  for (std::size_t k = 1; k < stations.size(); ++k) {
    give.push_back((rootOf(squareOf(stations[k].x - stations[k - 1].x, stations[k].z - stations[k - 1].z)) * road.grade) >> 8);
    high[k] = std::max(high[k], high[k - 1] - give[k]);
    low[k] = std::min(low[k], low[k - 1] + give[k]);
  }
  for (std::size_t k = stations.size() - 1; k > 0; --k) {
    high[k - 1] = std::max(high[k - 1], high[k] - give[k]);
    low[k - 1] = std::min(low[k - 1], low[k] + give[k]);
  }
  Road out = road;
  out.surveyed = true;
  out.line.clear();
  for (std::size_t k = 0; k < stations.size(); ++k)
    out.line.push_back({stations[k].x, stations[k].z, static_cast<std::int32_t>((high[k] + low[k]) >> 1)});
  return out;
}

bool isMadeOf(const Operation& asked, const Operation& made) {
  const auto *from = std::get_if<Road>(&asked.what), *to = std::get_if<Road>(&made.what);
  if (!from || !to || from->surveyed || !to->surveyed) return asked == made;
  return asked.material == made.material && from->width == to->width && from->grade == to->grade && from->slope == to->slope &&
         std::ranges::equal(stationsOf(*from), to->line, {}, {}, [](const lattice::Vertex& v) {
           return Point{v.x, v.z};
         });
}

Brush::Brush(const Operation& operation) : operation_(operation) {
  const auto add = [this](const lattice::Vertex& a, const lattice::Vertex& b) {
    const Step dx = b.x - a.x, dz = b.z - a.z;
    segments_.push_back({a.x - origin_.x, a.z - origin_.z, dx, dz, squareOf(dx, dz), a.y, b.y - a.y});
  };
  if (const auto* road = std::get_if<Road>(&operation.what)) {
    origin_ = {road->line[0].x, road->line[0].z};
    for (std::size_t k = 1; k < road->line.size(); ++k) add(road->line[k - 1], road->line[k]);
  } else if (const auto* level = std::get_if<Level>(&operation.what)) {
    origin_ = level->corners[0];
    for (std::size_t k = 0; k < level->corners.size(); ++k) {
      const Point a = level->corners[k], b = level->corners[(k + 1) % level->corners.size()];
      add({a.x, a.z, level->height}, {b.x, b.z, level->height});
    }
  }
  near_ = segments_;
}

Brush::Nearest Brush::nearestOf(const Segment& s, std::int64_t x, std::int64_t z) {
  const std::int64_t px = x - s.x, pz = z - s.z, along = px * s.dx + pz * s.dz;
  // The share of the segment at which its nearest point lies, in 2^-16.
  const std::int64_t t = along <= 0 ? 0 : along >= s.square ? 65'536 : along * 65'536 / s.square;
  return {squareOf(px - ((s.dx * t) >> 16), pz - ((s.dz * t) >> 16)), s.y + static_cast<std::int32_t>((s.dy * t) >> 16)};
}

Brush::Nearest Brush::toLine(std::int64_t x, std::int64_t z) const {
  Nearest out{std::int64_t{1} << 60, 0};
  for (const Segment& s : near_)
    if (const Nearest nearest = nearestOf(s, x, z); nearest.distance < out.distance) out = nearest;
  out.distance = rootOf(out.distance);
  return out;
}

bool Brush::inside(std::int64_t x, std::int64_t z) const {
  bool odd = false;
  for (const Segment& s : segments_) {
    if ((s.z > z) == (s.z + s.dz > z)) continue;
    // Whether the edge crosses the ray from here along +x.
    const std::int64_t side = (x - s.x) * s.dz - (z - s.z) * s.dx;
    if (s.dz > 0 ? side < 0 : side > 0) odd = !odd;
  }
  return odd;
}

bool Brush::reaches(Point middle, Step radius) {
  if (segments_.empty()) return true;
  const std::int64_t x = middle.x - origin_.x, z = middle.z - origin_.z;
  near_ = segments_;
  const std::int64_t distance = toLine(x, z).distance;
  // The others are nowhere the nearest. Nearest points are off by steps, as whole numbers are.
  constexpr std::int64_t kOff = 64;
  std::erase_if(near_, [&](const Segment& s) { return rootOf(nearestOf(s, x, z).distance) > distance + 2 * radius + kOff; });
  const auto* road = std::get_if<Road>(&operation_.what);
  return !road || distance <= road->width / 2 + kBank + radius + 2;
}

std::optional<Brush::Result> Brush::at(Point post, std::int32_t ground) const {
  if (const auto* o = std::get_if<Raise>(&operation_.what)) {
    const std::int64_t square = squareOf(post.x - o->at.x, post.z - o->at.z);
    if (square >= o->radius * o->radius) return {};
    const std::int64_t d = rootOf(square);
    if (d <= o->core) return Result{ground + o->amount, true};
    const std::int64_t t = (o->radius - d) * kOne / (o->radius - o->core);
    const std::int64_t weight = t * t / kOne * (3 * kOne - 2 * t) / kOne;
    return Result{ground + static_cast<std::int32_t>((o->amount * weight) >> 15), true};
  }
  if (const auto* o = std::get_if<Crater>(&operation_.what)) {
    const std::int64_t d = rootOf(squareOf(post.x - o->at.x, post.z - o->at.z)), rim = o->depth / 4, half = o->radius / 2;
    if (d >= o->radius + half) return {};
    if (d <= o->radius)
      return Result{ground + static_cast<std::int32_t>((o->depth + rim) * (d * d) / (o->radius * o->radius) - o->depth), true};
    const std::int64_t left = (o->radius + half - d) * kOne / half;
    return Result{ground + static_cast<std::int32_t>((rim * (left * left / kOne)) >> 15), true};
  }
  if (const auto* o = std::get_if<Level>(&operation_.what)) {
    const std::int64_t x = post.x - origin_.x, z = post.z - origin_.z;
    std::int64_t d = 0;
    if (o->corners.size() == 1)
      d = std::max<std::int64_t>(0, rootOf(squareOf(x, z)) - o->radius);
    else if (!inside(x, z))
      d = toLine(x, z).distance;
    if (d > kBank) return {};
    return Result{banked(ground, o->height, d, o->slope), d == 0};
  }
  if (const auto* o = std::get_if<Road>(&operation_.what)) {
    const Nearest line = toLine(post.x - origin_.x, post.z - origin_.z);
    const std::int64_t d = std::max<std::int64_t>(0, line.distance - o->width / 2);
    if (d > kBank) return {};
    return Result{banked(ground, line.height, d, o->slope), d == 0};
  }
  if (const auto* o = std::get_if<Stamp>(&operation_.what)) {
    const Posts area = areaOf(operation_);
    const std::int64_t x = floorPost(post.x) - area.x0, z = floorPost(post.z) - area.z0, apart = o->spacing;
    if (x < 0 || z < 0 || x >= area.x1 - area.x0 || z >= area.z1 - area.z0) return {};
    const std::int64_t i = std::min<std::int64_t>(x / apart, o->width - 2), j = std::min<std::int64_t>(z / apart, o->height - 2),
                       s = x - i * apart, t = z - j * apart;
    const auto sample = [&](std::int64_t a, std::int64_t b) {
      return std::int64_t{o->samples[static_cast<std::size_t>(b * o->width + a)]};
    };
    const std::int64_t sum =
        (sample(i, j) * (apart - s) + sample(i + 1, j) * s) * (apart - t) + (sample(i, j + 1) * (apart - s) + sample(i + 1, j + 1) * s) * t;
    const std::int64_t whole = apart * apart;
    return Result{ground + static_cast<std::int32_t>(sum >= 0 ? sum / whole : -((whole - 1 - sum) / whole)), true};
  }
  return {};
}

}  // namespace ridgecast::edits
