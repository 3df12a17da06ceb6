#include "common/mesh/extraction.h"

#include <cstdlib>

#include "common/outcome/contract.h"

namespace ridgecast::mesh {

using triangulation::TriangleId;
using triangulation::VertexId;

// The region's own vertices lie together and are most of the corners: numbered first, they need not be discovered one by one.
LeafMesh Extractor::extract(const triangulation::Triangulation& mesh, triangulation::RegionId region, lattice::LeafAddress leaf,
                            lattice::Point anchor) {
  LeafMesh out{leaf, {}, {}};
  expects(mesh.trianglePages().hasRegion(region), "a leaf is taken out of a region that is there");
  vertices_.clear();
  const std::size_t count = mesh.triangleCount(region);
  if (count == 0) return out;
  if (places_.size() < mesh.vertexCapacity()) places_.resize(mesh.vertexCapacity(), 0);
  const lattice::Step dx = anchor.x - leaf.x(), dz = anchor.z - leaf.z();
  expects(std::abs(dx) < 1 << 30 && std::abs(dz) < 1 << 30, "a leaf lies near its mesh's anchor");
  const auto add = [&](VertexId v) {
    const triangulation::Vertex& p = mesh.vertex(v);
    out.vertices.push_back({static_cast<std::int32_t>(dx + p.x), static_cast<std::int32_t>(dz + p.z), p.y});
    vertices_.push_back(v);
    return places_[v] = static_cast<std::uint32_t>(vertices_.size());
  };
  for (std::uint32_t page : mesh.vertexPages().pagesOf(region))
    mesh.vertexPages().forEachBlock(page, [&](std::uint32_t block) { mesh.prefetchVertices(block); });
  out.vertices.reserve(mesh.vertexCount(region) + count / 8 + 16);

  mesh.vertexPages().forEach(region, [&](VertexId v) {
    if (mesh.regionOf(mesh.edgeOf(v) >> 2) == region) add(v);  // those at the border may have none of its triangles
  });

  out.triangles.reserve(count);
  const triangulation::TrianglePages& triangles = mesh.trianglePages();
  const auto& pages = triangles.pagesOf(region);
  for (std::size_t n = 0; n < pages.size(); ++n) {
    if (n + 1 < pages.size()) triangles.forEachBlock(pages[n + 1], [&](std::uint32_t block) { mesh.prefetchTriangles(block); });
    triangles.forEachIn(pages[n], triangles.aliveMask(pages[n]), [&](TriangleId t) {
      Triangle& to = out.triangles.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        const VertexId v = mesh.triangle(t).v[k];
        const std::uint32_t place = places_[v];
        to[k] = (place != 0 ? place : add(v)) - 1;
      }
    });
  }
  for (VertexId v : vertices_) places_[v] = 0;
  return out;
}

}  // namespace ridgecast::mesh
