#include "server/refinement/candidate_list.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "server/refinement/candidates.h"

namespace ridgecast::refinement {

void listCandidates(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view,
                    std::vector<ListedCandidate>& out) {
  const triangulation::TrianglePages& pages = mesh.trianglePages();
  for (const std::uint32_t number : pages.pagesOf(region)) {
    const CandidatePage& page = surface.candidates[number];
    for (triangulation::TrianglePages::Mask alive = pages.aliveMask(number); alive != 0; alive &= alive - 1) {
      const auto k = static_cast<unsigned>(std::countr_zero(alive));
      if (!(page.error[k] > 0)) continue;
      const camera::Vec3 at = view.relative(page.x[k], page.z[k], page.y[k]);
      const triangulation::TriangleId t = number * triangulation::TrianglePages::kSlots + k;
      double error = page.error[k];
      if (view.area) {
        const auto& v = mesh.triangle(t).v;
        error /= areaWeight(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]));
      }
      if (!view.wide.contains(at) && !view.wide.meets(cornersOf(mesh, view, t), error * lattice::kMetresPerStep)) continue;
      const double flat = at.x * at.x + at.z * at.z, d2 = std::max(flat + at.y * at.y, 0.25);
      const double pixels = error * lattice::kMetresPerStep * view.pixelsPerRadian * std::sqrt(flat) / d2;
      out.push_back({{page.x[k], page.z[k]}, page.y[k], static_cast<float>(pixels)});
    }
  }
}

void keepWorst(std::vector<ListedCandidate>& candidates, std::size_t most) {
  if (candidates.size() > most) {
    std::nth_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(most), candidates.end());
    candidates.resize(most);
  }
  std::sort(candidates.begin(), candidates.end());
}

}  // namespace ridgecast::refinement
