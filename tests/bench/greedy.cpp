// Triangles against greedy insertion (Garland and Heckbert 1995) on the same square at the same root-mean-square error. The reference
// inserts, one at a time, the sample of a dense grid that is worst in all the mesh; the engine's way chooses one candidate a triangle and
// inserts those above a falling threshold. Both errors are measured on the same grid.
#include <algorithm>
#include <cmath>
#include <memory>
#include <queue>
#include <stdexcept>

#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/refinement/adaptive_mesh.h"
#include "server/refinement/triangle.h"
#include "tests/bench/bench.h"
#include "tests/bench/whole.h"

namespace ridgecast::bench {
namespace {

using namespace triangulation;

// Samples at the points of a grid of (n + 1)^2, `step` steps apart.
struct Field {
  Field(const terrain::Terrain& terrain, int count, int spacing, lattice::Point corner) : n(count), step(spacing) {
    std::vector<lattice::Step> x, z;
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i) {
        x.push_back(corner.x + i * step);
        z.push_back(corner.z + j * step);
      }
    y.resize(x.size());
    terrain.heightSteps(x, z, y);
  }
  std::int32_t at(int i, int j) const { return y[static_cast<std::size_t>(j) * (n + 1) + i]; }
  int n, step;
  std::vector<std::int32_t> y;
};

// A triangulation against the samples.
struct Sampled {
  // f(i, j, error) for every sample whose triangle is t (edges count for both sides).
  template <class F>
  void scan(TriangleId t, F&& f) const {
    const auto& v = mesh.triangle(t).v;
    const Point2 p[3] = {mesh.vertex(v[0]).point(), mesh.vertex(v[1]).point(), mesh.vertex(v[2]).point()};
    const auto [x0, x1] = std::minmax({p[0].x, p[1].x, p[2].x});
    const auto [z0, z1] = std::minmax({p[0].z, p[1].z, p[2].z});
    for (int j = (z0 + field.step - 1) / field.step; j * field.step <= z1; ++j)
      for (int i = (x0 + field.step - 1) / field.step; i * field.step <= x1; ++i) {
        const Point2 q{i * field.step, j * field.step};
        if (!holds(p[0], p[1], p[2], q)) continue;
        f(i, j, std::abs(refinement::heightOnTriangle(mesh, t, q) - field.at(i, j)));
      }
  }
  template <class F>
  void forEach(F&& f) const {
    mesh.trianglePages().forEach(region, [&](TriangleId t) {
      if (!mesh.isGhost(t)) f(t);
    });
  }
  double rms() const {
    std::vector<float> error(field.y.size(), 0);
    forEach([&](TriangleId t) {
      scan(t, [&](int i, int j, double e) { error[static_cast<std::size_t>(j) * (field.n + 1) + i] = static_cast<float>(e); });
    });
    double sum = 0;
    for (float e : error) sum += double(e) * e;
    return std::sqrt(sum / static_cast<double>(error.size())) / 256;
  }
  std::uint32_t triangles() const { return mesh.liveTriangles(); }

  const Field& field;
  const Triangulation& mesh;
  RegionId region;
};

constexpr Square kSquare{-(1 << 24), -(1 << 24), 1 << 25};

struct Mesh {
  Mesh(const Field& f, std::uint32_t room) : mesh(room, whole), sampled{f, mesh, mesh.addRegion(kSquare)} {
    whole.region = sampled.region;
    all.allowAll();
    const auto v = [&](int i, int j) { return Vertex{i * f.step, j * f.step, f.at(i, j), kNoEdge}; };
    mesh.start(v(0, 0), v(f.n, 0), v(0, f.n));
    const Vertex last = v(f.n, f.n);
    if (mesh.insert(last, mesh.locate(last.point(), mesh.anyTriangle(), all), all) != Change::kDone)
      throw std::runtime_error("a point was refused");
  }
  Whole whole;
  Triangulation mesh;
  Sampled sampled;
  WriteSet all;
};

// Garland and Heckbert's algorithm III: a heap of each triangle's worst sample.
std::uint32_t greedyTriangles(const Field& field, std::uint32_t most, double rms) {
  Mesh m(field, most);
  struct Worst {
    double error;
    TriangleId t;
    std::uint64_t stamp;
    int i, j;
    bool operator<(const Worst& o) const { return error < o.error; }
  };
  std::priority_queue<Worst> heap;
  std::vector<std::uint64_t> stamp(m.mesh.triangleCapacity(), 0);
  std::uint64_t clock = 0;
  const auto look = [&](TriangleId t) {
    Worst w{0, t, ++clock, 0, 0};
    m.sampled.scan(t, [&](int i, int j, double e) {
      if (e > w.error) w.error = e, w.i = i, w.j = j;
    });
    stamp[t] = w.stamp;
    if (w.error > 0) heap.push(w);
  };
  const auto lookFresh = [&] {
    std::vector<TriangleId> fresh;
    m.mesh.trianglePages().forEachFresh(m.whole.region, [&](TriangleId t) { fresh.push_back(t); });
    for (TriangleId t : fresh) {
      m.mesh.trianglePages().clearFresh(t);
      if (!m.mesh.isGhost(t)) look(t);
    }
  };
  // forEachFresh walks all pages: look around the new vertex instead.
  lookFresh();
  std::uint32_t next = 1000;
  while (!heap.empty()) {
    const Worst w = heap.top();
    heap.pop();
    if (stamp[w.t] != w.stamp || !m.mesh.trianglePages().alive(w.t)) continue;
    VertexId v;
    if (m.mesh.insert({w.i * field.step, w.j * field.step, field.at(w.i, w.j), kNoEdge}, w.t, m.all, &v) != Change::kDone) continue;
    const HalfEdge first = m.mesh.edgeOf(v);
    for (HalfEdge h = first;;) {
      m.mesh.trianglePages().clearFresh(h >> 2);
      if (!m.mesh.isGhost(h >> 2)) look(h >> 2);
      h = m.mesh.twin(Triangulation::previous(h));
      if (h == first) break;
    }
    if (m.sampled.triangles() >= next) {
      if (m.sampled.rms() <= rms) break;
      next += next / 50;
    }
  }
  return m.sampled.triangles();
}

}  // namespace

Report greedy(const Options& options) {
  const auto terrain = terrain::create("alpine", 1).value();
  const int n = options.quick ? 256 : 1024;
  const Field field(*terrain, n, 512, {0, 0});  // 2 m apart: 2 km
  const std::uint32_t target = options.quick ? 4000 : 40000;

  // The engine's way: its own candidates, all above a falling threshold, in rounds.
  Whole whole;
  refinement::AdaptiveMesh mesh(terrain, 4 * target, refinement::Metric::kPixels, whole);
  whole.region = mesh.addRegion(kSquare, 0);
  const Sampled m{field, mesh.triangulation(), whole.region};
  const auto corner = [&](int i, int j) { return refinement::GridPoint{{i * field.step, j * field.step}, field.at(i, j)}; };
  mesh.start(corner(0, 0), corner(n, 0), corner(0, n));
  TriangleId hint = mesh.triangulation().anyTriangle();
  mesh.insertGrid(std::vector{corner(n, n)}, hint);
  const refinement::View view({}, {0, 0}, 0, 0, false);
  WriteSet all;
  all.allowAll();
  double threshold = 0;
  mesh.evaluateFresh(whole.region, nullptr);
  m.forEach([&](TriangleId t) { threshold = std::max(threshold, double(mesh.candidate(t).error)); });
  while (m.triangles() < target) {
    std::vector<refinement::Pending> wanted;
    m.forEach([&](TriangleId t) {
      if (const refinement::Candidate c = mesh.candidate(t); c.error >= threshold) wanted.push_back({t, c.point, c.error});
    });
    std::sort(wanted.begin(), wanted.end());
    for (const refinement::Pending& p : wanted) {
      if (m.triangles() >= target) break;
      refinement::Work work;
      work.pending = {p};
      mesh.insertWanted(whole.region, view, all, work);
    }
    mesh.evaluateFresh(whole.region, nullptr);
    if (wanted.size() < 8) threshold *= 0.9;
  }
  const double rms = m.rms();
  const std::uint32_t theirs = greedyTriangles(field, 4 * target, rms);
  Report report;
  report.note("alpine, a square of " + std::to_string(2 * n) + " m, samples 2 m apart");
  report.add("triangle_ratio", static_cast<double>(m.triangles()) / theirs, "of greedy insertion's triangles");
  report.add("triangles", m.triangles());
  report.add("greedy_triangles", theirs);
  report.add("rms_m", rms, "m, of both");
  return report;
}

}  // namespace ridgecast::bench
