#include "server/box/filing.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "common/outcome/contract.h"

namespace ridgecast::box {

using lattice::Step;
using triangulation::TriangleId;
using triangulation::Vertex;
using triangulation::VertexId;

namespace {

constexpr double kTrianglesALeaf = 3000;
constexpr std::size_t kLeavesAtATime = 16;

}  // namespace

Filing::Filing(const triangulation::Triangulation& mesh, const Frame& frame, lattice::Point low, lattice::Point high, std::size_t regions)
    : mesh_(mesh), frame_(frame), added_(regions) {
  const double area = static_cast<double>(high.x - low.x) * static_cast<double>(high.z - low.z);
  const double parts = std::max(1.0, mesh.liveTriangles() / kTrianglesALeaf);
  while (level_ < lattice::kMaxLevel && std::ldexp(1.0, 2 * (lattice::kFinestSideBits + level_)) < area / parts) ++level_;
}

void Filing::add(std::size_t k, triangulation::RegionId region) {
  expects(k < added_.size() && added_[k].empty() && leaves_.empty(), "each region is filed once, before leaves are made");
  const int bits = lattice::kFinestSideBits + level_;
  const auto third = [](Step v) { return v >= 0 ? v / 3 : -((2 - v) / 3); };
  auto& leaves = added_[k];
  auto last = leaves.end();
  mesh_.trianglePages().forEach(region, [&](TriangleId t) {
    const auto& v = mesh_.triangle(t).v;
    Step x3 = 0, z3 = 0;
    for (VertexId id : v) {
      const lattice::Point p = frame_.global(mesh_.vertex(id).point());
      x3 += p.x;
      z3 += p.z;
    }
    const lattice::LeafAddress leaf{level_, third(x3 >> bits), third(z3 >> bits)};
    if (last == leaves.end() || last->first != leaf) last = leaves.try_emplace(leaf).first;
    last->second.insert(last->second.end(), v, v + 3);
  });
}

bool Filing::finish(scheduling::Pool& pool) {
  if (leaves_.empty())
    for (const auto& part : added_)
      for (const auto& [leaf, corners] : part) filed_[leaf].push_back(&corners);
  const std::size_t first = leaves_.size(), count = std::min(kLeavesAtATime, filed_.size());
  std::vector<std::vector<const Corners*>> parts;
  for (std::size_t k = 0; k < count; ++k) {
    auto leaf = filed_.extract(filed_.begin());
    leaves_.push_back({leaf.key(), {}, {}});
    parts.push_back(std::move(leaf.mapped()));
  }
  pool.forEach(count, 1, [&](std::size_t k) { finish(leaves_[first + k], parts[k]); });
  return filed_.empty();
}

void Filing::finish(mesh::LeafMesh& leaf, const std::vector<const Corners*>& parts) const {
  // Each vertex once, though six triangles have it: by a table of twice as many places as there may be vertices.
  std::size_t count = 0;
  for (const Corners* part : parts) count += part->size();
  struct Place {
    VertexId vertex = triangulation::kInfinite;
    std::uint32_t number = 0;
  };
  expects(count < std::size_t{1} << 30, "a leaf's corners have a table");
  thread_local std::vector<Place> table;
  const int bits = std::bit_width(count);
  table.assign(std::size_t{1} << (bits + 1), {});
  const auto numberOf = [&](VertexId id) {
    std::size_t at = id * 2'654'435'761u >> (31 - bits);
    while (table[at].vertex != id) {
      if (table[at].vertex == triangulation::kInfinite) {
        const Vertex& v = mesh_.vertex(id);
        const lattice::Point p = frame_.global(v.point());
        table[at] = {id, static_cast<std::uint32_t>(leaf.vertices.size())};
        leaf.vertices.push_back(
            {static_cast<std::int32_t>(p.x - leaf.address.x()), static_cast<std::int32_t>(p.z - leaf.address.z()), v.y});
        break;
      }
      at = (at + 1) & (table.size() - 1);
    }
    return table[at].number;
  };
  leaf.triangles.reserve(count / 3);
  for (const Corners* part : parts)
    for (std::size_t k = 0; k < part->size(); k += 3) {
      const std::uint32_t a = numberOf((*part)[k]), b = numberOf((*part)[k + 1]), c = numberOf((*part)[k + 2]);
      leaf.triangles.push_back({a, b, c});
    }
  mesh::canonicalize(leaf);
}

}  // namespace ridgecast::box
