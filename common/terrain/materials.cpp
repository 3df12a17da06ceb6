#include "common/terrain/materials.h"

#include <algorithm>

namespace ridgecast::terrain {

bool isMaterialName(std::string_view name) {
  return !name.empty() && name.size() <= 32 &&
         std::ranges::all_of(name, [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-'; });
}

std::uint8_t materialNumber(std::string_view name, std::span<const std::string> own) {
  const auto shared = std::ranges::find(kMaterials, name);
  if (shared != kMaterials.end()) return static_cast<std::uint8_t>(1 + (shared - kMaterials.begin()));
  const auto found = std::ranges::find(own, name);
  return found == own.end() ? std::uint8_t{0} : static_cast<std::uint8_t>(1 + std::ssize(kMaterials) + (found - own.begin()));
}

std::string_view materialName(std::uint8_t material, std::span<const std::string> own) {
  if (material == 0) return {};
  if (material <= kMaterials.size()) return kMaterials[material - 1];
  const std::size_t k = material - kMaterials.size() - 1;
  return k < own.size() ? std::string_view(own[k]) : std::string_view();
}

std::vector<std::string> materialNames(std::span<const std::string> own) {
  std::vector<std::string> out{""};
  out.insert(out.end(), kMaterials.begin(), kMaterials.end());
  out.insert(out.end(), own.begin(), own.end());
  return out;
}

}  // namespace ridgecast::terrain
