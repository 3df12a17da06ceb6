#pragma once
// A pipeline whose mesh is checked at times (tests/support/verify.h), which takes longer than an iteration.

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/pipeline/pipeline.h"
#include "tests/simulation/world.h"
#include "tests/support/verify.h"

namespace ridgecast::simulation {

class SoundMesh final : public pipeline::IteratingMesh {
 public:
  SoundMesh(std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool)
      : pipeline_(std::move(terrain), granted, std::move(pool)) {}

  settings::IterationStats iterate(const camera::Camera& camera) override {
    const settings::IterationStats stats = pipeline_.iterate(camera);
    if (iterations_++ % kBetweenChecks == 0) {
      EXPECT_EQ(testing_support::verify(pipeline_.mesh()), "");
    }
    return stats;
  }
  std::optional<pipeline::MeshState> state() const override { return pipeline_.state(); }
  std::optional<settings::IterationStats> restore(const pipeline::MeshState& state, const camera::Camera& camera) override {
    ++met.movedMeshes;
    return pipeline_.restore(state, camera);
  }
  void change(const settings::Settings& granted) override { pipeline_.change(granted); }
  void setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) override {
    pipeline_.setGround(std::move(terrain), changed);
  }
  void setInsertionLimit(std::uint32_t most) override { pipeline_.setInsertionLimit(most); }
  bool settled() const override { return pipeline_.settled(); }
  const std::vector<mesh::LeafState>& leaves() const override { return pipeline_.leaves(); }
  mesh::LeafMesh extract(lattice::LeafAddress address) const override { return pipeline_.extract(address); }
  Surface surface() const override { return pipeline_.surface(); }
  std::uint32_t region(lattice::LeafAddress address) const override { return pipeline_.region(address); }
  void takeFresh(lattice::LeafAddress address, std::vector<triangulation::VertexId>& out) override { pipeline_.takeFresh(address, out); }
  std::vector<lattice::Candidate> candidates(std::uint32_t most) const override { return pipeline_.candidates(most); }

 private:
  static constexpr std::uint32_t kBetweenChecks = 32;
  pipeline::Pipeline pipeline_;
  std::uint32_t iterations_ = 0;
};

}  // namespace ridgecast::simulation
