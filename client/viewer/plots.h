#pragma once
// Plots with axes and units, drawn into the current window of Dear ImGui. Internal to the room.

#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

// `width`: of the plots with their axes, pixels.
void drawPlots(const Plots& plots, float width);

}  // namespace ridgecast::viewer
