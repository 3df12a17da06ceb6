#pragma once
// One camera's mesh as a session sees it: it iterates, and can be read between iterations. The only implementation is pipeline::Pipeline;
// with this interface a session can be tested without it.

#include <functional>
#include <memory>
#include <vector>

#include "server/pipeline/pipeline.h"

namespace ridgecast::session {

// Same contract as pipeline::Pipeline.
class IteratingMesh {
 public:
  virtual ~IteratingMesh() = default;
  virtual settings::Figures iterate(const camera::Camera& camera) = 0;
  virtual void setInsertionLimit(std::uint32_t most) = 0;
  virtual void change(const settings::Settings& granted) = 0;  // from the next iteration on
  virtual bool settled() const = 0;
  virtual const std::vector<mesh::LeafState>& leaves() const = 0;
  virtual mesh::LeafMesh extract(lattice::LeafAddress address) const = 0;
  virtual std::vector<lattice::Candidate> candidates(std::uint32_t most) const = 0;
};

using MakeMesh = std::function<std::unique_ptr<IteratingMesh>(std::shared_ptr<const terrain::Terrain> terrain,
                                                              const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool)>;

// Makes pipelines.
MakeMesh pipelineMeshes();

}  // namespace ridgecast::session
