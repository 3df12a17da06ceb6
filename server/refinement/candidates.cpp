#include "server/refinement/candidates.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::refinement {

using triangulation::orientation;
using triangulation::Point2;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::Vertex;

Surface::Surface(std::uint32_t triangleCapacity, std::uint32_t vertexCapacity)
    : x(std::make_unique_for_overwrite<std::int32_t[]>(triangleCapacity)),
      z(std::make_unique_for_overwrite<std::int32_t[]>(triangleCapacity)),
      y(std::make_unique_for_overwrite<std::int32_t[]>(triangleCapacity)),
      error(std::make_unique_for_overwrite<float[]>(triangleCapacity)),
      hash(std::make_unique_for_overwrite<std::uint64_t[]>(triangleCapacity)),
      screens(std::make_unique<PageScreen[]>(triangleCapacity / triangulation::Pages::kSlots)),
      hashes(std::make_unique<PageHash[]>(triangleCapacity / triangulation::Pages::kSlots)),
      losses(std::make_unique<PageLosses[]>(vertexCapacity / triangulation::Pages::kSlots)),
      fineY(std::make_unique_for_overwrite<std::int32_t[]>(vertexCapacity)),
      level(std::make_unique_for_overwrite<std::uint8_t[]>(vertexCapacity)),
      mixed(std::make_unique_for_overwrite<std::uint64_t[]>(vertexCapacity)),
      curvature(std::make_unique_for_overwrite<float[]>(vertexCapacity)),
      loss(std::make_unique_for_overwrite<float[]>(vertexCapacity)) {}

namespace {

std::int32_t snapTo(double v, int bits) {
  return static_cast<std::int32_t>(lattice::roundTo(static_cast<lattice::Step>(std::floor(v + 0.5)), bits));
}

// (least height / spacing)^2 from which on snapping is harmless: a fifth of the height is then 1.4 spacings.
constexpr double kRoomy = 49;

// A point that may become a vertex: inside the closed triangle, on no corner.
bool admissible(const Vertex& a, const Vertex& b, const Vertex& c, Point2 p) {
  if (orientation(a.point(), b.point(), p) < 0 || orientation(b.point(), c.point(), p) < 0 || orientation(c.point(), a.point(), p) < 0)
    return false;
  return !(p == a.point()) && !(p == b.point()) && !(p == c.point());
}

struct Trial {
  TriangleId triangle;
  Point2 point;
  float y;         // steps, of the mesh there
};

struct Scratch {
  std::vector<TriangleId> fresh;
  std::vector<Trial> trials;
  std::vector<lattice::Step> x, z;
  std::vector<std::int32_t> y;
};

}  // namespace

double planeHeight(const Vertex& a, const Vertex& b, const Vertex& c, Point2 p) {
  const double bx = double(b.x) - a.x, bz = double(b.z) - a.z, cx = double(c.x) - a.x, cz = double(c.z) - a.z, px = double(p.x) - a.x,
               pz = double(p.z) - a.z;
  const double area = bz * cx - bx * cz;
  const double wb = (pz * cx - px * cz) / area, wc = (bz * px - bx * pz) / area;
  return a.y + wb * (double(b.y) - a.y) + wc * (double(c.y) - a.y);
}

std::uint64_t hashRegion(const Triangulation& mesh, Surface& surface, triangulation::RegionId region) {
  const auto& pages = mesh.trianglePages();
  std::uint64_t sum = 0;
  for (std::uint32_t number : pages.pagesOf(region)) {
    PageHash& page = surface.hashes[number];
    const std::uint64_t alive = pages.aliveMask(number);
    if (page.rehash || page.hashed != alive) {
      page.hash = 0;
      for (std::uint64_t m = alive; m != 0; m &= m - 1)
        page.hash += surface.hash[number * triangulation::Pages::kSlots + static_cast<std::uint32_t>(std::countr_zero(m))];
      page.hashed = alive;
      page.rehash = false;
    }
    sum += page.hash;
  }
  return sum;
}

double heightOnTriangle(const Triangulation& mesh, TriangleId t, Point2 p) {
  const auto& v = mesh.triangle(t).v;
  return planeHeight(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]), p);
}

std::uint64_t evaluateFresh(Triangulation& mesh, Surface& surface, const terrain::Terrain& terrain, triangulation::RegionId region, int level,
                            bool thesis) {
  thread_local Scratch scratch;  // grown once, kept by the worker
  auto& [fresh, trials, px, pz, py] = scratch;
  fresh.clear();
  trials.clear();
  auto& pages = mesh.trianglePages();
  pages.forEachFresh(region, [&](TriangleId t) { fresh.push_back(t); });
  if (fresh.empty()) return 0;
  const int bits = lattice::horizontalBits(level);
  const double spacing2 = std::ldexp(1.0, 2 * bits);
  for (TriangleId t : fresh) {
    pages.clearFresh(t);
    surface.error[t] = 0;
    const auto& v = mesh.triangle(t).v;
    const Vertex &a = mesh.vertex(v[0]), &b = mesh.vertex(v[1]), &c = mesh.vertex(v[2]);
    surface.renewTriangle(t);
    const int first = triangulation::smaller(a.point(), b.point()) ? (triangulation::smaller(a.point(), c.point()) ? 0 : 2)
                                                                   : (triangulation::smaller(b.point(), c.point()) ? 1 : 2);
    surface.hash[t] = mesh::hashMixed(surface.mixed[v[first]], surface.mixed[v[(first + 1) % 3]], surface.mixed[v[(first + 2) % 3]]);
    // The plane y = a.y + gx (x - a.x) + gz (z - a.z).
    const double bx = double(b.x) - a.x, bz = double(b.z) - a.z, cx = double(c.x) - a.x, cz = double(c.z) - a.z, by = double(b.y) - a.y,
                 cy = double(c.y) - a.y, area = bz * cx - bx * cz, gx = (bz * cy - cz * by) / area, gz = (cx * by - bx * cy) / area;
    // Snapping moves a point by at most 0.71 of the spacing. All points tried lie at least a fifth of a height away from each side, so in
    // a triangle whose least height is well above the spacing they stay inside, apart and off the corners, and need no test.
    const double ex = cx - bx, ez = cz - bz, longest2 = std::max({bx * bx + bz * bz, cx * cx + cz * cz, ex * ex + ez * ez});
    const bool roomy = !thesis && area * area > kRoomy * longest2 * spacing2;
    const auto attempt = [&](double x, double z) {
      const Point2 p{snapTo(x, bits), snapTo(z, bits)};
      if (!roomy) {
        if (!admissible(a, b, c, p)) return;
        for (auto k = trials.rbegin(); k != trials.rend() && k->triangle == t; ++k)
          if (k->point == p) return;
      }
      trials.push_back({t, p, static_cast<float>(a.y + gx * (double(p.x) - a.x) + gz * (double(p.z) - a.z))});
    };
    const double sx = double(a.x) + b.x + c.x, sz = double(a.z) + b.z + c.z;
    if (thesis) {
      const double wa = surface.curvature[v[0]] + 1e-6, wb = surface.curvature[v[1]] + 1e-6, wc = surface.curvature[v[2]] + 1e-6, w = wa + wb + wc;
      attempt(0.4 * sx / 3 + 0.6 * (wa * a.x + wb * b.x + wc * c.x) / w, 0.4 * sz / 3 + 0.6 * (wa * a.z + wb * b.z + wc * c.z) / w);
    } else {
      attempt(sx / 3, sz / 3);
      for (const Vertex* k : {&a, &b, &c}) attempt((sx + 2.0 * k->x) / 5, (sz + 2.0 * k->z) / 5);
    }
  }
  px.resize(trials.size());
  pz.resize(trials.size());
  py.resize(trials.size());
  for (std::size_t k = 0; k < trials.size(); ++k) {
    px[k] = surface.anchor.x + trials[k].point.x;
    pz[k] = surface.anchor.z + trials[k].point.z;
  }
  terrain.heightSteps(px, pz, py);
  for (std::size_t k = 0; k < trials.size(); ++k) {
    const auto [t, p, y] = trials[k];
    const float error = std::abs(y - static_cast<float>(lattice::snapHeight(py[k], level)));
    if (error <= surface.error[t]) continue;
    surface.error[t] = error;
    surface.x[t] = p.x;
    surface.z[t] = p.z;
    surface.y[t] = py[k];
  }
  return trials.size();
}

}  // namespace ridgecast::refinement
