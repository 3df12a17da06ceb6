#pragma once

#include <chrono>

#include "client/core/mesh/scene.h"
#include "client/link/connection.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::query {

// The ground around a point, as its own scene: all triangles over the circle. Waits for the server. Errors: a radius or error
// out of range; the server's refusal, which names an error that fits; an undecodable answer. `error` is what was reached: at most what was
// requested.
struct Patch {
  core::Scene scene;
  double error = 0;
};
Outcome<Patch> groundAround(link::Connection& connection, lattice::Point at, double radius, double error,
                            std::chrono::milliseconds timeout = std::chrono::seconds(40));

}  // namespace ridgecast::query
