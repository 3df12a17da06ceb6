#include "client/viewer/ground.h"

#include <cmath>
#include <cstdio>
#include <utility>

#include "common/edits/edited_terrain.h"

namespace ridgecast::viewer {

Ground::Ground(const render::Drawing& drawing, link::Client& client) : client_(client), edits_(client.world().horizon) { know(drawing); }

void Ground::know(const render::Drawing& drawing) {
  terrain_ = edited_ = drawing.terrain;
  editsSeen_ = 0;
  tiles_ = drawing.window;
  if (tiles_) texture_.emplace(tiles_->shape());
}

std::optional<double> Ground::height(lattice::Point p) const {
  return terrain_ && (!tiles_ || tiles_->knows(p)) ? edited_->height(p) : client_.scene().height(p);
}

bool Ground::follow(lattice::Point camera) {
  const bool edited = followEdits(camera);
  if (!tiles_) return edited;
  tiles_->moveTo(camera);
  if (auto exchanged = client_.exchangeTiles(*tiles_); !exchanged) std::fprintf(stderr, "warning: %s\n", exchanged.error().message.c_str());
  const std::uint64_t before = texture_->version();
  texture_->update(*tiles_, 16);
  return edited || texture_->version() != before;
}

bool Ground::followEdits(lattice::Point camera) {
  if (!terrain_) return false;
  edits_.moveTo(camera);
  if (auto exchanged = client_.exchangeEdits(edits_); !exchanged) std::fprintf(stderr, "warning: %s\n", exchanged.error().message.c_str());
  if (std::exchange(editsSeen_, edits_.version()) != edits_.version())
    edited_ = std::make_shared<edits::EditedTerrain>(terrain_, edits_.layer());
  const std::uint64_t before = editTexture_.version();
  editTexture_.update(edits_, camera);
  return editTexture_.version() != before;
}

render::View Ground::view(const camera::Camera& camera) {
  render::View view;
  view.camera = camera;
  view.horizon = client_.world().horizon;
  view.heights = texture_ ? &*texture_ : nullptr;
  view.edits = &editTexture_;
  if (!terrain_) return view;
  constexpr double kMargin = 4000;  // metres that the camera may fly before the highest ground is computed again
  const camera::Pose& pose = camera.pose;
  const double moved = boundsAt_ ? std::hypot(static_cast<double>(pose.x - boundsAt_->x), static_cast<double>(pose.z - boundsAt_->z)) : 0;
  if (!boundsAt_ || moved * lattice::kMetresPerStep > kMargin) {
    boundsAt_ = lattice::Point{pose.x, pose.z};
    bounds_ = render::boundsAround(*terrain_, *boundsAt_, view.horizon + kMargin);
  }
  const render::HeightBounds bounds = render::withEdits(bounds_, edited_->edits(), *boundsAt_, view.horizon + kMargin);
  view.lowest = bounds.lowest;
  view.highest = bounds.highest;
  return view;
}

}  // namespace ridgecast::viewer
