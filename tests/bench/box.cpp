// The mesh of a box against greedy insertion (Garland and Heckbert 1995), on a map of 1,025 x 1,025 posts, 4 m apart, taken from alpine: at
// four errors, on one thread and on all. Triangles are compared at the same largest error over the posts. Then a square kilometre of alpine
// itself at half a metre, and 8 x 8 km at 2 m.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <queue>
#include <stdexcept>

#include "common/raster/raster_terrain.h"
#include "common/terrain/terrain.h"
#include "common/text/text.h"
#include "common/triangulation/triangulation.h"
#include "server/box/box_mesh.h"
#include "server/scheduling/pool.h"
#include "tests/bench/bench.h"
#include "tests/bench/whole.h"

namespace ridgecast::bench {
namespace {

using namespace triangulation;

constexpr int kStep = 1024;  // between posts, steps

struct Posts {
  int n;  // intervals along a side
  std::vector<float> height;
  float at(int i, int j) const {
    return height[static_cast<std::size_t>(j) * (static_cast<std::size_t>(n) + 1) + static_cast<std::size_t>(i)];
  }
};

// f(i, j, error) for the posts in the triangle, row by row.
template <class F>
void scan(const Posts& posts, Point2 a, Point2 b, Point2 c, const std::array<float, 3>& y, F&& f) {
  const double area = static_cast<double>(orientation(a, b, c));
  const double gx = (double(b.z - a.z) * (y[2] - y[0]) * -1 + double(c.z - a.z) * (y[1] - y[0])) / -area,
               gz = (double(b.x - a.x) * (y[2] - y[0]) - double(c.x - a.x) * (y[1] - y[0])) / -area;
  const auto [z0, z1] = std::minmax({a.z, b.z, c.z});
  const Point2 p[3] = {a, b, c};
  for (int j = z0; j <= z1; ++j) {
    double low = -1e9, high = 1e9;
    for (int k = 0; k < 3; ++k) {
      const Point2 &u = p[k], &v = p[(k + 1) % 3];
      if (u.z == v.z) continue;
      const double at = u.x + double(v.x - u.x) * (j - u.z) / (v.z - u.z);
      if (v.z > u.z)
        low = std::max(low, at);
      else
        high = std::min(high, at);
    }
    const int i1 = static_cast<int>(std::floor(high));
    const double row = y[0] + gz * (j - a.z) - gx * a.x;
    for (int i = static_cast<int>(std::ceil(low)); i <= i1; ++i) f(i, j, std::abs(static_cast<float>(row + gx * i) - posts.at(i, j)));
  }
}

// Of one thread, whatever else the machine does.
double processorSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

// Garland and Heckbert's algorithm III: a heap of each triangle's worst post. Unit of the mesh: a post's distance.
struct Greedy {
  std::uint32_t triangles = 0;
  double seconds = 0, processor = 0;
};
Greedy greedyBox(const Posts& posts, double error, std::uint32_t most) {
  const Clock clock;
  const double before = processorSeconds();
  Whole whole;
  Triangulation mesh(most, whole);
  whole.region = mesh.addRegion({-(1 << 24), -(1 << 24), 1 << 25});
  WriteSet all;
  all.allowAll();
  const auto vertex = [&](int i, int j) {
    return Vertex{i, j, static_cast<std::int32_t>(std::lround(double(posts.at(i, j)) * 256)), kNoEdge};
  };
  const auto height = [&](VertexId v) {
    const Point2 p = mesh.vertex(v).point();
    return posts.at(p.x, p.z);
  };
  mesh.start(vertex(0, 0), vertex(0, posts.n), vertex(posts.n, posts.n));
  struct Worst {
    float error;
    TriangleId t;
    int i, j;
    bool operator<(const Worst& o) const { return error < o.error; }
  };
  std::priority_queue<Worst> heap;
  std::vector<Worst> worst(mesh.triangleCapacity());
  const auto look = [&](TriangleId t) {
    if (mesh.isGhost(t)) return;
    const auto& v = mesh.triangle(t).v;
    Worst w{0, t, 0, 0};
    scan(posts, mesh.vertex(v[0]).point(), mesh.vertex(v[1]).point(), mesh.vertex(v[2]).point(), {height(v[0]), height(v[1]), height(v[2])},
         [&](int i, int j, float e) {
           if (e > w.error) w = {e, t, i, j};
         });
    worst[t] = w;
    if (w.error > error) heap.push(w);
  };
  const auto lookAround = [&](VertexId v) { mesh.forEachAround(v, [&](HalfEdge h) { look(h >> 2); }); };
  VertexId made;
  const Vertex last = vertex(posts.n, 0);
  mesh.insert(last, mesh.locate(last.point(), mesh.anyTriangle(), all), all, &made);
  std::vector<TriangleId> first;
  mesh.trianglePages().forEach(whole.region, [&](TriangleId t) { first.push_back(t); });
  for (TriangleId t : first) look(t);
  while (!heap.empty()) {
    const Worst w = heap.top();
    heap.pop();
    const Worst& now = worst[w.t];
    if (!mesh.trianglePages().alive(w.t) || now.i != w.i || now.j != w.j || now.error != w.error) continue;
    if (mesh.insert(vertex(w.i, w.j), w.t, all, &made) == Change::kDone) lookAround(made);
  }
  return {mesh.liveTriangles(), clock.seconds(), processorSeconds() - before};
}

// The mesh's largest error over the posts.
double worstAtPosts(const Posts& posts, const box::BoxMesh& mesh) {
  double worst = 0;
  for (const mesh::LeafMesh& leaf : mesh.leaves)
    for (const mesh::Triangle& t : leaf.triangles) {
      const auto &a = leaf.vertices[t[0]], &b = leaf.vertices[t[1]], &c = leaf.vertices[t[2]];
      const double area = double(std::int64_t{b.z - a.z} * (c.x - a.x) - std::int64_t{b.x - a.x} * (c.z - a.z));
      const auto bound = [](lattice::Step v) { return static_cast<int>((v + kStep - 1) >> 10); };
      const lattice::Step x0 = leaf.address.x(), z0 = leaf.address.z();
      for (int j = bound(z0 + std::min({a.z, b.z, c.z})); (j << 10) <= z0 + std::max({a.z, b.z, c.z}); ++j)
        for (int i = bound(x0 + std::min({a.x, b.x, c.x})); (i << 10) <= x0 + std::max({a.x, b.x, c.x}); ++i) {
          const double px = double((i << 10) - x0) - a.x, pz = double((j << 10) - z0) - a.z;
          const double wb = (pz * (c.x - a.x) - px * (c.z - a.z)) / area, wc = (px * (b.z - a.z) - pz * (b.x - a.x)) / area;
          if (wb < 0 || wc < 0 || wb + wc > 1) continue;
          const double y = (a.y + wb * (double(b.y) - a.y) + wc * (double(c.y) - a.y)) / 256;
          worst = std::max(worst, std::abs(y - posts.at(i + posts.n / 2, j + posts.n / 2)));
        }
    }
  return worst;
}

struct Run {
  box::BoxMesh mesh;
  double seconds, processor;
};
Run meshed(const terrain::Terrain& terrain, double side, double error, unsigned threads) {
  scheduling::Executor executor(threads);
  const auto pool = executor.makePool(threads);
  const auto half = static_cast<lattice::Step>(side / 2 * lattice::kStepsPerMetre);
  const box::Watch watch{{}, std::chrono::steady_clock::now() + std::chrono::minutes(5), 300};
  const Clock clock;
  const double before = processorSeconds();
  auto made = box::meshBox(terrain, {{-half, -half}, {half, half}, error}, 4'000'000, *pool, watch);
  if (!made) throw std::runtime_error(made.error().message);
  return {std::move(*made), clock.seconds(), processorSeconds() - before};
}

}  // namespace

Report box(const Options& options) {
  const auto alpine = terrain::create("alpine", 1).value();
  const int n = options.quick ? 256 : 1024;
  Posts posts{n, {}};
  const std::filesystem::path file = std::filesystem::temp_directory_path() / ("ridgecast-bench-" + std::to_string(getpid()) + ".r16");
  {
    std::vector<lattice::Step> x, z;
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i) {
        x.push_back((i - n / 2) * kStep);
        z.push_back((j - n / 2) * kStep);
      }
    posts.height.resize(x.size());
    alpine->heights(x, z, posts.height);
    std::ofstream out(file, std::ios::binary);
    for (float& h : posts.height) {
      const auto sample = static_cast<std::uint16_t>(std::lround(h * 16));
      out.put(static_cast<char>(sample & 255)).put(static_cast<char>(sample >> 8));
      h = static_cast<float>(sample) / 16;
    }
  }
  raster::RasterOptions how;
  how.pitch = 4;
  how.scale = 1.0 / 16;
  const auto map = raster::loadRaster(file, how, 1);
  std::filesystem::remove(file);
  if (!map) throw std::runtime_error(map.error().message);

  Report report;
  report.note("a map of " + std::to_string(n + 1) + " x " + std::to_string(n + 1) +
              " posts 4 m apart, from alpine; reference: Garland and Heckbert's algorithm III over the posts");
  double worstOne = 0, worstAll = 0, worstTriangles = 0;
  for (const double error : {9.24, 3.70, 1.85, 0.92}) {
    const std::string at = "_" + text::rounded(error, 3);
    progress("box: " + text::rounded(error, 3) + " m");
    const Run one = meshed(**map, 4.0 * n, error, 1), all = meshed(**map, 4.0 * n, error, 0);
    const double reached = worstAtPosts(posts, one.mesh);
    const Greedy same = greedyBox(posts, error, 4'000'000), equal = greedyBox(posts, reached, 4'000'000);
    report.add("seconds_1" + at, one.processor, "s");
    report.add("seconds_all" + at, all.seconds, "s");
    report.add("greedy_seconds" + at, same.processor, "s");
    report.add("triangles" + at, one.mesh.triangles);
    report.add("greedy_triangles" + at, same.triangles);
    report.add("worst_at_posts" + at, reached, "m");
    report.add("triangle_ratio" + at, static_cast<double>(one.mesh.triangles) / equal.triangles);
    report.add("samples" + at, static_cast<double>(one.mesh.samples));
    worstOne = std::max(worstOne, one.processor / same.processor);
    worstAll = std::max(worstAll, all.seconds / same.seconds);
    worstTriangles = std::max(worstTriangles, static_cast<double>(one.mesh.triangles) / equal.triangles);
  }
  report.add("time_ratio_1", worstOne);
  report.add("time_ratio_all", worstAll);
  report.add("triangle_ratio", worstTriangles);
  const Run km2 = meshed(*alpine, options.quick ? 250 : 1000, 0.5, 0);
  report.add("alpine_km2_s", km2.seconds, "s");
  report.add("alpine_km2_triangles", km2.mesh.triangles);
  report.add("samples_per_triangle", static_cast<double>(km2.mesh.samples) / km2.mesh.triangles);
  const Run wide = meshed(*alpine, options.quick ? 1000 : 8000, 2, 0);
  report.add("alpine_64km2_s", wide.seconds, "s");
  report.add("alpine_64km2_triangles", wide.mesh.triangles);
  report.add("alpine_64km2_samples", static_cast<double>(wide.mesh.samples));
  return report;
}

}  // namespace ridgecast::bench
