#include "server/encoding/bases.h"

#include <utility>

namespace ridgecast::encoding {

std::size_t Bases::Packed::bytes() const {
  constexpr std::size_t kEntry = 160;  // of the table, with the allocator's overhead
  return kEntry + vertices.capacity() * sizeof(vertices[0]) + narrow.capacity() * sizeof(narrow[0]) + wide.capacity() * sizeof(wide[0]);
}

void Bases::put(mesh::LeafMesh leaf) {
  erase(leaf.address);
  Packed packed;
  const bool narrow = leaf.vertices.size() <= 65536;
  // Checked before copying.
  const std::size_t size = leaf.vertices.capacity() * sizeof(mesh::LocalVertex) + leaf.triangles.size() * (narrow ? 6 : 12);
  if (bytes_ + packed.bytes() + size > budget_) return;
  packed.vertices = std::move(leaf.vertices);
  if (narrow) {
    packed.narrow.reserve(leaf.triangles.size());
    for (const mesh::Triangle& t : leaf.triangles)
      packed.narrow.push_back({static_cast<std::uint16_t>(t[0]), static_cast<std::uint16_t>(t[1]), static_cast<std::uint16_t>(t[2])});
  } else {
    packed.wide = std::move(leaf.triangles);
  }
  bytes_ += packed.bytes();
  leaves_.emplace(leaf.address, std::move(packed));
}

void Bases::erase(lattice::LeafAddress address) {
  const auto it = leaves_.find(address);
  if (it == leaves_.end()) return;
  bytes_ -= it->second.bytes();
  leaves_.erase(it);
}

void Bases::clear() {
  leaves_.clear();
  bytes_ = 0;
}

bool Bases::find(lattice::LeafAddress address, mesh::LeafMesh& leaf) const {
  const auto it = leaves_.find(address);
  if (it == leaves_.end()) return false;
  const Packed& packed = it->second;
  leaf.address = address;
  leaf.vertices.assign(packed.vertices.begin(), packed.vertices.end());
  leaf.triangles.assign(packed.wide.begin(), packed.wide.end());
  leaf.triangles.reserve(packed.narrow.size());
  for (const auto& t : packed.narrow) leaf.triangles.push_back({t[0], t[1], t[2]});
  return true;
}

std::size_t Bases::triangles(lattice::LeafAddress address) const {
  const auto it = leaves_.find(address);
  return it == leaves_.end() ? 0 : it->second.narrow.size() + it->second.wide.size();
}

}  // namespace ridgecast::encoding
