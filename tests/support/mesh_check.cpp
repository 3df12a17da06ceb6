#include "tests/support/mesh_check.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <unordered_map>

namespace ridgecast::testing_support {
namespace {

using Wide = __int128;
struct P {
  std::int64_t x, z;
  std::int32_t y;
};

std::uint64_t edgeKey(std::uint32_t a, std::uint32_t b) { return (std::uint64_t{a} << 32) | b; }

}  // namespace

std::string MeshReport::text() const {
  std::ostringstream out;
  out << leaves << " leaves, " << vertices << " vertices, " << triangles << " triangles; heights " << heights << ", clockwise " << clockwise
      << ", overused " << overused << ", misfiled " << misfiled << ", cracks " << cracks << ", notDelaunay " << notDelaunay
      << ", notCanonical " << notCanonical;
  return out.str();
}

MeshReport checkMesh(const std::vector<mesh::LeafMesh>& leaves) {
  MeshReport report;
  report.leaves = leaves.size();
  std::vector<P> points;
  std::map<std::pair<std::int64_t, std::int64_t>, std::uint32_t> ids;
  struct Tri {
    std::uint32_t v[3];
  };
  std::vector<Tri> triangles;
  const auto inSquare = [](const mesh::LeafMesh& leaf, std::int64_t x3, std::int64_t z3) {
    const std::int64_t side = std::int64_t{1} << (13 + leaf.address.level), x = leaf.address.i * side, z = leaf.address.j * side;
    return x3 >= 3 * x && x3 < 3 * (x + side) && z3 >= 3 * z && z3 < 3 * (z + side);
  };
  for (const mesh::LeafMesh& leaf : leaves) {
    const std::int64_t side = std::int64_t{1} << (13 + leaf.address.level), x0 = leaf.address.i * side, z0 = leaf.address.j * side;
    std::vector<std::uint32_t> local;
    for (const auto& v : leaf.vertices) {
      const auto [it, added] = ids.try_emplace({x0 + v.x, z0 + v.z}, static_cast<std::uint32_t>(points.size()));
      if (added)
        points.push_back({x0 + v.x, z0 + v.z, v.y});
      else if (points[it->second].y != v.y)
        ++report.heights;
      local.push_back(it->second);
    }
    for (const auto& t : leaf.triangles) {
      const Tri tri{{local[t[0]], local[t[1]], local[t[2]]}};
      triangles.push_back(tri);
      std::int64_t sx = 0, sz = 0;
      for (std::uint32_t v : tri.v) sx += points[v].x, sz += points[v].z;
      if (!inSquare(leaf, sx, sz)) ++report.misfiled;
    }
  }
  report.vertices = points.size();
  report.triangles = triangles.size();

  // Paper coordinates: (x, -z) is counter-clockwise seen from above.
  const auto turn = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const P &p = points[a], &q = points[b], &r = points[c];
    return Wide{q.x - p.x} * (p.z - r.z) - Wide{p.z - q.z} * (r.x - p.x);
  };
  std::unordered_map<std::uint64_t, std::uint32_t> apex;
  apex.reserve(triangles.size() * 4);
  for (const Tri& t : triangles) {
    if (turn(t.v[0], t.v[1], t.v[2]) <= 0) {
      ++report.clockwise;
      continue;
    }
    for (int k = 0; k < 3; ++k)
      if (!apex.emplace(edgeKey(t.v[k], t.v[(k + 1) % 3]), t.v[(k + 2) % 3]).second) ++report.overused;
  }
  std::unordered_map<std::uint32_t, std::vector<std::uint32_t>> boundary;  // reversed boundary edges: from -> to
  for (const auto& [key, c] : apex) {
    const auto a = static_cast<std::uint32_t>(key >> 32), b = static_cast<std::uint32_t>(key);
    const auto back = apex.find(edgeKey(b, a));
    if (back == apex.end()) {
      boundary[b].push_back(a);
      continue;
    }
    if (a > b) continue;
    ++report.interiorEdges;
    const std::uint32_t d = back->second;
    const std::uint32_t three[3] = {a, b, c};
    Wide m[3][3];
    for (int k = 0; k < 3; ++k) {
      m[k][0] = points[three[k]].x - points[d].x;
      m[k][1] = points[d].z - points[three[k]].z;
      m[k][2] = m[k][0] * m[k][0] + m[k][1] * m[k][1];
    }
    const Wide det = m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) - m[1][2] * (m[0][0] * m[2][1] - m[0][1] * m[2][0]) +
                     m[2][2] * (m[0][0] * m[1][1] - m[0][1] * m[1][0]);
    if (det > 0) ++report.notDelaunay;
    if (det == 0) {
      std::uint32_t least = a;
      for (std::uint32_t v : {b, c, d})
        if (std::pair(points[v].x, points[v].z) < std::pair(points[least].x, points[least].z)) least = v;
      if (least != a && least != b) ++report.notCanonical;
    }
  }

  // Reversed boundary edges run round each hole with the hole on their left, and round the whole with the outside on their left. At a
  // vertex where loops touch, take the leftmost way on, so that a loop never crosses into another.
  using Polygon = std::vector<std::pair<double, double>>;  // relative to its first point
  struct Outline {
    Polygon points;
    std::int64_t x, z;
  };
  const auto polygonOf = [&](const std::vector<std::uint32_t>& loop) {
    Outline out{{}, points[loop[0]].x, points[loop[0]].z};
    for (std::uint32_t v : loop) out.points.push_back({static_cast<double>(points[v].x - out.x), static_cast<double>(points[v].z - out.z)});
    return out;
  };
  const auto areaOf = [](const Polygon& p) {
    double sum = 0;
    for (std::size_t k = 0; k < p.size(); ++k) {
      const auto &a = p[k], &b = p[(k + 1) % p.size()];
      sum += a.first * b.second - b.first * a.second;
    }
    return std::abs(sum) / 2;
  };
  // The share of an outline that leaves cover; 1 for one without area.
  const auto coveredShare = [&](const Outline& outline) {
    const double whole = areaOf(outline.points);
    if (whole == 0) return 1.0;
    double sum = 0;
    for (const mesh::LeafMesh& leaf : leaves) {
      const std::int64_t side = std::int64_t{1} << (13 + leaf.address.level);
      const double x0 = static_cast<double>(leaf.address.i * side - outline.x), z0 = static_cast<double>(leaf.address.j * side - outline.z);
      Polygon part = outline.points;
      for (int edge = 0; edge < 4 && !part.empty(); ++edge) {  // Sutherland and Hodgman
        const auto depth = [&](const std::pair<double, double>& p) {
          const double v = edge < 2 ? p.first - x0 : p.second - z0;
          return edge % 2 == 0 ? v : static_cast<double>(side) - v;
        };
        Polygon kept;
        for (std::size_t k = 0; k < part.size(); ++k) {
          const auto &a = part[k], &b = part[(k + 1) % part.size()];
          const double da = depth(a), db = depth(b);
          if (da >= 0) kept.push_back(a);
          if ((da > 0 && db < 0) || (da < 0 && db > 0)) {
            const double f = da / (da - db);
            kept.push_back({a.first + f * (b.first - a.first), a.second + f * (b.second - a.second)});
          }
        }
        part = std::move(kept);
      }
      if (part.size() > 2) sum += areaOf(part);
    }
    return sum / whole;
  };
  std::vector<Outline> around;
  while (!boundary.empty()) {
    // Start where only one loop passes, so that it is whole when it comes back there.
    const auto single = std::find_if(boundary.begin(), boundary.end(), [](const auto& entry) { return entry.second.size() == 1; });
    const std::uint32_t start = (single == boundary.end() ? boundary.begin() : single)->first;
    std::vector<std::uint32_t> loop{start};
    std::uint32_t from = start, at = boundary[start].back();
    boundary[start].pop_back();
    if (boundary[start].empty()) boundary.erase(start);
    while (at != start) {
      loop.push_back(at);
      const auto ways = boundary.find(at);
      if (ways == boundary.end()) break;
      const auto angle = [&](std::uint32_t to) {
        return std::atan2(static_cast<double>(points[at].z - points[to].z), static_cast<double>(points[to].x - points[at].x));
      };
      const double back = angle(from);
      std::size_t best = 0;
      double least = 100;
      for (std::size_t k = 0; k < ways->second.size(); ++k) {
        double way = back - angle(ways->second[k]);  // clockwise from the way back: the first one met keeps the gap on the left
        while (way <= 1e-15) way += 2 * 3.14159265358979323846;
        if (way < least) least = way, best = k;
      }
      const std::uint32_t to = ways->second[best];
      ways->second.erase(ways->second.begin() + static_cast<std::ptrdiff_t>(best));
      if (ways->second.empty()) boundary.erase(ways);
      from = at;
      at = to;
    }
    Wide area = 0;
    for (std::size_t k = 1; k + 1 < loop.size(); ++k) area += turn(loop[0], loop[k], loop[k + 1]);
    // Where the leaves end, the mesh may end in loops of its own: pockets and islands that touch the border at a vertex. What leaves
    // cover altogether is a hole in them, or an overlap.
    if (area < 0) {
      around.push_back(polygonOf(loop));
      continue;
    }
    if (loop.size() == 3) {
      const std::int64_t sx = points[loop[0]].x + points[loop[1]].x + points[loop[2]].x,
                         sz = points[loop[0]].z + points[loop[1]].z + points[loop[2]].z;
      if (std::none_of(leaves.begin(), leaves.end(), [&](const mesh::LeafMesh& l) { return inSquare(l, sx, sz); })) continue;
    }
    report.cracks += loop.size() == 3 || coveredShare(polygonOf(loop)) > 1 - 1e-9;
  }
  // The largest goes round the whole mesh.
  const auto whole = std::max_element(around.begin(), around.end(),
                                      [&](const Outline& a, const Outline& b) { return areaOf(a.points) < areaOf(b.points); });
  for (auto it = around.begin(); it != around.end(); ++it) report.cracks += it != whole && coveredShare(*it) > 1 - 1e-9;
  return report;
}

}  // namespace ridgecast::testing_support
