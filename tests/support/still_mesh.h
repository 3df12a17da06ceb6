#pragma once
// A mesh of one empty leaf that is at rest, where sockets and rights are what is tested.

#include <cstdint>
#include <vector>

#include "server/session/session.h"

namespace ridgecast::testing_support {

class StillMesh final : public session::IteratingMesh {
 public:
  wire::IterationStats iterate(const camera::Camera&) override { return {}; }
  void setInsertionLimit(std::uint32_t) override {}
  void change(const wire::Settings&) override {}
  void setGround(std::shared_ptr<const terrain::Terrain>, std::span<const lattice::Area>) override {}
  bool settled() const override { return true; }
  const std::vector<mesh::LeafState>& leaves() const override { return leaves_; }
  mesh::LeafMesh extract(lattice::LeafAddress address) const override { return {address, {}, {}}; }
  std::vector<wire::Candidate> candidates(std::uint32_t) const override { return {}; }

 private:
  std::vector<mesh::LeafState> leaves_{{{0, 1, 2}, 1, 0, 0}};
};

}  // namespace ridgecast::testing_support
