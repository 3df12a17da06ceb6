// A camera path's file: refused with a sentence, or a path that can be flown.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "common/camera/path.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ridgecast;
  const auto path = camera::parsePath({reinterpret_cast<const char*>(data), size});
  if (!path) {
    if (path.error().message.empty()) std::abort();
    return 0;
  }
  for (double share : {-1.0, 0.0, 0.37, 1.0, 2.0}) {
    camera::Camera camera;
    camera.pose = camera::poseAt(*path, share * path->duration(), [](lattice::Point) { return 12.5; });
    camera.projection.verticalFov = path->verticalFov;
    if (!camera::isValid(camera)) std::abort();
  }
  return 0;
}
