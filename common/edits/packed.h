#pragma once
// Operations as bytes, for memory and disk: edits of a circle take 10 to 30, roads and polygons some 6 a corner, stamps a byte a sample
// where smooth, and almost nothing where level.
//
// The byte 1, the version of this form. Then the byte 8 m + k of the material m and the kind k: 0 raise, 1 crater, 2 level, 3 smooth,
// 4 road, 5 stamp, 6 undo. Then the fields in the order of operation.h, as varints, those that may be negative zigzag. Lists begin with
// their length; each place of a line is the difference from the one before it. Heights of an unsurveyed road are ignored and left out. A
// stamp's samples come last, as of terrain::encodeSamples.

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "common/edits/operation.h"
#include "common/outcome/outcome.h"

namespace ridgecast::edits {

// Of any valid operation.
inline constexpr std::size_t kMaxPackedBytes = 64 + std::size_t{4} * kMaxStampSide * kMaxStampSide;

// For a valid operation. Equal operations have equal bytes, others differ.
std::string pack(const Operation& operation);
// Error: not the bytes of a valid operation (check()), or not those that pack() makes of it. Allocates at most as much as the largest
// operation takes, 256 KiB.
Outcome<Operation> unpack(std::string_view bytes);
// For bytes from pack(): the number of the edit that it undoes; 0: not an undo. Allocates nothing.
std::uint64_t undoneBy(std::string_view packed);

}  // namespace ridgecast::edits
