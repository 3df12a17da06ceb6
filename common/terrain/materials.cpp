#include "common/terrain/materials.h"

#include <algorithm>

namespace ridgecast::terrain {

bool isMaterialName(std::string_view name) {
  return !name.empty() && name.size() <= 32 &&
         std::ranges::all_of(name, [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-'; });
}

std::string_view materialName(std::uint8_t material, std::span<const std::string> own) {
  if (material == 0) return {};
  if (material <= kMaterials.size()) return kMaterials[material - 1];
  const std::size_t k = material - kMaterials.size() - 1;
  return k < own.size() ? std::string_view(own[k]) : std::string_view();
}

}  // namespace ridgecast::terrain
