#include "client/viewer/ground.h"

#include <cmath>
#include <cstdio>

namespace ridgecast::viewer {

Ground::Ground(const render::Drawing& drawing, replica::Client& client) : client_(client) { know(drawing); }

void Ground::know(const render::Drawing& drawing) {
  terrain_ = drawing.terrain;
  tiles_ = drawing.window;
  if (tiles_) texture_.emplace(tiles_->shape());
}

std::optional<double> Ground::height(lattice::Point p) const {
  return terrain_ && (!tiles_ || tiles_->knows(p)) ? terrain_->height(p) : client_.scene().height(p);
}

bool Ground::follow(lattice::Point camera) {
  if (!tiles_) return false;
  tiles_->moveTo(camera);
  if (auto exchanged = client_.exchangeTiles(*tiles_); !exchanged) std::fprintf(stderr, "warning: %s\n", exchanged.error().message.c_str());
  const std::uint64_t before = texture_->version();
  texture_->update(*tiles_, 16);
  return texture_->version() != before;
}

render::View Ground::view(const camera::Camera& camera) {
  render::View view;
  view.camera = camera;
  view.horizon = client_.world().horizon;
  view.heights = texture_ ? &*texture_ : nullptr;
  if (!terrain_) return view;
  constexpr double kMargin = 4000;  // metres that the camera may fly before the highest ground is computed again
  const camera::Pose& pose = camera.pose;
  const double moved = boundsAt_ ? std::hypot(static_cast<double>(pose.x - boundsAt_->x), static_cast<double>(pose.z - boundsAt_->z)) : 0;
  if (!boundsAt_ || moved * lattice::kMetresPerStep > kMargin) {
    boundsAt_ = lattice::Point{pose.x, pose.z};
    bounds_ = render::boundsAround(*terrain_, *boundsAt_, view.horizon + kMargin);
  }
  view.lowest = bounds_.lowest;
  view.highest = bounds_.highest;
  return view;
}

}  // namespace ridgecast::viewer
