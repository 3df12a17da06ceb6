#pragma once
// From changes to payloads: points for clients that follow them (held_points.h), leaves whole. Called by one thread; leaves are spread over
// the pool.

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"
#include "server/encoding/held_points.h"
#include "server/pipeline/pipeline.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"

namespace ridgecast::encoding {

struct Form {
  bool points = true;   // the client follows points
  bool errors = false;  // distances of leaves from the ground
  bool shades = false;  // colours and normals of vertices
};

class Encoder {
 public:
  Encoder(std::shared_ptr<const terrain::Terrain> terrain, std::shared_ptr<scheduling::Pool> pool, Form form)
      : terrain_(std::move(terrain)), pool_(std::move(pool)), form_(form) {}

  void setTerrain(std::shared_ptr<const terrain::Terrain> terrain) { terrain_ = std::move(terrain); }

  // Sets number, hash, leaves and points of an iteration, which make the client's mesh this one. A mesh has one encoder of points.
  void encode(replica::Changes changes, pipeline::IteratingMesh& mesh, wire::Iteration& iteration);

 private:
  wire::LeafWhole whole(const mesh::LeafMesh& leaf) const;
  std::vector<std::uint8_t> shadesOf(const mesh::LeafMesh& leaf) const;
  std::vector<std::uint8_t> shadesOf(const HeldPoints::News& news) const;

  std::shared_ptr<const terrain::Terrain> terrain_;
  const std::shared_ptr<scheduling::Pool> pool_;
  const Form form_;
  HeldPoints held_;
};

}  // namespace ridgecast::encoding
