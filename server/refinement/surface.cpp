#include "server/refinement/surface.h"

#include <bit>

namespace ridgecast::refinement {

Surface::Surface(std::uint32_t triangleCapacity, std::uint32_t vertexCapacity, bool thesis)
    : candidates(triangleCapacity / CandidatePage::kSlots),
      hash(triangleCapacity),
      screens(std::make_unique<PageScreen[]>(triangleCapacity / CandidatePage::kSlots)),
      hashes(std::make_unique<PageHash[]>(triangleCapacity / CandidatePage::kSlots)),
      losses(std::make_unique<PageLosses[]>(vertexCapacity / triangulation::Pages::kSlots)),
      regions(1),
      vertices(vertexCapacity),
      curvature(thesis ? vertexCapacity : 0),
      keepsCurvature(thesis) {}

std::uint64_t hashRegion(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region) {
  const auto& pages = mesh.trianglePages();
  std::uint64_t sum = 0;
  for (std::uint32_t number : pages.pagesOf(region)) {
    PageHash& page = surface.hashes[number];
    const std::uint64_t alive = pages.aliveMask(number);
    for (std::uint64_t m = page.hashed & ~alive; m != 0; m &= m - 1)
      page.hash -= surface.hash[number * triangulation::Pages::kSlots + static_cast<std::uint32_t>(std::countr_zero(m))];
    page.hashed &= alive;
    sum += page.hash;
  }
  return sum;
}

}  // namespace ridgecast::refinement
