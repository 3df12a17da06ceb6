#include "tests/support/verify.h"

#include <algorithm>
#include <set>
#include <sstream>
#include <unordered_map>
#include <unordered_set>

#include "server/generation/grid.h"

namespace ridgecast::testing_support {

using namespace triangulation;

namespace {

using Wide = __int128;
struct P {
  std::int64_t x, z;
};

// In (p, q) = (x, -z) counter-clockwise seen from above is counter-clockwise on paper.
std::int64_t cross(P a, P b, P c) { return (b.x - a.x) * (a.z - c.z) - (a.z - b.z) * (c.x - a.x); }
Wide circle(P a, P b, P c, P d) {
  const std::int64_t m[3][2] = {{a.x - d.x, d.z - a.z}, {b.x - d.x, d.z - b.z}, {c.x - d.x, d.z - c.z}};
  Wide sum = 0;
  for (int k = 0; k < 3; ++k) {
    const auto &u = m[(k + 1) % 3], &v = m[(k + 2) % 3];
    sum += Wide{m[k][0] * m[k][0] + m[k][1] * m[k][1]} * (u[0] * v[1] - v[0] * u[1]);
  }
  return sum;
}
bool before(P a, P b) { return a.x != b.x ? a.x < b.x : a.z < b.z; }

}  // namespace

std::string verify(const Triangulation& mesh, const Partition& partition) {
  std::ostringstream out;
  int faults = 0;
  const auto fault = [&](auto&&... text) {
    if (++faults <= 20) (out << ... << text) << '\n';
  };
  const auto at = [&](VertexId v) { return P{mesh.vertex(v).x, mesh.vertex(v).z}; };
  const auto show = [&](VertexId v) {
    return v == kInfinite ? std::string("infinity") : std::string("(") + std::to_string(at(v).x) + ", " + std::to_string(at(v).z) + ")";
  };

  std::vector<TriangleId> all;
  std::vector<VertexId> vertices;
  for (RegionId r = 0; r < mesh.regionLimit(); ++r) {
    if (!mesh.trianglePages().hasRegion(r)) continue;
    std::uint32_t count = 0;
    mesh.trianglePages().forEach(r, [&](TriangleId t) {
      all.push_back(t);
      ++count;
      if (mesh.regionOf(t) != r) fault("triangle ", t, " stored under region ", r, " says ", mesh.regionOf(t));
    });
    if (count != mesh.triangleCount(r)) fault("region ", r, " counts ", mesh.triangleCount(r), " triangles and holds ", count);
    mesh.vertexPages().forEach(r, [&](VertexId v) {
      if (v != kInfinite) vertices.push_back(v);
    });
  }
  if (all.empty()) return vertices.empty() ? "" : "vertices without triangles\n";

  std::unordered_map<std::uint64_t, HalfEdge> edges;
  edges.reserve(all.size() * 3);
  std::unordered_set<std::uint64_t> places;
  std::unordered_set<VertexId> used;
  std::size_t ghosts = 0;
  for (TriangleId t : all) {
    const Triangle& r = mesh.triangle(t);
    const bool ghost = mesh.isGhost(t);
    ghosts += ghost;
    for (unsigned k = 0; k < 3; ++k) {
      used.insert(r.v[k]);
      const VertexId a = r.v[k], b = r.v[(k + 1) % 3];
      if (a == b) fault("triangle ", t, " has a corner twice");
      if (!edges.emplace((std::uint64_t{a} << 32) | b, 4 * t + k).second) fault("edge ", show(a), " ", show(b), " used twice");
    }
    if (!ghost && cross(at(r.v[0]), at(r.v[1]), at(r.v[2])) <= 0)
      fault("triangle ", show(r.v[0]), " ", show(r.v[1]), " ", show(r.v[2]), " is not counter-clockwise");
    RegionId home = kOutside;
    if (!ghost) {
      const auto floorThird = [](std::int64_t s) { return static_cast<std::int32_t>((s - ((s % 3) + 3) % 3) / 3); };
      home = partition.regionAt(
          {floorThird(at(r.v[0]).x + at(r.v[1]).x + at(r.v[2]).x), floorThird(at(r.v[0]).z + at(r.v[1]).z + at(r.v[2]).z)});
    }
    if (home != mesh.regionOf(t)) fault("triangle ", t, " filed under ", mesh.regionOf(t), ", its centroid is in ", home);
  }
  for (VertexId v : vertices) {
    if (!used.count(v)) fault("vertex ", show(v), " has no triangle");
    const P p = at(v);
    if (!places.insert((static_cast<std::uint64_t>(p.x) << 32) ^ (static_cast<std::uint64_t>(p.z) & 0xffffffffu)).second)
      fault("two vertices at ", show(v));
    if (mesh.regionOfVertex(v) != partition.regionAt({mesh.vertex(v).x, mesh.vertex(v).z}))
      fault("vertex ", show(v), " filed under a wrong region");
    if (mesh.origin(mesh.edgeOf(v)) != v || !mesh.trianglePages().alive(mesh.edgeOf(v) >> 2))
      fault("vertex ", show(v), " names an edge that is not its own");
  }
  if (used.size() != vertices.size() + 1) fault("triangles use ", used.size(), " vertices, ", vertices.size() + 1, " are stored");
  // Euler on the sphere (infinity included): F = 2 V - 4.
  if (all.size() != 2 * (vertices.size() + 1) - 4)
    fault("not one closed surface: ", all.size(), " triangles, ", vertices.size() + 1, " vertices");

  for (const auto& [key, h] : edges) {
    const VertexId a = static_cast<VertexId>(key >> 32), b = static_cast<VertexId>(key);
    const auto back = edges.find((std::uint64_t{b} << 32) | a);
    if (back == edges.end()) {
      fault("edge ", show(a), " ", show(b), " has no other side");
      continue;
    }
    if (mesh.twin(h) != back->second || mesh.twin(back->second) != h) fault("twin links of edge ", show(a), " ", show(b), " do not match");
    if (a > b) continue;
    const VertexId c = mesh.triangle(h >> 2).v[((h & 3) + 2) % 3], d = mesh.triangle(back->second >> 2).v[((back->second & 3) + 2) % 3];
    if (a == kInfinite || b == kInfinite) {
      // Two neighbouring hull edges: the hull must turn left or go straight. Ghost (u, w, infinity): hull runs w -> u inside.
      const VertexId v = a == kInfinite ? b : a;
      const P p = at(v), q = at(c), r = at(d);
      // c and d are the hull neighbours of v; all points lie on one side, so the turn must not be a right one.
      const bool cFirst = edges.count((std::uint64_t{c} << 32) | v) && mesh.isGhost(edges.at((std::uint64_t{c} << 32) | v) >> 2);
      const std::int64_t turn = cFirst ? cross(q, p, r) : cross(r, p, q);
      if (turn > 0) fault("the hull is not convex at ", show(v));
      continue;
    }
    if (c == kInfinite || d == kInfinite) continue;
    const Wide side = circle(at(a), at(b), at(c), at(d));
    if (side > 0) fault("edge ", show(a), " ", show(b), " is not Delaunay");
    if (side == 0) {
      P least = at(a);
      for (VertexId v : {b, c, d})
        if (before(at(v), least)) least = at(v);
      const auto is = [&](VertexId v) { return at(v).x == least.x && at(v).z == least.z; };
      if (!is(a) && !is(b)) fault("cocircular edge ", show(a), " ", show(b), " does not hold the smallest point");
    }
  }
  if (ghosts < 3) fault("a hull of ", ghosts, " edges");
  if (faults > 20) out << "... and " << faults - 20 << " more\n";
  return out.str();
}

std::string verify(const generation::CameraMesh& camera) {
  const refinement::AdaptiveMesh& mesh = camera.mesh();
  std::string wrong = verify(mesh.triangulation(), camera);
  std::set<lattice::Point> fixedPoints;
  const auto look = [&](RegionId region) {
    mesh.triangulation().vertexPages().forEach(region, [&](VertexId v) {
      if (v == kInfinite) return;
      const lattice::Point at = mesh.absolute(mesh.triangulation().vertex(v).point());
      const bool fixed = mesh.isFixed(v);
      if (fixed) fixedPoints.insert(at);
      if (fixed != generation::isGridPoint(camera.tree(), at) && wrong.empty())
        wrong = "the vertex at " + std::to_string(at.x) + " " + std::to_string(at.z) +
                (fixed ? " is fixed, and belongs to no grid" : " may go, and belongs to a grid");
    });
  };
  look(kOutside);
  for (const generation::Leaf* leaf : camera.leaves()) look(leaf->region);
  for (const generation::Leaf* leaf : camera.leaves())
    for (lattice::Point p : generation::gridPoints(leaf->address))
      if (fixedPoints.count(p) == 0 && wrong.empty())
        wrong = "the grid point at " + std::to_string(p.x) + " " + std::to_string(p.z) + " is not in the mesh";
  return wrong;
}

}  // namespace ridgecast::testing_support
