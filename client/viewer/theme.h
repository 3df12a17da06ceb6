#pragma once
// Colours, sizes and font of what is drawn over the pictures: one look with the page (client/web/src/style.css; a test compares them).

#include <cmath>
#include <cstdint>

namespace ridgecast::viewer::theme {

struct Shade {
  std::uint32_t rgb = 0;  // 0xRRGGBB
  float alpha = 1;
};
inline constexpr Shade kGround{0x10161d}, kDialog{0x131c25}, kGlass{0x0d131a, 0.78f}, kField{0x1b2631}, kEdge{0xffffff, 0.16f};
inline constexpr Shade kText{0xe9eff5}, kMuted{0xa9b6c2}, kAccent{0x8fc1e8}, kOnAccent{0x0d131a}, kWarning{0xd9a441};

// As Dear ImGui packs colours.
inline std::uint32_t packed(const Shade& s, float alpha = 1) {
  const auto opacity = static_cast<std::uint32_t>(std::lround(s.alpha * alpha * 255));
  return opacity << 24 | (s.rgb & 0xff) << 16 | (s.rgb & 0xff00) | s.rgb >> 16;
}

// Sets Dear ImGui's style and font; `scale`: pixels of text and edges relative to an ordinary screen's. The font's texture must be rebuilt
// then. Without Debian's fonts-dejavu-core Dear ImGui's own font is used.
void apply(float scale);

}  // namespace ridgecast::viewer::theme
