// What an iteration made of the leaves: their hashes and bounds, kept as triangles come and go, and their triangles once somebody asks.

#include "client/core/mesh/point_mesh.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::core {

using lattice::LeafAddress;
using triangulation::kOutside;
using triangulation::TriangleId;
using triangulation::Vertex;

std::vector<PointMesh::Changed> PointMesh::takeChanged() {
  std::vector<Changed> changed;
  for (RegionId region = kOutside + 1; region < mesh_->regionLimit(); ++region) {
    if (!mesh_->takeChanged(region)) continue;
    if (mesh_->sparse(region)) mesh_->compact(region, moves());
    changed.push_back(look(region));
  }
  std::sort(changed.begin(), changed.end(), [](const Changed& a, const Changed& b) { return a.leaf < b.leaf; });
  return changed;
}

PointMesh::Changed PointMesh::look(RegionId region) {
  const LeafAddress& leaf = leaves_[region];
  Changed out{leaf, hashOf(region), mesh_->triangleCount(region)};
  if (out.triangles == 0) bounds_[region] = {};
  if (out.triangles == 0) return out;
  const auto dx = static_cast<std::int32_t>(anchor_.x - leaf.x()), dz = static_cast<std::int32_t>(anchor_.z - leaf.z());
  const auto& [low, high] = bounds_[region];
  out.low = {low.x + dx, low.z + dz, low.y};
  out.high = {high.x + dx, high.z + dz, high.y};
  return out;
}

void PointMesh::Bounds::add(const mesh::LocalVertex& a, const mesh::LocalVertex& b) {
  low = {std::min(low.x, a.x), std::min(low.z, a.z), std::min(low.y, a.y)};
  high = {std::max(high.x, b.x), std::max(high.z, b.z), std::max(high.y, b.y)};
}

void PointMesh::addToBounds(RegionId region, TriangleId t) {
  for (VertexId v : mesh_->triangle(t).v) {
    const Vertex& p = mesh_->vertex(v);
    bounds_[region].add({p.x, p.z, p.y}, {p.x, p.z, p.y});
  }
}

// Of the region's triangles only the fresh ones and those that are gone are looked at. What is read lies scattered and is seldom in the
// cache: each loop brings it for the next.
std::uint64_t PointMesh::hashOf(RegionId region) {
  triangulation::TrianglePages& pages = mesh_->trianglePages();
  for (std::uint32_t page : pages.pagesOf(region)) pages.prefetch(page);
  for (std::uint32_t page : pages.pagesOf(region)) {
    pages.forEachBlock(page, [&](std::uint32_t block) { __builtin_prefetch(&hashes_[block]); });
    pages.forEachIn(page, pages.freshMask(page), [&](TriangleId t) { __builtin_prefetch(&terms_[t]); });
  }
  std::uint64_t sum = 0;
  for (std::uint32_t page : pages.pagesOf(region)) {
    pages.forEachIn(page, pages.freshMask(page), [&](TriangleId t) {
      setTerm(t, termOf(t));
      addToBounds(region, t);
      pages.clearFresh(t);
    });
    for (std::uint32_t k = 0; k < Pages::kBlocks; ++k) {
      const std::uint32_t block = pages.blockOf(page, k);
      if (block == triangulation::kNoSlot) continue;
      BlockHash& hash = hashes_[block];
      const auto alive = static_cast<std::uint16_t>(pages.aliveMask(page) >> (k * Pages::kBlock));
      hash.drawn &= static_cast<std::uint16_t>(~hash.terms | alive);
      for (unsigned dead = hash.terms & ~alive; dead != 0; dead &= dead - 1)
        hash.sum -= terms_[block * Pages::kBlock + static_cast<TriangleId>(std::countr_zero(dead))];
      hash.terms &= alive;
      sum += hash.sum;
    }
  }
  return sum;
}

void PointMesh::setTerm(TriangleId t, std::uint64_t term) {
  BlockHash& hash = hashes_[t / Pages::kBlock];
  const auto bit = static_cast<std::uint16_t>(1u << t % Pages::kBlock);
  if (hash.terms & bit) hash.sum -= terms_[t];
  hash.terms |= bit;
  hash.drawn &= static_cast<std::uint16_t>(~bit);
  hash.sum += terms_[t] = term;
}

std::uint64_t PointMesh::termOf(TriangleId t) const {
  lattice::Vertex v[3];
  for (unsigned k = 0; k < 3; ++k) {
    const Vertex& p = mesh_->vertex(mesh_->triangle(t).v[k]);
    v[k] = {anchor_.x + p.x, anchor_.z + p.z, p.y};
  }
  return mesh::hashTriangle(v[0], v[1], v[2]);
}

PointMesh::Leaf PointMesh::extract(LeafAddress leaf) {
  const auto held = regions_.find(leaf);
  expects(held != regions_.end(), "a leaf that is extracted is held");
  const RegionId region = held->second;
  Leaf out{extractor_.extract(*mesh_, region, leaf, anchor_), {}};
  const auto dx = static_cast<std::int32_t>(leaf.x() - anchor_.x), dz = static_cast<std::int32_t>(leaf.z() - anchor_.z);
  bounds_[region] = {};
  for (const auto& [x, z, y] : out.mesh.vertices) bounds_[region].add({x + dx, z + dz, y}, {x + dx, z + dz, y});
  if (shaded_)
    for (VertexId v : extractor_.vertices()) out.shades.push_back(shades_[v]);
  return out;
}

void PointMesh::draw(std::span<const Changed> leaves, Drawing& to) {
  to.ends.clear(), to.blocks.clear(), to.changed.clear(), to.corners.clear();
  const triangulation::TrianglePages& pages = mesh_->trianglePages();
  for (const Changed& changed : leaves) {
    for (std::uint32_t page : pages.pagesOf(regions_.at(changed.leaf)))
      for (std::uint32_t k = 0; k < Pages::kBlocks; ++k) {
        const auto alive = static_cast<std::uint16_t>(pages.aliveMask(page) >> (k * kBlock));
        if (alive == 0) continue;
        const std::uint32_t block = pages.blockOf(page, k);
        to.blocks.push_back(block);
        drawBlock(block, alive, changed.leaf, to);
      }
    to.ends.push_back(static_cast<std::uint32_t>(to.blocks.size()));
  }
}

void PointMesh::drawBlock(std::uint32_t block, std::uint32_t alive, LeafAddress leaf, Drawing& to) {
  const auto dx = static_cast<std::int32_t>(anchor_.x - leaf.x()), dz = static_cast<std::int32_t>(anchor_.z - leaf.z());
  constexpr auto all = static_cast<std::uint16_t>((1u << kBlock) - 1);
  for (unsigned changed = all & ~std::exchange(hashes_[block].drawn, all); changed != 0; changed &= changed - 1) {
    const auto place = static_cast<std::uint32_t>(std::countr_zero(changed));
    const TriangleId t = block * kBlock + place;
    to.changed.push_back(t);
    to.corners.resize(to.corners.size() + 3);
    if ((alive >> place & 1) == 0) continue;
    mesh::LocalVertex* corner = &to.corners.back() - 2;
    for (VertexId v : mesh_->triangle(t).v) {
      const Vertex& p = mesh_->vertex(v);
      *corner++ = {dx + p.x, dz + p.z, p.y};
    }
  }
}

}  // namespace ridgecast::core
