#pragma once
// What the mesh that a client holds says about the ground: never without how far that may be from the truth. (The truth itself: ground.h.)
//
// The bound of a place is the one its leaf came with: the server looked at the true terrain densely (server/query/query.h) and says how far
// the leaf's triangles are from it at most. Leaves come with it when hello asked for `errors`, and in the answer to a question for the
// ground around a point; without it, `bound` is infinite.

#include <cstdint>
#include <optional>

#include "client/connection/connection.h"
#include "client/scene/scene.h"
#include "common/ground/ray.h"
#include "common/outcome/outcome.h"

namespace ridgecast::query {

struct MeshHeight {
  double height = 0;                             // metres, of the mesh
  double bound = 0;                              // metres: the true terrain is at most so much higher or lower here
  double normalX = 0, normalY = 1, normalZ = 0;  // of the triangle
};

struct MeshHit {
  double distance = 0;  // metres along the ray, to the mesh
  double bound = 0;     // metres, vertically: of the leaf that was met
};

// Of a scene as it is when asked; nothing where no held triangle is. Tens of microseconds.
std::optional<MeshHeight> heightOf(const scene::Scene& scene, lattice::Point at);
// The first triangle that the ray meets from above or below. Looks at the triangles of all leaves in its way: milliseconds.
std::optional<MeshHit> cast(const scene::Scene& scene, const ground::Ray& ray);

// The ground around a point, as a scene of its own: all triangles over the circle. Waits for the server. Errors: its, or
// what cannot be decoded. `error` is what was reached: more than was asked for when the triangle budget does not allow it.
struct Patch {
  scene::Scene scene;
  double error = 0;
};
Outcome<Patch> groundAround(connection::Connection& connection, lattice::Point at, double radius, double error,
                            std::chrono::milliseconds timeout = std::chrono::seconds(30));

}  // namespace ridgecast::query
