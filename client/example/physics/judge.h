// How far bodies are from the true ground.
#pragma once
#include <cmath>
#include <stdexcept>
#include <vector>

#include "bullet_ground.h"

// Points all over a sphere, or a box of half side `radius`, centimetres apart.
inline std::vector<btVector3> surface(const btCollisionShape& shape, float radius) {
  std::vector<btVector3> points;
  for (int i = -8; i <= 8; ++i)
    for (int j = -8; j <= 8; ++j)
      for (int axis = 0; axis < 3; ++axis)
        for (float side : {-1.0f, 1.0f}) {
          btVector3 at;
          at[axis] = side * radius;
          at[(axis + 1) % 3] = radius * float(i) / 8;
          at[(axis + 2) % 3] = radius * float(j) / 8;
          points.push_back(shape.getShapeType() == SPHERE_SHAPE_PROXYTYPE ? at.normalized() * radius : at);
        }
  return points;
}

// Metres between the true ground and a body's nearest point, vertically; negative: it is that deep in the ground.
inline double gap(const BulletGround& ground, const btRigidBody& body, rc_terrain* terrain, const std::vector<btVector3>& points) {
  std::vector<double> at;
  std::vector<float> heights(points.size());
  for (const btVector3& point : points) {
    const btVector3 here = body.getWorldTransform() * point;
    at.push_back(ground.x() + here.x());
    at.push_back(ground.z() + here.z());
  }
  if (rc_terrain_heights(terrain, at.data(), points.size(), heights.data()) != RC_OK) throw std::runtime_error(rc_message());
  double least = INFINITY;
  for (std::size_t k = 0; k < points.size(); ++k) least = std::min<double>(least, (body.getWorldTransform() * points[k]).y() - heights[k]);
  return least;
}
