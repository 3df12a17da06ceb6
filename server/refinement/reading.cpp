// What others read of a region: its hash, its mesh, its candidates.
#include <algorithm>
#include <bit>
#include <cmath>

#include "common/mesh/extraction.h"
#include "server/refinement/adaptive_mesh.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using triangulation::TrianglePages;

// The sum over the region's triangles, of which only what changed is summed again.
std::uint64_t AdaptiveMesh::hash(RegionId region) {
  const TrianglePages& pages = mesh_.trianglePages();
  std::uint64_t sum = 0;
  for (std::uint32_t number : pages.pagesOf(region)) {
    PageScreen& page = screens_[number];
    const Mask alive = pages.aliveMask(number);
    if (alive == 0) beginScreen(number, page.travel);  // opened, and not used yet: what is there is another region's
    pages.forEachIn(number, page.hashed & ~alive, [&](TriangleId t) { page.hash -= hashes_[t]; });
    page.hashed &= alive;
    sum += page.hash;
  }
  return sum;
}

mesh::LeafMesh AdaptiveMesh::extract(RegionId region, lattice::LeafAddress leaf) const {
  thread_local mesh::Extractor extractor;  // for its memory
  mesh::LeafMesh out = extractor.extract(mesh_, region, leaf, anchor_);
  mesh::canonicalize(out);
  return out;
}

void AdaptiveMesh::list(RegionId region, const View& view, std::vector<ListedCandidate>& out) const {
  mesh_.trianglePages().forEach(region, [&](TriangleId t) {
    const Candidate c = candidate(t);
    if (!(c.error > 0)) return;
    const camera::Vec3 at = view.relative(c.point.x, c.point.z, c.y);
    const double error = c.error / view.measure.weight(areaOf(mesh_, t));
    if (!view.wide.contains(at) && !view.wide.meets(cornersOf(mesh_, view, t), error * lattice::kMetresPerStep)) return;
    const double flat = at.x * at.x + at.z * at.z, d2 = std::max(flat + at.y * at.y, 0.25);
    const double pixels = error * lattice::kMetresPerStep * view.pixelsPerRadian * std::sqrt(flat) / d2;
    out.push_back({c.point, c.y, static_cast<float>(pixels)});
  });
}

void keepWorst(std::vector<ListedCandidate>& candidates, std::size_t most) {
  if (candidates.size() > most) {
    std::nth_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(most), candidates.end());
    candidates.resize(most);
  }
  std::sort(candidates.begin(), candidates.end());
}

}  // namespace ridgecast::refinement
