#pragma once
// From changes to payloads: each leaf whole or as a delta, whichever is cheaper. Remembers what the client holds, to start deltas from
// (bases.h). Called by one thread; spreads the work over the pool.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"
#include "server/encoding/bases.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"

namespace ridgecast::encoding {

inline constexpr std::size_t kBaseBytesPerTriangle = 24;  // for the bases, by the client's triangle budget

// What each leaf carries besides triangles.
struct Form {
  bool deltas = true;
  bool errors = false;  // distances from the ground
  bool shades = false;  // colours and normals of vertices
};

class Encoder {
 public:
  Encoder(std::shared_ptr<const terrain::Terrain> terrain, std::shared_ptr<scheduling::Pool> pool, Form form, std::uint32_t triangleBudget);

  void setTriangleBudget(std::uint32_t triangles);

  // `extract` returns a leaf's current mesh, canonical. Called by several threads.
  using Extract = std::function<mesh::LeafMesh(lattice::LeafAddress)>;
  // Sets number, hash and leaves of an iteration.
  void encode(replica::Changes changes, const Extract& extract, wire::Iteration& iteration);

 private:
  struct Encoded;
  const mesh::LeafMesh* baseOf(const replica::Changes& changes, const replica::Derived& derived, std::size_t triangles) const;
  Encoded encode(const replica::Changes& changes, const replica::Derived* derived, mesh::LeafMesh leaf) const;
  std::vector<std::uint8_t> shadesOf(const mesh::LeafMesh& leaf, const mesh::LeafMesh* base) const;

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::shared_ptr<scheduling::Pool> pool_;
  const Form form_;
  Bases bases_;
};

}  // namespace ridgecast::encoding
