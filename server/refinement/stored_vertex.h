#pragma once
// A vertex of a mesh, as all that another mesh needs of it to have the same triangles and heights.

#include <cstdint>

#include "common/lattice/lattice.h"

namespace ridgecast::refinement {

struct StoredVertex {
  lattice::Point at;       // absolute
  std::int32_t y = 0;      // steps: the terrain's height
  std::int32_t level = 0;  // to which the mesh's is snapped
  friend bool operator==(const StoredVertex&, const StoredVertex&) = default;
};

}  // namespace ridgecast::refinement
