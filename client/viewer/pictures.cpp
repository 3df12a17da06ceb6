#include "client/viewer/pictures.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>

#include "client/render/picture.h"

namespace ridgecast::viewer {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kAgeInterval{500};  // between redraws while leaves only age

}  // namespace

// What to draw over the mesh. The difference view compares pictures, not lines.
render::Structure Pictures::structure(const Stream& stream, const ViewerState& state) const {
  render::Structure structure;
  if (state.mode == Mode::kDifference) return structure;
  structure.wireframe = state.lines.wireframe;
  if (state.lines.borders == Borders::kLevel) structure.leafColour = [](const lattice::LeafAddress& a) { return levelColour(a.level); };
  if (state.lines.borders == Borders::kAge)
    structure.leafColour = [&ages = stream.ages(), now = nowInSeconds()](const lattice::LeafAddress& a) {
      return ageColour(ages.age(a, now));
    };
  structure.frozen = state.lines.frozen;
  if (state.lines.candidates) {
    structure.candidates = stream.candidates();
    structure.candidateColour = [unit = state.statistics.candidateUnit](float pixels) {
      return errorColour(static_cast<double>(pixels), unit);
    };
  }
  return structure;
}

Outcome<bool> Pictures::update(const render::View& view, const Stream& stream, ViewerState& state, bool newHeights) {
  mesh_.setSmooth(state.smooth);
  mesh_.setCorrected(state.corrected);
  const Lines& l = state.lines;
  const bool aged = l.borders == Borders::kAge && stream.ages().moving(nowInSeconds()) && Clock::now() - structured_ > kAgeInterval;
  const std::tuple now(state.mode == Mode::kDifference, l.wireframe, l.borders, l.frozen, l.candidates ? stream.candidates() : nullptr,
                       l.borders == Borders::kAge ? stream.sceneVersion() : 0);
  if (aged || structuredAs_ != now) {
    structured_ = Clock::now();
    structuredAs_ = now;
    mesh_.setStructure(structure(stream, state));
  }
  const bool moving = newHeights || drawn_ != view.camera;
  drawn_ = view.camera;
  bool drew = moving || aged;
  if (state.mode != Mode::kMarch) {
    auto updated = mesh_.update(view, stream.client().scene(), stream.sceneVersion(), moving || meshStale_);
    if (!updated) return updated.error();
    drew |= *updated;
  }
  meshStale_ = state.mode == Mode::kMarch && (moving || meshStale_);
  if (state.mode != Mode::kMesh) {
    auto updated = march_.update(view, moving || marchStale_);
    if (!updated) return updated.error();
    drew |= *updated;
  }
  marchStale_ = state.mode == Mode::kMesh && (moving || marchStale_);
  Statistics& s = state.statistics;
  s.drawn.meshMs = mesh_.milliseconds();
  s.drawn.corrected = mesh_.isCorrected();
  s.drawn.marchMs = march_.milliseconds();
  s.drawn.coarseness = march_.coarseness();
  s.drawn.progress = march_.progress();
  return drew;
}

bool Pictures::finished(const ViewerState& state) const {
  return !refining(state.mode) && (state.mode == Mode::kMarch || (mesh_.isAtRest() && state.statistics.settled));
}

void Pictures::present(int width, int height, const ViewerState& state) {
  const int divider = static_cast<int>(std::lround(state.meshShare() * width));
  const render::Rectangle whole{0, 0, width, height};
  if (state.mode == Mode::kDifference) {
    if (mesh_.canvas() && march_.canvas()) passes_.difference.present(*mesh_.canvas(), *march_.canvas(), width, height);
  } else {
    if (divider > 0 && mesh_.canvas()) render::present(*mesh_.canvas(), whole, {0, 0, divider, height});
    if (divider < width && march_.canvas()) render::present(*march_.canvas(), whole, {divider, 0, width - divider, height});
  }
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  glViewport(0, 0, width, height);
}

Outcome<void> saveWindow(int width, int height, const std::filesystem::path& file) {
  render::Picture picture{static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), {}, {}};
  const std::size_t row = static_cast<std::size_t>(width) * 3, rows = static_cast<std::size_t>(height);
  picture.rgb.resize(row * rows);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, picture.rgb.data());
  std::uint8_t* const top = picture.rgb.data();
  for (std::size_t y = 0; y < rows / 2; ++y) std::swap_ranges(top + y * row, top + (y + 1) * row, top + (rows - 1 - y) * row);
  return render::writePng(picture, file);
}

}  // namespace ridgecast::viewer
