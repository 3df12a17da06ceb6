#pragma once
// The ground according to the mesh held by a client, always with a bound of its error. (For the true terrain: client/query/ground.h.)
//
// A place's bound is that of its leaf: the server sampled the true terrain densely (server/query/query.h) and reports the largest distance
// of the leaf's triangles from it. Leaves carry bounds if hello requested `errors`, and in answers to requests for the ground around a
// point. Otherwise `bound` is infinite.

#include <optional>

#include "client/core/mesh/scene.h"
#include "common/ground/ground.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

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
std::optional<MeshHeight> heightOf(const core::Scene& scene, lattice::Point at);
// The first triangle that the ray meets, from above or below. Searches the triangles of all leaves along it: milliseconds.
std::optional<MeshHit> cast(const core::Scene& scene, const ground::Ray& ray);

// The leaves of a server's answer, as a scene of their own. Error: undecodable.
Outcome<Scene> sceneOf(wire::Ground ground);

}  // namespace ridgecast::core
