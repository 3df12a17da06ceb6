#include "server/session/resources.h"

#include <utility>

namespace ridgecast::session {

MakeMesh pipelineMeshes() {
  return [](std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool) {
    return std::make_unique<pipeline::Pipeline>(std::move(terrain), granted, std::move(pool));
  };
}

}  // namespace ridgecast::session
