#include <utility>

#include "server/session/iterating_mesh.h"

namespace ridgecast::session {

namespace {

class PipelineMesh final : public IteratingMesh {
 public:
  PipelineMesh(std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool)
      : pipeline_(std::move(terrain), granted, std::move(pool)) {}
  settings::Figures iterate(const camera::Camera& camera) override { return pipeline_.iterate(camera); }
  void setInsertionLimit(std::uint32_t most) override { pipeline_.setInsertionLimit(most); }
  void change(const settings::Settings& granted) override { pipeline_.change(granted); }
  bool settled() const override { return pipeline_.settled(); }
  const std::vector<mesh::LeafState>& leaves() const override { return pipeline_.leaves(); }
  mesh::LeafMesh extract(lattice::LeafAddress address) const override { return pipeline_.extract(address); }
  std::vector<lattice::Candidate> candidates(std::uint32_t most) const override { return pipeline_.candidates(most); }

 private:
  pipeline::Pipeline pipeline_;
};

}  // namespace

MakeMesh pipelineMeshes() {
  return [](std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool) {
    return std::make_unique<PipelineMesh>(std::move(terrain), granted, std::move(pool));
  };
}

}  // namespace ridgecast::session
