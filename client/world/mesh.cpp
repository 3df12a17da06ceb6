#include "client/world/mesh.h"

#include <algorithm>
#include <limits>
#include <unordered_map>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::world {

namespace {

struct PlaceHash {
  std::size_t operator()(const lattice::Point& p) const {
    return lattice::mix(static_cast<std::uint64_t>(p.x) + lattice::mix(static_cast<std::uint64_t>(p.z)));
  }
};

}  // namespace

Mesh meshOf(const core::Leaves& leaves, lattice::Point origin) {
  Mesh out{.origin = origin};
  std::unordered_map<lattice::Point, std::uint32_t, PlaceHash> numbers;
  std::vector<std::uint32_t> numberOf;  // by the leaf's own
  for (const auto& [address, leaf] : leaves) {
    const auto& vertices = leaf.mesh->vertices;
    numberOf.resize(vertices.size());
    for (std::size_t k = 0; k < vertices.size(); ++k) {
      const lattice::Point at{address.x() + vertices[k].x, address.z() + vertices[k].z};
      const auto [found, fresh] = numbers.try_emplace(at, static_cast<std::uint32_t>(out.positions.size()));
      numberOf[k] = found->second;
      if (!fresh) continue;
      const auto metres = [](lattice::Step steps) { return static_cast<float>(static_cast<double>(steps) * lattice::kMetresPerStep); };
      out.positions.push_back({metres(at.x - origin.x), metres(vertices[k].y), metres(at.z - origin.z)});
    }
    for (const mesh::Triangle& t : leaf.mesh->triangles) out.triangles.push_back({numberOf[t[0]], numberOf[t[1]], numberOf[t[2]]});
    if (!leaf.mesh->triangles.empty())
      out.error = std::max(out.error, leaf.error > 0 ? static_cast<double>(leaf.error) : std::numeric_limits<double>::infinity());
  }
  return out;
}

}  // namespace ridgecast::world
