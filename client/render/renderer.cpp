#include "client/render/renderer.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <vector>

#include "common/terrain/raster.h"

namespace ridgecast::render {

HeightBounds boundsAround(const terrain::Terrain& terrain, lattice::Point centre, double radius) {
  if (const terrain::Raster* raster = terrain.raster()) {
    const terrain::RasterBounds bounds = terrain::boundsOf(raster->shape());
    return {bounds.lowest, bounds.highest};
  }
  constexpr double kMargin = 400;
  constexpr lattice::Step kSpacing = 128 << lattice::kStepBits;
  const auto n = static_cast<lattice::Step>(std::ceil(radius * lattice::kStepsPerMetre / kSpacing));
  std::vector<lattice::Step> x(static_cast<std::size_t>(2 * n + 1)), z(x.size());
  std::vector<float> heights(x.size());
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  for (lattice::Step row = -n; row <= n; ++row) {
    for (lattice::Step column = -n; column <= n; ++column) {
      x[static_cast<std::size_t>(column + n)] = centre.x + column * kSpacing;
      z[static_cast<std::size_t>(column + n)] = centre.z + row * kSpacing;
    }
    terrain.heights(x, z, heights);
    const auto [least, greatest] = std::minmax_element(heights.begin(), heights.end());
    low = std::min(low, *least);
    high = std::max(high, *greatest);
  }
  return {low - kMargin, high + kMargin};
}

double Renderer::processMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) / 1e6;
}

Renderer::Renderer(MeshPass mesh, MeshPass before, MorphPass morph, CorrectionPass correction, MarchPass march, ShadePass shade)
    : mesh_(std::move(mesh)),
      before_(std::move(before)),
      morph_(std::move(morph)),
      correction_(std::move(correction)),
      march_(std::move(march)),
      shade_(std::move(shade)) {}

Outcome<Renderer> Renderer::create(const TerrainText& terrain) {
  auto mesh = MeshPass::create(terrain.shaded);
  if (!mesh) return mesh.error();
  auto before = MeshPass::create(terrain.shaded);
  if (!before) return before.error();
  auto morph = MorphPass::create();
  if (!morph) return morph.error();
  auto correction = CorrectionPass::create(terrain);
  if (!correction) return correction.error();
  auto march = MarchPass::create(terrain);
  if (!march) return march.error();
  auto shade = ShadePass::create(terrain);
  if (!shade) return shade.error();
  return Renderer(std::move(*mesh), std::move(*before), std::move(*morph), std::move(*correction), std::move(*march), std::move(*shade));
}

Outcome<void> Renderer::fit(const View& view) {
  const std::uint32_t width = view.camera.projection.width, height = view.camera.projection.height;
  if (canvas_ && canvas_->width() == width && canvas_->height() == height) return {};
  surface_.reset();
  first_.reset();
  second_.reset();
  canvas_.reset();
  auto surface = Surface::create(width, height, mesh_.shaded());
  if (!surface) return surface.error();
  auto canvas = Canvas::create(width, height);
  if (!canvas) return canvas.error();
  surface_.emplace(std::move(*surface));
  canvas_.emplace(std::move(*canvas));
  return {};
}

Outcome<void> Renderer::fitBeside(std::optional<Surface>& surface) {
  if (surface) return {};
  auto made = Surface::create(surface_->width(), surface_->height(), mesh_.shaded());
  if (!made) return made.error();
  surface.emplace(std::move(*made));
  return {};
}

Renderer::Drawn Renderer::finish(const View& view, std::uint32_t samples, Began began) {
  shade_.shade(view, *surface_, *canvas_);
  glFinish();
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - began.wall;
  const double cpu = processMilliseconds() - began.cpu;
  return {downsample(readBack(*canvas_), samples), spent.count(), cpu};
}

Outcome<Renderer::Drawn> Renderer::drawMesh(const scene::Scene& scene, const View& view, std::uint32_t samples) {
  return drawMesh(scene.leaves(), view, samples);
}

Outcome<Renderer::Drawn> Renderer::drawMesh(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves, const View& view,
                                            std::uint32_t samples) {
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine); !fits) return fits.error();
  mesh_.update(leaves);
  glFinish();
  const Began began;
  mesh_.draw(fine, *surface_);
  return finish(fine, samples, began);
}

Outcome<Renderer::Drawn> Renderer::drawMorph(const std::map<lattice::LeafAddress, scene::HeldLeaf>& from,
                                             const std::map<lattice::LeafAddress, scene::HeldLeaf>& to, float share, const View& view,
                                             std::uint32_t samples) {
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine); !fits) return fits.error();
  for (std::optional<Surface>* surface : {&first_, &second_})
    if (auto fits = fitBeside(*surface); !fits) return fits.error();
  before_.update(from);
  mesh_.update(to);
  glFinish();
  const Began began;
  before_.draw(fine, *first_);
  mesh_.draw(fine, *second_);
  morph_.blend(*first_, *second_, share, *surface_);
  return finish(fine, samples, began);
}

Outcome<Renderer::Drawn> Renderer::drawCorrected(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves, const View& view,
                                                 std::uint32_t samples, int steps) {
  if (!correction_.canCorrect()) return drawMesh(leaves, view, samples);
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine); !fits) return fits.error();
  if (auto fits = fitBeside(first_); !fits) return fits.error();
  mesh_.update(leaves);
  glFinish();
  const Began began;
  mesh_.draw(fine, *first_);
  correction_.correct(fine, *first_, *surface_, steps);
  return finish(fine, samples, began);
}

Outcome<Renderer::Drawn> Renderer::shadeAgain(const View& view, std::uint32_t samples) {
  const View fine = supersampled(view, samples);
  if (!surface_ || surface_->width() != fine.camera.projection.width || surface_->height() != fine.camera.projection.height)
    return Error{"nothing of this size was drawn that could be coloured anew"};
  glFinish();
  return finish(fine, samples, Began());
}

std::vector<float> Renderer::positions() const {
  if (!surface_) return {};
  const std::size_t row = std::size_t{4} * surface_->width(), height = surface_->height();
  std::vector<float> drawn(row * height), out(drawn.size());
  glBindFramebuffer(GL_READ_FRAMEBUFFER, surface_->framebuffer());
  glReadBuffer(GL_COLOR_ATTACHMENT0);
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glReadPixels(0, 0, static_cast<GLsizei>(surface_->width()), static_cast<GLsizei>(surface_->height()), GL_RGBA, GL_FLOAT, drawn.data());
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
  for (std::size_t y = 0; y < height; ++y) std::copy_n(&drawn[(height - 1 - y) * row], row, &out[y * row]);
  return out;
}

double Renderer::upload(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves) {
  glFinish();
  const auto began = std::chrono::steady_clock::now();
  mesh_.update(leaves);
  glFinish();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count();
}

Outcome<Renderer::Drawn> Renderer::drawMarch(const View& view, std::uint32_t samples, float fineness) {
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine); !fits) return fits.error();
  glFinish();
  const Began began;
  march_.march(fine, *surface_, fineness);
  return finish(fine, samples, began);
}

}  // namespace ridgecast::render
