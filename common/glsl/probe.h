#pragma once
// Tries a compiled terrain before the server loads it, in a process of its own under limits of time and memory (RLIMIT_AS, RLIMIT_STACK),
// at points near the origin and out to the lattice's end: heights, materials, and colours as a snapshot will compute them.

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "common/terrain/variants.h"

namespace ridgecast::glsl {

// What is wrong with a height, as a sentence's end ("is not a number", ...); empty: nothing.
std::string_view faultOf(float height);

// "is no number of 0 to 9", of a material.
std::string materialFault(std::size_t most);

// "x 1234.5 m, z -17 m"
std::string placeText(lattice::Step x, lattice::Step z);

// Starts `program`, whose main() calls asProbe first, to try `library`, which compile() made; its materials are 0 to `mostMaterial`.
// Error: the first fault with its position (and line, if the library is traced), a crash, more than `time` of a processor, or a stop.
// Else advice, in the form of complaints.h, or nothing.
Outcome<std::string> probe(std::string_view file, const std::filesystem::path& library, std::size_t mostMaterial, std::uint32_t seed,
                           const std::filesystem::path& program, const std::stop_token& stop = {},
                           std::chrono::seconds time = std::chrono::seconds(20));

inline constexpr std::string_view kTheColour = "the colour at ";  // begins what is said of one

// In a process that probe() started: limits itself and tries the library. Its exit status; nothing: the arguments are not probe()'s.
std::optional<int> asProbe(int argc, char** argv);

}  // namespace ridgecast::glsl
