#pragma once
// Meshes over a board of regions, and point sets of all kinds.

#include <algorithm>
#include <array>
#include <cstdint>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "common/triangulation/triangulation.h"

namespace ridgecast::triangulation {

// A board of squares, some of them regions.
class Board : public Partition {
 public:
  Board(int bits, int count, std::int32_t corner) : bits_(bits), count_(count), corner_(corner), regions_(count * count, kOutside) {}
  RegionId regionAt(Point2 p) const override {
    const std::int64_t i = (std::int64_t{p.x} - corner_) >> bits_, j = (std::int64_t{p.z} - corner_) >> bits_;
    return i < 0 || j < 0 || i >= count_ || j >= count_ ? kOutside : regions_[i * count_ + j];
  }
  RegionId& at(int i, int j) { return regions_[i * count_ + j]; }
  Square square(int i, int j) const { return {corner_ + i * (1 << bits_), corner_ + j * (1 << bits_), 1 << bits_}; }
  int count() const { return count_; }

 private:
  int bits_, count_;
  std::int32_t corner_;
  std::vector<RegionId> regions_;
};

using Corners = std::array<std::pair<std::int32_t, std::int32_t>, 3>;

inline Corners sortedCorners(Point2 a, Point2 b, Point2 c) {
  Corners r{{{a.x, a.z}, {b.x, b.z}, {c.x, c.z}}};
  std::sort(r.begin(), r.end());
  return r;
}

inline std::set<Corners> trianglesOf(const Triangulation& mesh) {
  std::set<Corners> out;
  for (RegionId r = 0; r < mesh.regionLimit(); ++r)
    if (mesh.trianglePages().hasRegion(r))
      mesh.trianglePages().forEach(r, [&](TriangleId t) {
        if (mesh.isGhost(t)) return;
        const auto& v = mesh.triangle(t).v;
        out.insert(sortedCorners(mesh.vertex(v[0]).point(), mesh.vertex(v[1]).point(), mesh.vertex(v[2]).point()));
      });
  return out;
}

enum Kind { kRandom, kTinyGrid, kRing, kLines, kHuge, kNearlyCollinear, kDenseAndEmpty, kKinds };

inline std::vector<Point2> makePoints(Kind kind, int count, std::mt19937& rng) {
  const auto in = [&](int low, int high) { return std::uniform_int_distribution<std::int32_t>(low, high)(rng); };
  std::set<std::pair<std::int32_t, std::int32_t>> set;
  const int tries = count * 20;
  for (int n = 0; n < tries && static_cast<int>(set.size()) < count; ++n) {
    switch (kind) {
      case kRandom:
        set.insert({in(-3000, 3000), in(-3000, 3000)});
        break;
      case kTinyGrid:
        set.insert({in(-3, 4) * 512, in(-3, 4) * 512});
        break;
      case kRing: {
        static const std::pair<int, int> onCircle[] = {{25, 0}, {24, 7}, {20, 15}, {15, 20}, {7, 24}, {0, 25}};
        const auto [p, q] = onCircle[in(0, 5)];
        const int s = in(0, 9) == 0 ? 40 : 80;
        set.insert({(in(0, 1) ? p : -p) * s, (in(0, 1) ? q : -q) * s});
        if (in(0, 6) == 0) set.insert({0, 0});
        break;
      }
      case kLines:
        set.insert(in(0, 4) ? std::pair{in(-40, 40) * 50, 0} : std::pair{in(-40, 40) * 50, in(-2, 2) * 700});
        break;
      case kHuge: {
        const std::int32_t far = (1 << 26) - 1;
        set.insert({in(0, 1) ? in(-far, far) : (in(0, 1) ? far : -far) + 0 * n,
                    in(0, 1) ? in(-far, far) : (in(0, 1) ? far - in(0, 3) : in(0, 3) - far)});
        break;
      }
      case kNearlyCollinear: {
        const std::int32_t x = in(-3000, 3000);
        set.insert({x, x / 3 + in(0, 1)});
        break;
      }
      case kDenseAndEmpty:
        set.insert(in(0, 3) ? std::pair{in(0, 12), in(0, 12)} : std::pair{in(-4000, 4000), in(-4000, 4000)});
        break;
      default:
        break;
    }
  }
  std::vector<Point2> out;
  for (auto [x, z] : set) out.push_back({x, z});
  std::shuffle(out.begin(), out.end(), rng);
  return out;
}

struct World {
  explicit World(Board& b, std::uint32_t room = 20000) : board(b), mesh(room, b) {
    for (int i = 0; i < board.count(); ++i)
      for (int j = 0; j < board.count(); ++j)
        if ((i + 2 * j) % 5 != 0) board.at(i, j) = mesh.addRegion(board.square(i, j));
    all.allowAll();
  }
  Change insert(Point2 p) { return mesh.insert({p.x, p.z, p.x ^ p.z, kNoEdge}, mesh.locate(p, mesh.anyTriangle(), all), all); }
  // Starts from the first three points that are not collinear; false when there are none.
  bool begin(std::vector<Point2> points) {
    for (std::size_t k = 2; k < points.size(); ++k)
      if (orientation(points[0], points[1], points[k]) != 0) {
        const auto v = [&](Point2 p) { return Vertex{p.x, p.z, p.x ^ p.z, kNoEdge}; };
        mesh.start(v(points[0]), v(points[1]), v(points[k]));
        return true;
      }
    return false;
  }
  VertexId find(Point2 p) {
    for (RegionId r = 0; r < mesh.regionLimit(); ++r) {
      VertexId found = kInfinite;
      if (mesh.vertexPages().hasRegion(r))
        mesh.vertexPages().forEach(r, [&](VertexId v) {
          if (v != kInfinite && mesh.vertex(v).point() == p) found = v;
        });
      if (found != kInfinite) return found;
    }
    return kInfinite;
  }
  Board& board;
  Triangulation mesh;
  WriteSet all;
};

}  // namespace ridgecast::triangulation
