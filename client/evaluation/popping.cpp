#include "client/evaluation/popping.h"

#include <algorithm>

#include "client/evaluation/ssim.h"

namespace ridgecast::evaluation {

Outcome<Popping> measurePopping(render::Renderer& renderer, const render::View& view, const std::vector<render::Morph::Leaves>& states) {
  constexpr double kFramesPerSecond = 60;
  constexpr std::size_t kFramesAnIteration = 6;
  Popping out;
  for (const bool smooth : {false, true}) {
    render::Morph morph;
    std::optional<render::Picture> last;
    std::vector<double>& changes = out.frames[smooth ? "on" : "off"];
    float lastShare = -1;
    std::uint64_t lastVersion = ~std::uint64_t{0};
    const std::size_t frames =
        states.size() * kFramesAnIteration + static_cast<std::size_t>(2 * render::kMorphSeconds * kFramesPerSecond) + 2;
    for (std::size_t frame = 0; frame < frames; ++frame) {
      const std::size_t state = std::min(frame / kFramesAnIteration, states.size() - 1);
      const double now = static_cast<double>(frame) / kFramesPerSecond;
      morph.advance(states[state], state, now, smooth);
      const float share = morph.share(now);
      if (share == lastShare && morph.version() == lastVersion) {  // the same picture
        changes.push_back(0);
        continue;
      }
      lastShare = share;
      lastVersion = morph.version();
      auto drawn = morph.active() ? renderer.drawMorph(morph.from(), morph.to(), share, view) : renderer.drawMesh(morph.to(), view);
      if (!drawn) return drawn.error();
      if (last) changes.push_back(1 - similarity(drawn->picture, *last).mean);
      last = std::move(drawn->picture);
    }
    (smooth ? out.on : out.off) = changes.empty() ? 0 : *std::ranges::max_element(changes);
  }
  return out;
}

}  // namespace ridgecast::evaluation
