#pragma once
// Leaves' meshes for tests: random triangulations with every shape that a leaf can have. Built by means that share nothing with the
// product: a sweep over sorted points, jittered grids, holes torn into them.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"

namespace ridgecast::support {

using Random = std::mt19937_64;

inline std::int64_t between(Random& random, std::int64_t low, std::int64_t high) {
  return std::uniform_int_distribution<std::int64_t>(low, high)(random);
}

inline std::int64_t doubledArea(const mesh::LocalVertex& a, const mesh::LocalVertex& b, const mesh::LocalVertex& c) {
  return (std::int64_t{b.z} - a.z) * (std::int64_t{c.x} - a.x) - (std::int64_t{b.x} - a.x) * (std::int64_t{c.z} - a.z);
}

// A triangulation of the points' convex hull: each point, from left to right, is joined to all edges of the hull that it sees.
inline mesh::LeafMesh sweep(lattice::LeafAddress address, std::vector<mesh::LocalVertex> points) {
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.x == b.x && a.z == b.z; }),
               points.end());
  mesh::LeafMesh leaf{.address = address, .vertices = points, .triangles = {}};
  const auto count = static_cast<std::uint32_t>(points.size());
  std::uint32_t first = 2;
  while (first < count && doubledArea(points[0], points[1], points[first]) == 0) ++first;
  if (first >= count) return {.address = address, .vertices = {}, .triangles = {}};
  // The points before `first` lie on one line: a fan over them, then the hull counter-clockwise.
  std::vector<std::uint32_t> hull;
  const bool left = doubledArea(points[0], points[1], points[first]) > 0;
  for (std::uint32_t k = 0; k + 1 < first; ++k)
    leaf.triangles.push_back(left ? mesh::Triangle{k, k + 1, first} : mesh::Triangle{k + 1, k, first});
  for (std::uint32_t k = 0; k < first; ++k) hull.push_back(k);
  if (!left) std::reverse(hull.begin(), hull.end());
  hull.push_back(first);
  for (std::uint32_t p = first + 1; p < count; ++p) {
    const std::size_t n = hull.size();
    const auto sees = [&](std::size_t k) { return doubledArea(points[hull[k % n]], points[hull[(k + 1) % n]], points[p]) < 0; };
    std::size_t begin = 0;
    while (sees(begin)) ++begin;
    while (!sees(begin)) ++begin;
    std::size_t end = begin;
    for (; sees(end); ++end) leaf.triangles.push_back({hull[(end + 1) % n], hull[end % n], p});
    std::vector<std::uint32_t> next;
    for (std::size_t k = end; k <= begin + n; ++k) next.push_back(hull[k % n]);
    next.push_back(p);
    hull = std::move(next);
  }
  mesh::canonicalize(leaf);
  return leaf;
}

inline lattice::LeafAddress anyAddress(Random& random) {
  const auto level = static_cast<std::int32_t>(between(random, 0, lattice::kMaxLevel));
  const std::int64_t limit = between(random, 0, 1) == 0 ? 4 : lattice::kMaxPosition >> (lattice::kFinestSideBits + level);
  return {level, between(random, -limit, limit), between(random, -limit, limit)};
}

// Random points on the lattice of a random level, spilling over the leaf's square on every side.
inline mesh::LeafMesh randomTin(Random& random, int points) {
  const lattice::LeafAddress address = anyAddress(random);
  const int bits = lattice::horizontalBits(address.level);
  const lattice::Step side = address.side();
  std::vector<mesh::LocalVertex> all;
  for (int k = 0; k < points; ++k)
    all.push_back({static_cast<std::int32_t>(lattice::roundTo(between(random, -side / 4, side + side / 4), bits)),
                   static_cast<std::int32_t>(lattice::roundTo(between(random, -side / 4, side + side / 4), bits)),
                   lattice::snapHeight(static_cast<std::int32_t>(between(random, -100'000, 800'000)), address.level)});
  return sweep(address, std::move(all));
}

// A smooth surface over a jittered grid of n x n squares: what a leaf of a terrain looks like.
inline mesh::LeafMesh terrainLike(Random& random, int n, int level) {
  mesh::LeafMesh leaf{.address = {level, between(random, -1000, 1000), between(random, -1000, 1000)}, .vertices = {}, .triangles = {}};
  const double side = static_cast<double>(leaf.address.side());
  const double p = static_cast<double>(between(random, 0, 1000)), q = static_cast<double>(between(random, 0, 1000));
  std::uniform_real_distribution<double> jitter(-0.2, 0.2);
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) {
      const double x = (i + jitter(random)) * side / n, z = (j + jitter(random)) * side / n;
      double height = 0, amplitude = 100, frequency = 0.003 / 256;
      for (int octave = 0; octave < 7; ++octave, amplitude *= 0.5, frequency *= 2.1)
        height += amplitude * std::sin(x * frequency + p + octave) * std::cos(z * frequency * 1.1 + q);
      const int bits = lattice::horizontalBits(level);
      leaf.vertices.push_back({static_cast<std::int32_t>(lattice::roundTo(std::llround(x), bits)),
                               static_cast<std::int32_t>(lattice::roundTo(std::llround(z), bits)),
                               lattice::snapHeight(static_cast<std::int32_t>(std::lround(height * 256)), level)});
    }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const std::uint32_t a = at(i, j), b = at(i, j + 1), c = at(i + 1, j + 1), d = at(i + 1, j);
      const bool turn = between(random, 0, 1) == 1;
      leaf.triangles.push_back(turn ? mesh::Triangle{a, b, c} : mesh::Triangle{a, b, d});
      leaf.triangles.push_back(turn ? mesh::Triangle{a, c, d} : mesh::Triangle{b, c, d});
    }
  mesh::canonicalize(leaf);
  return leaf;
}

// Without a random share of its triangles: holes, islands, and vertices at which only corners meet.
inline mesh::LeafMesh torn(Random& random, mesh::LeafMesh leaf, double share) {
  std::bernoulli_distribution drop(share);
  std::erase_if(leaf.triangles, [&](const mesh::Triangle&) { return drop(random); });
  mesh::canonicalize(leaf);
  return leaf;
}

}  // namespace ridgecast::support
