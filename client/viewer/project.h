#pragma once
// Where points of the world lie in the window, for what is written and drawn over the pictures.

#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "common/camera/camera.h"

namespace ridgecast::viewer {

struct Spot {
  double x = 0, y = 0;  // shares of the window's width and height, from the top left
  double depth = 0;     // metres along the axis
};

// From one camera's position to another's, in metres; exact in whole steps first.
camera::Vec3 between(const camera::Pose& from, const camera::Pose& to);

// A point in metres from the camera; nothing when it lies behind it.
std::optional<Spot> spotOf(const camera::Camera& camera, const camera::Vec3& at);

// The part of a line that lies before the camera, cut by the window's sides as well; nothing when no part does.
using Line = std::pair<Spot, Spot>;
std::optional<Line> lineOf(const camera::Camera& camera, const camera::Vec3& a, const camera::Vec3& b);

// The edges of what a camera sees up to `reach` metres: four rays and the far rectangle; ends in metres from the camera that looks at it.
std::array<std::pair<camera::Vec3, camera::Vec3>, 8> frustumEdges(const camera::Camera& seen, const camera::Pose& from, double reach);

}  // namespace ridgecast::viewer
