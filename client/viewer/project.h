#pragma once
// Projects points of the world into the window, for text and lines over the pictures.

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

// From one camera's position to another's, in metres; differences are taken in whole steps first, so they are exact.
camera::Vec3 between(const camera::Pose& from, const camera::Pose& to);

// A point in metres from the camera; empty if it lies behind.
std::optional<Spot> spotOf(const camera::Camera& camera, const camera::Vec3& at);

// From the camera through a place of the window, in shares as Spot's; of any length.
camera::Vec3 towards(const camera::Camera& camera, double x, double y);

// The part of a line in front of the camera, clipped by the window's sides; empty if there is none.
using Segment = std::pair<Spot, Spot>;
std::optional<Segment> segmentOf(const camera::Camera& camera, const camera::Vec3& a, const camera::Vec3& b);

// The edges of what a camera sees up to `reach` metres: four rays and the far rectangle. Ends in metres from the viewing camera.
std::array<std::pair<camera::Vec3, camera::Vec3>, 8> frustumEdges(const camera::Camera& seen, const camera::Pose& from, double reach);

}  // namespace ridgecast::viewer
