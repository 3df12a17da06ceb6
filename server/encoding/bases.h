#pragma once
// The meshes that deltas may start from: the last version sent of each leaf, packed. A leaf that does not fit into the budget is not kept;
// its next change is sent whole.
//
// One thread writes; several may call find() while nobody writes.

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"

namespace ridgecast::encoding {

class Bases {
 public:
  explicit Bases(std::size_t budgetBytes = 0) : budget_(budgetBytes) {}
  void setBudget(std::size_t bytes) { budget_ = bytes; }

  void put(mesh::LeafMesh leaf);  // canonical; replaces what was there
  void erase(lattice::LeafAddress address);
  void clear();
  // Writes into `leaf`, reusing its memory. False: unknown.
  bool find(lattice::LeafAddress address, mesh::LeafMesh& leaf) const;

  std::size_t triangles(lattice::LeafAddress address) const;  // 0: unknown, or empty

  std::size_t bytes() const { return bytes_; }
  std::size_t budget() const { return budget_; }

 private:
  // About 12 bytes a triangle: 16-bit indices where possible.
  struct Packed {
    std::vector<mesh::LocalVertex> vertices;
    std::vector<std::array<std::uint16_t, 3>> narrow;
    std::vector<mesh::Triangle> wide;
    std::size_t bytes() const;
  };
  std::unordered_map<lattice::LeafAddress, Packed, lattice::LeafAddressHash> leaves_;
  std::size_t budget_ = 0, bytes_ = 0;
};

}  // namespace ridgecast::encoding
