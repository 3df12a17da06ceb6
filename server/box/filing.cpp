#include "server/box/filing.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace ridgecast::box {

using lattice::Step;
using triangulation::TriangleId;
using triangulation::Vertex;
using triangulation::VertexId;

namespace {

constexpr double kTrianglesALeaf = 3000;
constexpr std::size_t kLeavesAtATime = 16;

}  // namespace

Filing::Filing(const triangulation::Triangulation& mesh, const Frame& frame, lattice::Point low, lattice::Point high)
    : mesh_(mesh), frame_(frame) {
  const double area = static_cast<double>(high.x - low.x) * static_cast<double>(high.z - low.z);
  const double parts = std::max(1.0, mesh.liveTriangles() / kTrianglesALeaf);
  while (level_ < lattice::kMaxLevel && std::ldexp(1.0, 2 * (lattice::kFinestSideBits + level_)) < area / parts) ++level_;
}

void Filing::add(triangulation::RegionId region) {
  const Step side3 = 3 * (Step{1} << (lattice::kFinestSideBits + level_));
  const auto floored = [](Step p, Step q) { return p >= 0 ? p / q : -((q - 1 - p) / q); };
  mesh_.trianglePages().forEach(region, [&](TriangleId t) {
    const auto& v = mesh_.triangle(t).v;
    Step x3 = 0, z3 = 0;
    for (VertexId id : v) {
      const lattice::Point p = frame_.global(mesh_.vertex(id).point());
      x3 += p.x;
      z3 += p.z;
    }
    Leaf& leaf = filed_[{level_, floored(x3, side3), floored(z3, side3)}];
    const auto first = static_cast<std::uint32_t>(leaf.ids.size());
    leaf.ids.insert(leaf.ids.end(), v, v + 3);
    leaf.mesh.triangles.push_back({first, first + 1, first + 2});
  });
}

bool Filing::finish(scheduling::Pool& pool) {
  const std::size_t first = leaves_.size(), count = std::min(kLeavesAtATime, filed_.size());
  std::vector<std::vector<VertexId>> ids;
  for (std::size_t k = 0; k < count; ++k) {
    auto leaf = filed_.extract(filed_.begin());
    leaf.mapped().mesh.address = leaf.key();
    leaves_.push_back(std::move(leaf.mapped().mesh));
    ids.push_back(std::move(leaf.mapped().ids));
  }
  pool.forEach(count, 1, [&](std::size_t k) { finish(leaves_[first + k], ids[k]); });
  return filed_.empty();
}

void Filing::finish(mesh::LeafMesh& leaf, const std::vector<VertexId>& ids) const {
  for (VertexId id : ids) {
    const Vertex& v = mesh_.vertex(id);
    const lattice::Point p = frame_.global(v.point());
    leaf.vertices.push_back({static_cast<std::int32_t>(p.x - leaf.address.x()), static_cast<std::int32_t>(p.z - leaf.address.z()), v.y});
  }
  mesh::canonicalize(leaf);
}

}  // namespace ridgecast::box
