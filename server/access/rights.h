#pragma once
// What somebody may do here. Names are those of token files and of the claim "rights" in a JWT.

#include <cstdint>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::access {

enum class Right : std::uint8_t {
  kView = 1,      // see sessions: streams, the list of sessions, figures
  kCreate = 2,    // create sessions
  kQuery = 4,     // ask for heights, normals and rays
  kSnapshot = 8,  // take glTF snapshots
};

std::string_view name(Right right);

class Rights {
 public:
  constexpr Rights() = default;
  constexpr Rights(Right right) : bits_(static_cast<std::uint8_t>(right)) {}
  static constexpr Rights all() { return Rights(Right::kView) | Right::kCreate | Right::kQuery | Right::kSnapshot; }
  constexpr bool has(Right right) const { return (bits_ & static_cast<std::uint8_t>(right)) != 0; }
  constexpr bool empty() const { return bits_ == 0; }
  constexpr Rights operator|(Rights other) const {
    Rights both;
    both.bits_ = static_cast<std::uint8_t>(bits_ | other.bits_);
    return both;
  }
  constexpr bool operator==(const Rights&) const = default;

 private:
  std::uint8_t bits_ = 0;
};

// "view,query" -> rights. Error: none is named, or one that there is not.
Outcome<Rights> parseRights(std::string_view text);
std::string toText(Rights rights);  // "view,query"

}  // namespace ridgecast::access
