#include "tests/bench/rays.h"

#include <algorithm>
#include <cmath>

#include "server/pipeline/pipeline.h"

namespace ridgecast::bench {

// Marches every ray of a grid over the picture at once, in batches: steps of a quarter of the gap, then bisection.
std::vector<Hit> castRays(const terrain::Terrain& terrain, const camera::Camera& camera, int across) {
  const int down = across * static_cast<int>(camera.projection.height) / static_cast<int>(camera.projection.width);
  const camera::Vec3 f = camera::forward(camera.pose), r = camera::right(camera.pose), u = camera::up(camera.pose);
  const double ty = std::tan(camera.projection.verticalFov / 2), tx = ty * camera.projection.aspect();
  const double perRadian = camera::pixelsPerRadian(camera.projection);
  struct Ray {
    camera::Vec3 d;
    double t, before;
    int bisections;
  };
  std::vector<Ray> rays;
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i) {
      const double a = tx * (2 * (i + 0.5) / across - 1), b = ty * (1 - 2 * (j + 0.5) / down);
      camera::Vec3 d{f.x + a * r.x + b * u.x, f.y + a * r.y + b * u.y, f.z + a * r.z + b * u.z};
      const double length = std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
      rays.push_back({{d.x / length, d.y / length, d.z / length}, 0.5, 0, -1});
    }
  std::vector<Hit> hits;
  std::vector<lattice::Step> x, z;
  std::vector<float> y;
  while (!rays.empty()) {
    x.resize(rays.size());
    z.resize(rays.size());
    y.resize(rays.size());
    for (std::size_t k = 0; k < rays.size(); ++k) {
      x[k] = camera.pose.x + std::llround(rays[k].d.x * rays[k].t * 256);
      z[k] = camera.pose.z + std::llround(rays[k].d.z * rays[k].t * 256);
    }
    terrain.heights(x, z, y);
    std::size_t kept = 0;
    for (std::size_t k = 0; k < rays.size(); ++k) {
      Ray ray = rays[k];
      const double gap = camera.pose.y + ray.d.y * ray.t - y[k];
      if (ray.bisections < 0 && gap > 0) {
        ray.before = ray.t;
        ray.t += std::max(0.25 * gap, 0.2 * ray.t / perRadian);
        if (ray.t < 20'000 && !(ray.d.y > 0 && gap > 4000)) rays[kept++] = ray;
        continue;
      }
      if (ray.bisections < 0) ray.bisections = 14;
      // [before, t] holds the surface.
      if (ray.bisections == 0) {
        const double flat = std::hypot(ray.d.x, ray.d.z);
        hits.push_back({{x[k], z[k]}, y[k], perRadian * flat / ray.t, ray.t});
        continue;
      }
      const double step = (ray.t - ray.before) / 2;
      if (gap > 0)
        ray.before = ray.t, ray.t += step;
      else
        ray.t = ray.before + step;
      --ray.bisections;
      rays[kept++] = ray;
    }
    rays.resize(kept);
  }
  return hits;
}

Settled settle(const std::shared_ptr<const terrain::Terrain>& terrain, const camera::Camera& camera, const std::vector<Hit>& hits,
               wire::Metric metric, double threshold) {
  scheduling::Machine machine(2);
  wire::Settings asked;
  asked.metric = metric;
  asked.threshold = threshold;
  asked.triangleBudget = 2'000'000;
  pipeline::Pipeline pipeline(terrain, pipeline::grant(asked, {}), machine.makePool(2));
  Settled out{};
  std::uint64_t heights = 0, inserted = 0;
  for (int n = 0; n < 300 && !pipeline.settled(); ++n) {
    const auto figures = pipeline.iterate(camera);
    out.triangles = figures.triangles;
    if (n == 0) continue;  // the grids
    heights += figures.heights;
    inserted += figures.inserted;
  }
  out.heightsPerVertex = static_cast<double>(heights) / static_cast<double>(inserted);
  // The mesh as a client holds it: every triangle of every leaf over a table of buckets, so that no code of the engine answers.
  struct Tri {
    double x[3], z[3], y[3];
  };
  std::vector<Tri> triangles;
  for (const auto& leaf : pipeline.leaves()) {
    const auto mesh = pipeline.extract(leaf.address);
    for (const auto& t : mesh.triangles) {
      Tri tri;
      for (int k = 0; k < 3; ++k) {
        tri.x[k] = static_cast<double>(leaf.address.x() - camera.pose.x + mesh.vertices[t[k]].x);
        tri.z[k] = static_cast<double>(leaf.address.z() - camera.pose.z + mesh.vertices[t[k]].z);
        tri.y[k] = mesh.vertices[t[k]].y;
      }
      triangles.push_back(tri);
    }
  }
  // Hits sorted by x; each triangle looks at those in its span.
  std::vector<std::pair<double, std::size_t>> byX;
  for (std::size_t k = 0; k < hits.size(); ++k) byX.push_back({static_cast<double>(hits[k].point.x - camera.pose.x), k});
  std::sort(byX.begin(), byX.end());
  std::vector<double> height(hits.size(), NAN);
  for (const Tri& t : triangles) {
    const auto [x0, x1] = std::minmax({t.x[0], t.x[1], t.x[2]});
    const auto [z0, z1] = std::minmax({t.z[0], t.z[1], t.z[2]});
    for (auto it = std::lower_bound(byX.begin(), byX.end(), std::pair<double, std::size_t>{x0, 0}); it != byX.end() && it->first <= x1;
         ++it) {
      const double px = it->first, pz = static_cast<double>(hits[it->second].point.z - camera.pose.z);
      if (pz < z0 || pz > z1) continue;
      double w[3];
      double area = 0;
      for (int k = 0; k < 3; ++k) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        w[k] = (t.z[b] - t.z[a]) * (px - t.x[a]) - (t.x[b] - t.x[a]) * (pz - t.z[a]);
        w[k] = -w[k];
        area += w[k];
      }
      if (w[0] < 0 || w[1] < 0 || w[2] < 0) {
        if (w[0] > 0 || w[1] > 0 || w[2] > 0) continue;
      }
      height[it->second] = (w[0] * t.y[0] + w[1] * t.y[1] + w[2] * t.y[2]) / area / 256;
    }
  }
  for (std::size_t k = 0; k < hits.size(); ++k) {
    if (!(height[k] == height[k])) continue;
    out.pixels.push_back(std::abs(height[k] - hits[k].y) * hits[k].pixels);
    out.distance.push_back(hits[k].distance);
  }
  return out;
}

double percentile(std::vector<double> v, double p) {
  if (v.empty()) return NAN;
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(p * static_cast<double>(v.size() - 1))];
}

double mean(const std::vector<double>& v) {
  double sum = 0;
  for (double x : v) sum += x;
  return sum / static_cast<double>(v.size());
}

}  // namespace ridgecast::bench
