#pragma once
// How a gamepad moves the camera: left stick flies, right stick looks, triggers go down and up, shoulders set the speed. Values only.

#include <array>

#include "client/viewer/controls.h"

namespace ridgecast::viewer {

// As GLFW orders them: left x, left y, right x, right y (down and right are positive), left and right trigger (-1 released, 1 pressed).
using GamepadAxes = std::array<float, 6>;

// A stick's effect at `value`: none near its rest, then growing with the square, so that small turns are small.
double stick(float value);

// Adds to the input of keys and mouse; the sum stays within -1 and 1.
void addGamepad(Input& input, const GamepadAxes& axes, bool sprint, bool slower, bool faster, double seconds);

}  // namespace ridgecast::viewer
