#include "client/core/mesh/mesh_ground.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::core {

namespace {

double boundOf(const HeldLeaf& leaf) { return leaf.error > 0 ? leaf.error : std::numeric_limits<double>::infinity(); }

struct Vec {
  double x, y, z;
};
Vec operator-(const Vec& a, const Vec& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vec cross(const Vec& a, const Vec& b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
double dot(const Vec& a, const Vec& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

}  // namespace

std::optional<MeshHeight> heightOf(const Scene& scene, lattice::Point at) {
  const auto place = scene.locate(at);
  if (!place) return std::nullopt;
  const auto vec = [](const mesh::LocalVertex& v) { return Vec{double(v.x), double(v.y), double(v.z)}; };
  const auto& [a, b, c] = place->corners;
  const Vec n = cross(vec(b) - vec(a), vec(c) - vec(a));
  const double length = std::sqrt(dot(n, n));
  return MeshHeight{place->height, boundOf(*place->leaf), n.x / length, n.y / length, n.z / length};
}

std::optional<MeshHit> cast(const Scene& scene, const ground::Ray& ray) {
  // In steps, relative to the ray's origin.
  Vec d{ray.directionX, ray.directionY, ray.directionZ};
  const double most = std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)});
  expects(most > 0, "a ray has a direction");
  d = {d.x / most, d.y / most, d.z / most};
  const double length = std::sqrt(dot(d, d));
  d = {d.x / length, d.y / length, d.z / length};
  const double originY = ray.y * lattice::kStepsPerMetre;
  double nearest = ray.reach * lattice::kStepsPerMetre;
  std::optional<MeshHit> hit;
  for (const auto& [address, leaf] : scene.index()) {
    if (leaf.triangles == 0) continue;
    const Vec corner{static_cast<double>(address.x() - ray.x), 0, static_cast<double>(address.z() - ray.z)};
    const auto vec = [&](const mesh::LocalVertex& v) { return Vec{corner.x + v.x, v.y - originY, corner.z + v.z}; };
    // Slabs of the leaf's box.
    const Vec low = vec(leaf.low), high = vec(leaf.high);
    double from = 0, to = nearest;
    const std::array<std::array<double, 3>, 3> slabs{{{d.x, low.x, high.x}, {d.y, low.y, high.y}, {d.z, low.z, high.z}}};
    for (const auto& [direction, least, greatest] : slabs) {
      if (direction == 0) {
        if (least > 0 || greatest < 0) to = -1;
        continue;
      }
      from = std::max(from, std::min(least / direction, greatest / direction));
      to = std::min(to, std::max(least / direction, greatest / direction));
    }
    if (from > to) continue;
    const mesh::LeafMesh& made = *scene.leaf(address)->mesh;
    for (const mesh::Triangle& t : made.triangles) {  // Moeller and Trumbore 1997
      const Vec a = vec(made.vertices[t[0]]), ab = vec(made.vertices[t[1]]) - a, ac = vec(made.vertices[t[2]]) - a;
      const Vec p = cross(d, ac);
      const double determinant = dot(ab, p);
      if (determinant == 0) continue;
      const Vec s{-a.x, -a.y, -a.z};
      const double u = dot(s, p) / determinant;
      if (u < 0 || u > 1) continue;
      const Vec q = cross(s, ab);
      const double v = dot(d, q) / determinant;
      if (v < 0 || u + v > 1) continue;
      const double distance = dot(ac, q) / determinant;
      if (distance < 0 || distance > nearest) continue;
      nearest = distance;
      hit = MeshHit{distance * lattice::kMetresPerStep, boundOf(leaf)};
    }
  }
  return hit;
}

Outcome<Scene> sceneOf(wire::Ground ground) {
  wire::Iteration iteration;
  iteration.number = 1;
  iteration.whole = std::move(ground.leaves);
  Scene scene;
  if (const auto applied = scene.apply(iteration); !applied) return applied.error();
  return scene;
}

}  // namespace ridgecast::core
