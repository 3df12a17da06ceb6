#pragma once
// The ground according to the mesh held by a client, always with a bound of its error. (For the true terrain: ground.h.)
//
// A place's bound is that of its leaf: the server sampled the true terrain densely (server/query/query.h) and reports the largest distance
// of the leaf's triangles from it. Leaves carry bounds if hello requested `errors`, and in answers to requests for the ground around a
// point. Otherwise `bound` is infinite.

#include <cstdint>
#include <optional>

#include "client/connection/connection.h"
#include "client/scene/scene.h"
#include "common/ground/ground.h"
#include "common/outcome/outcome.h"

namespace ridgecast::query {

struct MeshHeight {
  double height = 0;                             // metres, of the mesh
  double bound = 0;                              // metres: the true terrain is at most this much higher or lower here
  double normalX = 0, normalY = 1, normalZ = 0;  // of the triangle
};

struct MeshHit {
  double distance = 0;  // metres along the ray, to the mesh
  double bound = 0;     // metres, vertically: of the leaf that was hit
};

// Of the scene's current state; empty if no held triangle is there. Tens of microseconds.
std::optional<MeshHeight> heightOf(const scene::Scene& scene, lattice::Point at);
// The first triangle that the ray meets, from above or below. Searches the triangles of all leaves along it: milliseconds.
std::optional<MeshHit> cast(const scene::Scene& scene, const ground::Ray& ray);

// The ground around a point, as its own scene: all triangles over the circle. Waits for the server. Errors: a radius or error
// out of range; the server's refusal, which names an error that fits; an undecodable answer. `error` is what was reached: at most what was
// requested.
struct Patch {
  scene::Scene scene;
  double error = 0;
};
Outcome<Patch> groundAround(connection::Connection& connection, lattice::Point at, double radius, double error,
                            std::chrono::milliseconds timeout = std::chrono::seconds(40));

}  // namespace ridgecast::query
