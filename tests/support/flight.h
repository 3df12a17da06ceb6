#pragma once
// Cameras as functions of simulated time.

#include "common/camera/camera.h"
#include "common/terrain/terrain.h"

namespace ridgecast::testing_support {

// 1280 x 720, 60 degrees.
camera::Camera cameraAt(const terrain::Terrain& terrain, double x, double z, double altitude, double yaw, double pitch);

// Straight on at 50 m/s, 120 m above the ground, looking ahead and a little down.
camera::Camera straight(const terrain::Terrain& terrain, double seconds);

// An hour: straight, circles, hover, turn back, teleport, dive from 10 km to the ground, again and again, never twice the same.
camera::Camera hour(const terrain::Terrain& terrain, double seconds);

}  // namespace ridgecast::testing_support
