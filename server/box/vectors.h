#pragma once
// Internal to the room: vectors of four samples, or lines of a grid: the width that every machine supports.

#include <cstdint>
#include <cstring>

#include "common/terrain/vector_clones.h"

#define RIDGECAST_INLINE inline __attribute__((always_inline))

namespace ridgecast::box {

inline constexpr std::int32_t kLanes = 4;
typedef float Floats __attribute__((vector_size(4 * kLanes)));
typedef std::int32_t Ints __attribute__((vector_size(4 * kLanes)));
typedef double Doubles __attribute__((vector_size(8 * kLanes)));

inline constexpr Ints kNext{0, 1, 2, 3};

// From and to anywhere in memory.
template <class Vector, class T>
RIDGECAST_INLINE void load(Vector& vector, const T* from) {
  std::memcpy(&vector, from, sizeof vector);
}
template <class Vector, class T>
RIDGECAST_INLINE void store(const Vector& vector, T* to) {
  std::memcpy(to, &vector, sizeof vector);
}

}  // namespace ridgecast::box
