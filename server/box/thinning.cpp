#include "server/box/thinning.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"

namespace ridgecast::box {

using triangulation::orientation;
using triangulation::Point2;
using triangulation::RegionId;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::VertexId;
using triangulation::WriteSet;

namespace {

struct Spare {
  double miss;  // metres
  Point2 at;
  VertexId vertex;
  bool operator<(const Spare& o) const { return miss != o.miss ? miss < o.miss : triangulation::smaller(at, o.at); }
};

// Of the corners' plane, steps.
double heightOf(const Corners& c, Point2 p) {
  const auto area = [&](Point2 a, Point2 b) { return static_cast<double>(orientation(c[0].at, a, b)); };
  return c[0].y + (area(p, c[2].at) * (c[1].y - c[0].y) + area(c[1].at, p) * (c[2].y - c[0].y)) / area(c[1].at, c[2].at);
}

// Metres from the vertex to the mesh without it, which is planned; infinite where it must stay.
double missed(const Triangulation& mesh, VertexId v, WriteSet& set) {
  constexpr double never = std::numeric_limits<double>::infinity();
  if (mesh.plan(v, set) != triangulation::Change::kDone) return never;
  for (TriangleId t : set.star())
    if (mesh.isGhost(t)) return never;
  const Corner here = cornerOf(mesh, v);
  double miss = never;
  set.forEachFill([&](VertexId a, VertexId b, VertexId c) {
    const Corners corners{cornerOf(mesh, a), cornerOf(mesh, b), cornerOf(mesh, c)};
    if (miss == never && triangulation::holds(corners[0].at, corners[1].at, corners[2].at, here.at))
      miss = std::abs(heightOf(corners, here.at) - here.y) * lattice::kMetresPerStep;
  });
  return miss;
}

// Whether the planned triangles keep the error; then `verdicts` has all of them.
bool fit(const Triangulation& mesh, const WriteSet& set, const Judge& judge, std::vector<Worst>& verdicts) {
  verdicts.clear();
  bool good = true;
  set.forEachFill([&](VertexId a, VertexId b, VertexId c) {
    if (!good) return;
    const auto passed = judge.passes({cornerOf(mesh, a), cornerOf(mesh, b), cornerOf(mesh, c)});
    good = passed.has_value();
    if (good) verdicts.push_back(*passed);
  });
  return good;
}

}  // namespace

void thin(Triangulation& mesh, const Regions& regions, std::size_t home, const Judge& judge, float error, Worst* worst) {
  thread_local WriteSet set;
  thread_local std::vector<RegionId> around;
  thread_local std::vector<Spare> spare;
  thread_local std::vector<Worst> verdicts;
  regions.around(home, around);
  set.allow(around);
  spare.clear();
  mesh.vertexPages().forEach(regions[home], [&](VertexId v) {
    if (const double miss = missed(mesh, v, set); miss <= error) spare.push_back({miss, mesh.vertex(v).point(), v});
  });
  std::sort(spare.begin(), spare.end());
  for (const Spare& s : spare) {
    if (missed(mesh, s.vertex, set) > error || !fit(mesh, set, judge, verdicts)) continue;
    expects(mesh.apply(s.vertex, set) == triangulation::Change::kDone, "what was planned can be done");
    set.forEachFilled([&, k = std::size_t{0}](TriangleId t) mutable {
      worst[t] = verdicts[k++];
      mesh.trianglePages().clearFresh(t);
    });
  }
}

}  // namespace ridgecast::box
