#include "tests/support/rays.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <unordered_map>

namespace ridgecast::testing_support {

namespace {
constexpr double kReach = 20'000;  // metres
}

std::vector<Hit> castRays(const terrain::Terrain& terrain, const camera::Camera& camera, int across) {
  const int down = across * static_cast<int>(camera.projection.height) / static_cast<int>(camera.projection.width);
  const camera::Vec3 f = camera::forward(camera.pose), r = camera::right(camera.pose), u = camera::up(camera.pose);
  const double ty = std::tan(camera.projection.verticalFov / 2), tx = ty * camera.projection.aspect();
  std::vector<camera::Vec3> directions;
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i) {
      const double a = tx * (2 * (i + 0.5) / across - 1), b = ty * (1 - 2 * (j + 0.5) / down);
      const camera::Vec3 d{f.x + a * r.x + b * u.x, f.y + a * r.y + b * u.y, f.z + a * r.z + b * u.z};
      const double length = std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
      directions.push_back({d.x / length, d.y / length, d.z / length});
    }
  return castRays(terrain, camera, directions, 1);
}

// Marches all rays at once, in batches: steps of an eighth of the gap, at most four pixels so that a fence before an abyss is met, then
// bisection.
std::vector<Hit> castRays(const terrain::Terrain& terrain, const camera::Camera& camera, const std::vector<camera::Vec3>& directions,
                          double finer) {
  const double perRadian = camera::pixelsPerRadian(camera.projection);
  struct Ray {
    camera::Vec3 d;
    double t = 0.05, before = 0;
    std::size_t number = 0;
    int bisections = -1;
  };
  std::vector<Ray> rays;
  for (const camera::Vec3& d : directions) rays.push_back({.d = d, .number = rays.size()});
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
        ray.t += std::max(std::min(gap / 8, 4 * ray.t / perRadian), 0.2 * ray.t / perRadian) / finer;
        if (ray.t < kReach && !(ray.d.y > 0 && gap > 4000)) rays[kept++] = ray;
        continue;
      }
      if (ray.bisections < 0) ray.bisections = 14;
      // [before, t] holds the surface.
      if (ray.bisections == 0) {
        const double flat = std::hypot(ray.d.x, ray.d.z);
        hits.push_back({{x[k], z[k]}, y[k], perRadian * flat / ray.t, ray.t, ray.d, ray.number});
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

HeldMesh::HeldMesh(const pipeline::Pipeline& pipeline) {
  for (const auto& leaf : pipeline.leaves()) leaves_.push_back(pipeline.extract(leaf.address));
}

std::vector<HeldMesh::Height> HeldMesh::at(const std::vector<Hit>& hits) const {
  // Triangles stand out of their leaf's square by less than half a side: each leaf looks at the hits in the cells of its own size around
  // it.
  std::vector<Height> heights(hits.size());
  std::unordered_map<lattice::LeafAddress, std::vector<std::size_t>, lattice::LeafAddressHash> cells;
  int least = lattice::kMaxLevel, most = 0;
  for (const auto& leaf : leaves_) least = std::min(least, leaf.address.level), most = std::max(most, leaf.address.level);
  for (int level = least; level <= most; ++level)
    for (std::size_t k = 0; k < hits.size(); ++k) cells[lattice::leafAt(hits[k].point, level)].push_back(k);
  struct Place {
    double x, z;
    std::size_t hit;
  };
  std::vector<Place> near;
  for (const auto& leaf : leaves_) {
    near.clear();
    const lattice::LeafAddress a = leaf.address;
    for (std::int64_t i = a.i - 1; i <= a.i + 1; ++i)
      for (std::int64_t j = a.j - 1; j <= a.j + 1; ++j)
        if (const auto cell = cells.find({a.level, i, j}); cell != cells.end())
          for (const std::size_t k : cell->second)
            near.push_back({static_cast<double>(hits[k].point.x - a.x()), static_cast<double>(hits[k].point.z - a.z()), k});
    if (near.empty()) continue;
    std::sort(near.begin(), near.end(), [](const Place& l, const Place& r) { return l.x < r.x; });
    for (const auto& t : leaf.triangles) {
      const auto &p = leaf.vertices[t[0]], &q = leaf.vertices[t[1]], &r = leaf.vertices[t[2]];
      const double x[3] = {double(p.x), double(q.x), double(r.x)}, z[3] = {double(p.z), double(q.z), double(r.z)},
                   y[3] = {double(p.y), double(q.y), double(r.y)};
      const auto [x0, x1] = std::minmax({x[0], x[1], x[2]});
      const auto [z0, z1] = std::minmax({z[0], z[1], z[2]});
      auto place = std::lower_bound(near.begin(), near.end(), x0, [](const Place& l, double from) { return l.x < from; });
      for (; place != near.end() && place->x <= x1; ++place) {
        if (place->z < z0 || place->z > z1) continue;
        double weight[3], area = 0, height = 0;
        bool inside = true;
        for (int k = 0; k < 3; ++k) {
          const int b = (k + 1) % 3, c = (k + 2) % 3;
          weight[k] = (x[c] - x[b]) * (place->z - z[b]) - (z[c] - z[b]) * (place->x - x[b]);
          area += weight[k];
          height += weight[k] * y[k];
        }
        for (const double w : weight) inside = inside && w * area >= 0;
        if (inside) heights[place->hit] = {height / area / 256, a.level};
      }
    }
  }
  return heights;
}

namespace {

// What is left of an error where the ground jumps within one place of the lattice: by how much the mesh's height lies outside what the
// ground has there. Vertices cannot lie between places.
std::vector<double> besideJumps(const terrain::Terrain& terrain, const std::vector<Hit>& hits, const std::vector<HeldMesh::Height>& held) {
  constexpr int kAcross = 5;  // places looked at, each way
  std::vector<lattice::Step> x, z;
  for (std::size_t k = 0; k < hits.size(); ++k) {
    const double spacing = static_cast<double>(lattice::Step{1} << lattice::horizontalBits(held[k].level));
    for (int j = 0; j < kAcross; ++j)
      for (int i = 0; i < kAcross; ++i) {
        x.push_back(hits[k].point.x + std::llround(spacing * (2.0 * i / (kAcross - 1) - 1)));
        z.push_back(hits[k].point.z + std::llround(spacing * (2.0 * j / (kAcross - 1) - 1)));
      }
  }
  std::vector<float> y(x.size());
  terrain.heights(x, z, y);
  std::vector<double> left;
  for (std::size_t k = 0; k < hits.size(); ++k) {
    const auto first = y.begin() + static_cast<std::ptrdiff_t>(k * kAcross * kAcross);
    const auto [low, high] = std::minmax_element(first, first + kAcross * kAcross);
    left.push_back(std::max({0.0, *low - held[k].y, held[k].y - *high}) * hits[k].pixels);
  }
  return left;
}

}  // namespace

ScreenError errorOnScreen(const pipeline::Pipeline& pipeline, const terrain::Terrain& terrain, const camera::Camera& camera,
                          double threshold, int across) {
  ScreenError out;
  const HeldMesh mesh(pipeline);
  std::vector<double> pixels;
  std::vector<camera::Vec3> again;
  const auto error = [](const HeldMesh::Height& held, const Hit& hit) { return std::abs(held.y - hit.y) * hit.pixels; };
  const std::vector<Hit> hits = castRays(terrain, camera, across);
  const auto held = mesh.at(hits);
  for (std::size_t k = 0; k < hits.size(); ++k) {
    const double e = error(held[k], hits[k]);
    if (std::isnan(e)) continue;
    if (e > 1.2 * threshold)
      again.push_back(hits[k].direction);  // a coarse march may step through an edge and meet what is hidden
    else
      pixels.push_back(e);
  }
  const std::vector<Hit> sure = castRays(terrain, camera, again, 16);
  const auto sureHeld = mesh.at(sure);
  const auto left = besideJumps(terrain, sure, sureHeld);
  for (std::size_t k = 0; k < sure.size(); ++k) {
    const double e = error(sureHeld[k], sure[k]);
    if (std::isnan(e)) continue;
    const bool jump = left[k] <= threshold && e > 2 * threshold;
    out.jumps += jump;
    if (jump) out.mostAtJump = std::max(out.mostAtJump, e);
    pixels.push_back(jump ? left[k] : e);
    if (pixels.back() >= out.most) {
      out.most = pixels.back();
      char line[200];
      std::snprintf(line, sizeof line, "%.2f px at %.2f m, x %.2f z %.2f, true %.2f mesh %.2f, level %d", out.most, sure[k].distance,
                    static_cast<double>(sure[k].point.x) / 256, static_cast<double>(sure[k].point.z) / 256, sure[k].y, sureHeld[k].y,
                    sureHeld[k].level);
      out.worst = line;
    }
  }
  out.rays = pixels.size();
  if (pixels.empty()) return out;
  std::sort(pixels.begin(), pixels.end());
  out.p99 = pixels[static_cast<std::size_t>(0.99 * static_cast<double>(pixels.size() - 1))];
  out.most = pixels.back();
  return out;
}

}  // namespace ridgecast::testing_support
