#pragma once
// What ground is made of, as a number. 0: it is not said. 1 to 8 are kMaterials, on every terrain, and as edits paint them. Then come the
// terrain's own (Terrain::ownMaterials).

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ridgecast::terrain {

inline constexpr std::array<const char*, 8> kMaterials{"earth", "rock", "gravel", "sand", "grass", "asphalt", "concrete", "snow"};
inline constexpr std::size_t kMaxOwnMaterials = 64;

bool isMaterialName(std::string_view name);  // 1 to 32 of a-z 0-9 _ -
// 0: no material has this name.
std::uint8_t materialNumber(std::string_view name, std::span<const std::string> own = {});
// Empty: it is not said, or no material has this number.
std::string_view materialName(std::uint8_t material, std::span<const std::string> own);
std::vector<std::string> materialNames(std::span<const std::string> own);  // by number, the first empty

}  // namespace ridgecast::terrain
