#pragma once
// The only door to Draco: triangles with small non-negative integer positions <-> an edgebreaker stream, without loss.
// Order is not kept: points and triangles come back permuted, triangles rotated, points at pinches duplicated.
//
// Draco derives its corner table from the triangles, nearly half of an encoding's time. It cannot be handed the one that the triangulation
// has: the table is a private member of MeshEdgebreakerEncoderImpl, made inside EncodeConnectivity().

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::codec {

// Values above this are refused by both directions: Draco's predictions are exact well beyond it.
inline constexpr std::uint32_t kMaxDracoValue = (1u << 26) - 1;

// Appends to `out`; false (and nothing appended) when Draco cannot encode this mesh.
bool encodeEdgebreaker(std::span<const std::array<std::uint32_t, 3>> points, std::span<const mesh::Triangle> triangles,
                       std::vector<std::uint8_t>& out);

struct Soup {
  std::vector<std::array<std::uint32_t, 3>> points;
  std::vector<mesh::Triangle> triangles;  // indices are in range
};

// Accepts exactly the kind of stream that encodeEdgebreaker writes, with `triangles` triangles, and checks every count before Draco
// allocates for it. An empty string, or what is wrong.
std::string decodeEdgebreaker(std::span<const std::uint8_t> bytes, std::uint32_t triangles, Soup& out);

}  // namespace ridgecast::codec
