#include "server/refinement/view.h"

#include <algorithm>
#include <cmath>

namespace ridgecast::refinement {

View::View(const camera::Camera& camera, lattice::Point anchor, double travelled, double turned, bool onTheWay, bool byArea)
    : x(static_cast<std::int32_t>(camera.pose.x - anchor.x)),
      z(static_cast<std::int32_t>(camera.pose.z - anchor.z)),
      y(static_cast<float>(camera.pose.y * lattice::kStepsPerMetre)),
      pixelsPerRadian(camera::pixelsPerRadian(camera.projection)),
      wide(camera.pose, camera.projection, kWidening),
      sector(camera.pose, camera.projection),
      forward(camera::forward(camera.pose)),
      right(camera::right(camera.pose)),
      up(camera::up(camera.pose)),
      tanX(std::tan(camera.projection.verticalFov / 2) * camera.projection.aspect()),
      tanY(std::tan(camera.projection.verticalFov / 2)),
      travel(travelled),
      turn(turned),
      spare(std::min(std::atan(kWidening * tanX) - std::atan(tanX), std::atan(kWidening * tanY) - std::atan(tanY))),
      moving(onTheWay),
      area(byArea),
      gain(byArea ? pixelsPerRadian * std::sqrt(pixelsPerRadian) : pixelsPerRadian) {}

}  // namespace ridgecast::refinement
