#include "client/render/warming.h"

#include <optional>

#include "client/render/height_texture.h"
#include "client/render/local_terrain.h"
#include "client/render/renderer.h"

namespace ridgecast::render {

void warm(const wire::World& world) {
  const Drawing drawing = drawingOf(world, true);
  if (drawing.text.neutral) return;
  auto renderer = Renderer::create(drawing.text);
  if (!renderer) return;
  View view;
  view.camera.projection.width = view.camera.projection.height = 16;
  std::optional<HeightTexture> heights;
  if (drawing.window)
    view.heights = &heights.emplace(drawing.window->shape());
  else
    view.camera.pose.y = drawing.terrain->height({0, 0}) + 100;
  view.horizon = 1000;
  (void)renderer->drawMarch(view);
  (void)renderer->drawCorrected({}, view);
}

}  // namespace ridgecast::render
