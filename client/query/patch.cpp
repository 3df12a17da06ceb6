#include "client/query/patch.h"

#include <string>
#include <utility>

#include "client/core/mesh/mesh_ground.h"
#include "common/wire/wire.h"

namespace ridgecast::query {

Outcome<Patch> groundAround(link::Connection& connection, lattice::Point at, double radius, double error,
                            std::chrono::milliseconds timeout) {
  const wire::AskGround question{0, at, radius, error};
  if (std::string refusal = wire::refusalOf(question); !refusal.empty()) return Error{std::move(refusal)};
  auto answer = connection.askGround(question);
  if (answer.wait_for(timeout) != std::future_status::ready)
    return Error{"the server did not answer a question for the ground within " + std::to_string(timeout.count()) + " ms"};
  auto ground = answer.get();
  if (!ground) return ground.error();
  const double reached = ground->error;
  auto scene = core::sceneOf(std::move(*ground));
  if (!scene) return scene.error();
  return Patch{std::move(*scene), reached};
}

}  // namespace ridgecast::query
