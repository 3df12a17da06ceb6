#include "server/refinement/coarsening.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace ridgecast::refinement {

using triangulation::Change;
using triangulation::kInfinite;
using triangulation::orientation;
using triangulation::Point2;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::Vertex;
using triangulation::VertexId;

double pixelsAt(const Vertex& v, double error, const View& view) {
  const double dx = double(v.x) - view.x, dz = double(v.z) - view.z, dy = double(v.y) - view.y, flat = dx * dx + dz * dz;
  const double d2 = std::max(flat + dy * dy, double(kNearest) * kNearest);
  return view.pixelsPerRadian * error * std::sqrt(flat) / d2;
}

void screenLosses(const Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view, double limit,
                  std::vector<VertexId>& out) {
  using triangulation::Pages;
  const Pages& pages = mesh.vertexPages();
  const float ppr2 = static_cast<float>(view.pixelsPerRadian * view.pixelsPerRadian), most = static_cast<float>(limit * limit);
  const double spared = view.moving ? limit / kSlack : limit;
  for (std::uint32_t page : pages.pagesOf(region)) {
    PageLosses& known = surface.losses[page];
    if (known.travel >= 0) {
      const double moved = view.travel - known.travel, flat = 1 - moved / known.flat, away = 1 + moved / known.nearest;
      if (flat > 0 && known.leastPixels * flat > spared * away * away) continue;
    }
    constexpr float far = std::numeric_limits<float>::max();
    float least = far, flattest = far, nearest = far;
    bool any = false;
    for (std::uint64_t m = pages.aliveMask(page); m != 0; m &= m - 1) {
      const VertexId v = page * Pages::kSlots + static_cast<VertexId>(std::countr_zero(m));
      const float loss = surface.loss[v];
      if (v == kInfinite || std::isinf(loss)) continue;
      const Vertex& p = mesh.vertex(v);
      const float dx = static_cast<float>(p.x - view.x), dz = static_cast<float>(p.z - view.z), dy = static_cast<float>(p.y) - view.y;
      const float flat = dx * dx + dz * dz, d2 = std::max(flat + dy * dy, kNearest * kNearest);
      const float pixels2 = ppr2 * loss * loss * flat / (d2 * d2);
      if (pixels2 < most) {
        out.push_back(v);
        any = true;
      } else {
        least = std::min(least, pixels2);
        flattest = std::min(flattest, flat);
        nearest = std::min(nearest, d2);
      }
    }
    known = {any ? -1 : view.travel, std::sqrt(least), std::sqrt(flattest), std::sqrt(nearest)};
  }
}

float lossOf(const Triangulation& mesh, const Surface& surface, VertexId v, triangulation::WriteSet& set) {
  constexpr float never = std::numeric_limits<float>::infinity();
  if (mesh.plan(v, set) != Change::kDone) return never;
  for (TriangleId t : set.star())
    if (mesh.isGhost(t) || mesh.regionOf(t) == triangulation::kOutside || mesh.trianglePages().fresh(t)) return never;
  double worst = 0;
  const auto judge = [&](Point2 p, double y) {
    bool found = false;
    set.forEachFill([&](VertexId a, VertexId b, VertexId c) {
      if (found) return;
      const Vertex &va = mesh.vertex(a), &vb = mesh.vertex(b), &vc = mesh.vertex(c);
      if (orientation(va.point(), vb.point(), p) < 0 || orientation(vb.point(), vc.point(), p) < 0 || orientation(vc.point(), va.point(), p) < 0)
        return;
      found = true;
      worst = std::max(worst, std::abs(planeHeight(va, vb, vc, p) - y));
    });
  };
  judge(mesh.vertex(v).point(), surface.fineY[v]);
  for (TriangleId t : set.star())
    if (surface.error[t] != 0) judge({surface.x[t], surface.z[t]}, surface.y[t]);
  return static_cast<float>(worst);
}

}  // namespace ridgecast::refinement
