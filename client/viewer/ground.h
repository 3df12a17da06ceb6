#pragma once
// What this client knows of the ground itself: the terrain's function, or the tiles of a height map around the camera, and the edits. Main
// thread only.

#include <optional>

#include "client/link/client.h"
#include "client/render/edit_texture.h"
#include "client/render/height_texture.h"
#include "client/render/local_terrain.h"
#include "client/render/renderer.h"

namespace ridgecast::viewer {

class Ground {
 public:
  Ground(const render::Drawing& drawing, link::Client& client);
  // Sets the terrain, unknown so far. A height map's tiles are then fetched by follow().
  void know(const render::Drawing& drawing);
  bool hasFunction() const { return terrain_ != nullptr; }
  // Metres, of the mesh where the terrain is not known; empty if neither is.
  std::optional<double> height(lattice::Point p) const;
  // Fetches tiles and edits around the camera. Whether what is drawn has changed.
  bool follow(lattice::Point camera);
  double knownReach() const { return tiles_ ? tiles_->knownReach() : 0; }  // metres; 0: everywhere
  render::View view(const camera::Camera& camera);

 private:
  link::Client& client_;
  bool followEdits(lattice::Point camera);

  std::shared_ptr<const terrain::Terrain> terrain_;  // null: not known here
  core::HeldEdits edits_;
  std::uint64_t editsSeen_ = 0;
  std::shared_ptr<const terrain::Terrain> edited_;  // terrain_ with these edits
  render::EditTexture editTexture_;
  std::shared_ptr<core::HeightWindow> tiles_;  // of a height map, the same terrain; otherwise null
  std::optional<render::HeightTexture> texture_;
  std::optional<lattice::Point> boundsAt_;
  render::HeightBounds bounds_;
};

}  // namespace ridgecast::viewer
