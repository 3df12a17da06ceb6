#include "server/refinement/surface.h"

#include <bit>

namespace ridgecast::refinement {

Surface::Surface(std::uint32_t triangleCapacity, std::uint32_t vertexCapacity, bool thesis)
    : candidates(triangleCapacity / CandidatePage::kSlots),
      hash(triangleCapacity),
      dues(std::make_unique<PageDue[]>(triangleCapacity / CandidatePage::kSlots)),
      screens(std::make_unique<PageScreen[]>(triangleCapacity / CandidatePage::kSlots)),
      losses(std::make_unique<PageLosses[]>(vertexCapacity / triangulation::VertexPages::kSlots)),
      regions(1),
      vertices(vertexCapacity),
      curvature(thesis ? vertexCapacity : 0),
      keepsCurvature(thesis) {}

namespace {
// visit(page, begin, end) for every run of moves to one page.
template <class Storage, class F>
void forEachPage(std::span<const triangulation::Move> moves, F&& visit) {
  for (std::size_t begin = 0; begin < moves.size();) {
    const std::uint32_t page = moves[begin].to / Storage::kSlots;
    std::size_t end = begin + 1;
    while (end < moves.size() && moves[end].to / Storage::kSlots == page) ++end;
    visit(page, begin, end);
    begin = end;
  }
}
}  // namespace

void Surface::moveTriangles(std::span<const triangulation::Move> moves, triangulation::RegionId region) {
  forEachPage<triangulation::TrianglePages>(moves, [&](std::uint32_t number, std::size_t begin, std::size_t end) {
    CandidatePage& page = candidates[number];
    PageScreen& screen = screens[number];
    triangulation::TrianglePages::Mask slots = 0;
    for (std::size_t n = begin; n < end; ++n) {
      const auto [from, to] = moves[n];
      const std::uint32_t k = to % CandidatePage::kSlots;
      const triangulation::TrianglePages::Mask bit = triangulation::TrianglePages::Mask{1} << k;
      const Candidate c = candidate(from);
      page.x[k] = c.point.x;
      page.z[k] = c.point.z;
      page.y[k] = c.y;
      page.error[k] = std::abs(c.error);  // a candidate that moves is awake
      if (screen.hashed & bit) screen.hash -= hash[to];
      hash[to] = hash[from];
      screen.hash += hash[to];
      slots |= bit;
    }
    screen.hashed |= slots;
    screen.asleep &= ~slots;
    screen.blank &= ~slots;
    wakeCandidate(moves[begin].to, region);
  });
}

void Surface::moveVertices(std::span<const triangulation::Move> moves, triangulation::RegionId region) {
  for (const auto& [from, to] : moves) {
    vertices[to] = vertices[from];
    if (keepsCurvature) curvature[to] = curvature[from];
  }
  forEachPage<triangulation::VertexPages>(moves,
                                          [&](std::uint32_t, std::size_t begin, std::size_t) { wakeVertex(moves[begin].to, region); });
}

std::uint64_t hashRegion(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region) {
  const auto& pages = mesh.trianglePages();
  std::uint64_t sum = 0;
  for (std::uint32_t number : pages.pagesOf(region)) {
    PageScreen& page = surface.screens[number];
    const triangulation::TrianglePages::Mask alive = pages.aliveMask(number);
    for (triangulation::TrianglePages::Mask m = page.hashed & ~alive; m != 0; m &= m - 1)
      page.hash -= surface.hash[number * CandidatePage::kSlots + static_cast<std::uint32_t>(std::countr_zero(m))];
    page.hashed &= alive;
    sum += page.hash;
  }
  return sum;
}

}  // namespace ridgecast::refinement
