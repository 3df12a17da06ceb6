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
    return withEdits({bounds.lowest, bounds.highest}, terrain.edits(), centre, radius);
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
  return withEdits({low - kMargin, high + kMargin}, terrain.edits(), centre, radius);
}

HeightBounds withEdits(HeightBounds own, const terrain::Raster* edits, lattice::Point centre, double radius) {
  if (!edits) return own;
  terrain::RasterShape shape = edits->shape();
  const auto reach = static_cast<lattice::Step>(radius * lattice::kStepsPerMetre);
  const std::int64_t x = shape.x.at(centre.x - reach).sample, z = shape.z.at(centre.z - reach).sample;
  const auto range = edits->range(x, z, shape.x.at(centre.x + reach).sample - x + 1, shape.z.at(centre.z + reach).sample - z + 1);
  shape.lowest = range.lowest;
  shape.highest = range.highest;
  const terrain::RasterBounds rise = terrain::boundsOf(shape);
  return {own.lowest + std::min(0.0, rise.lowest), own.highest + std::max(0.0, rise.highest)};
}

double Renderer::processMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) / 1e6;
}

Outcome<Passes> Passes::create(const TerrainText& terrain) {
  auto mesh = MeshPass::create(terrain.shaded), before = MeshPass::create(terrain.shaded);
  auto morph = MorphPass::create();
  auto correction = CorrectionPass::create(terrain);
  auto march = MarchPass::create(terrain);
  auto shade = ShadePass::create(terrain);
  std::optional<Error> error;
  const auto check = [&error](const auto& made) {
    if (!made && !error) error = made.error();
  };
  (check(mesh), check(before), check(morph), check(correction), check(march), check(shade));
  if (error) return *error;
  return Passes{std::move(*mesh), std::move(*before), std::move(*morph), std::move(*correction), std::move(*march), std::move(*shade)};
}

Outcome<Renderer> Renderer::create(const TerrainText& terrain) {
  auto passes = Passes::create(terrain);
  if (!passes) return passes.error();
  return Renderer(std::move(*passes));
}

// `beside`: what the drawing needs beside the surface. Nothing of another size is kept.
Outcome<void> Renderer::fit(const View& view, std::initializer_list<std::optional<Surface>*> beside) {
  const std::uint32_t width = view.camera.projection.width, height = view.camera.projection.height;
  if (!canvas_ || canvas_->width() != width || canvas_->height() != height) {
    first_.reset();
    second_.reset();
    canvas_.reset();
  }
  if (auto fits = render::fit(surface_, width, height, passes_.mesh.shaded()); !fits) return fits;
  for (std::optional<Surface>* surface : beside)
    if (auto fits = render::fit(*surface, width, height, passes_.mesh.shaded()); !fits) return fits;
  return render::fit(canvas_, width, height);
}

Renderer::Drawn Renderer::finish(const View& view, std::uint32_t samples, Began began) {
  passes_.shade.shade(view, *surface_, *canvas_);
  glFinish();
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - began.wall;
  const double cpu = processMilliseconds() - began.cpu;
  return {downsample(readBack(*canvas_), samples), spent.count(), cpu};
}

Outcome<Renderer::Drawn> Renderer::drawMesh(const core::Leaves& leaves, const View& view, std::uint32_t samples) {
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine); !fits) return fits.error();
  passes_.mesh.update(leaves);
  glFinish();
  const Began began;
  passes_.mesh.draw(fine, *surface_);
  return finish(fine, samples, began);
}

Outcome<Renderer::Drawn> Renderer::drawMorph(const core::Leaves& from, const core::Leaves& to, float share, const View& view) {
  if (auto fits = fit(view, {&first_, &second_}); !fits) return fits.error();
  passes_.before.update(from);
  passes_.mesh.update(to);
  glFinish();
  const Began began;
  passes_.before.draw(view, *first_);
  passes_.mesh.draw(view, *second_);
  passes_.morph.blend(*first_, *second_, share, *surface_);
  return finish(view, 1, began);
}

Outcome<Renderer::Drawn> Renderer::drawCorrected(const core::Leaves& leaves, const View& view, std::uint32_t samples, int steps) {
  if (!passes_.correction.canCorrect()) return drawMesh(leaves, view, samples);
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine, {&first_}); !fits) return fits.error();
  passes_.mesh.update(leaves);
  glFinish();
  const Began began;
  passes_.mesh.draw(fine, *first_);
  passes_.correction.correct(fine, *first_, *surface_, steps);
  return finish(fine, samples, began);
}

Outcome<Renderer::Drawn> Renderer::shadeAgain(const View& view, std::uint32_t samples) {
  const View fine = supersampled(view, samples);
  if (!surface_ || surface_->width() != fine.camera.projection.width || surface_->height() != fine.camera.projection.height)
    return Error{"nothing of this size was drawn that could be coloured again"};
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

double Renderer::upload(const core::Leaves& leaves) {
  glFinish();
  const auto began = std::chrono::steady_clock::now();
  passes_.mesh.update(leaves);
  glFinish();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count();
}

Outcome<Renderer::Drawn> Renderer::drawMarch(const View& view, std::uint32_t samples, float fineness) {
  const View fine = supersampled(view, samples);
  if (auto fits = fit(fine); !fits) return fits.error();
  glFinish();
  const Began began;
  passes_.march.march(fine, *surface_, fineness);
  return finish(fine, samples, began);
}

}  // namespace ridgecast::render
