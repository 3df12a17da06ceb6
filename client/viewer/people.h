#pragma once
// How the others of a session are named and coloured, as on the page (client/web/src/ui/people.ts, render/colours.ts).

#include <cstdint>
#include <string>

#include "client/viewer/leaf_colours.h"
#include "common/camera/camera.h"
#include "common/wire/messages.h"

namespace ridgecast::viewer {

// What is sent as the client's name: at most 32 bytes of `name` without control characters; a program's own name if that is empty.
std::string ownName(const std::string& name);
std::string distanceText(double metres);  // "120 m", "3.4 km"
Colour memberColour(std::uint64_t camera);

// 60 m from `other` and 15 m above, on the side of `from`, looking at it.
camera::Pose beside(const camera::Pose& from, const camera::Pose& other);

}  // namespace ridgecast::viewer
