#pragma once
#include <cstdint>
#include <span>
#include <string>

namespace ridgecast::testing_support {

inline std::span<const std::uint8_t> bytesOf(const std::string& s) { return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()}; }

}  // namespace ridgecast::testing_support
