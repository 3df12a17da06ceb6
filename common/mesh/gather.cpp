#include "common/mesh/gather.h"

#include <cstdlib>

namespace ridgecast::mesh {

LeafMesh gather(lattice::LeafAddress address, std::span<const LeafMesh* const> sources) {
  constexpr std::int64_t kReach = std::int64_t{1} << 27;
  LeafMesh out{.address = address, .vertices = {}, .triangles = {}};
  std::vector<std::uint32_t> place;
  for (const LeafMesh* source : sources) {
    const std::int64_t dx = source->address.x() - address.x(), dz = source->address.z() - address.z(), side = address.side();
    place.assign(source->vertices.size(), 0);  // 1 + index in out
    for (const Triangle& t : source->triangles) {
      std::int64_t sumX = 3 * dx, sumZ = 3 * dz;
      bool near = true;
      for (std::uint32_t v : t) {
        const std::int64_t x = source->vertices[v].x, z = source->vertices[v].z;
        sumX += x;
        sumZ += z;
        near = near && std::abs(x + dx) <= kReach && std::abs(z + dz) <= kReach;
      }
      if (!near || sumX < 0 || sumX >= 3 * side || sumZ < 0 || sumZ >= 3 * side) continue;
      Triangle here;
      for (std::size_t c = 0; c < 3; ++c) {
        std::uint32_t& at = place[t[c]];
        if (at == 0) {
          const LocalVertex& v = source->vertices[t[c]];
          out.vertices.push_back({static_cast<std::int32_t>(v.x + dx), static_cast<std::int32_t>(v.z + dz), v.y});
          at = static_cast<std::uint32_t>(out.vertices.size());
        }
        here[c] = at - 1;
      }
      out.triangles.push_back(here);
    }
  }
  canonicalize(out);
  return out;
}

}  // namespace ridgecast::mesh
