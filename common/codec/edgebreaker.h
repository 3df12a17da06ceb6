#pragma once
// The only access to Draco: triangles with small non-negative integer positions <-> an edgebreaker stream, without loss. Order is not kept:
// points and triangles come back permuted, triangles rotated, points at pinches duplicated.
//
// Draco derives its corner table from the triangles, nearly half of an encoding's time. It cannot use the triangulation's: the table is a
// private member of MeshEdgebreakerEncoderImpl, made inside EncodeConnectivity().

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::codec {

// Both directions refuse larger values. Draco's predictions are exact well beyond it.
inline constexpr std::uint32_t kMaxDracoValue = (1u << 26) - 1;

// Appends to `out`. False, with nothing appended, if Draco cannot encode this mesh.
bool encodeEdgebreaker(std::span<const std::array<std::uint32_t, 3>> points, std::span<const mesh::Triangle> triangles,
                       std::vector<std::uint8_t>& out);

struct Soup {
  std::vector<std::array<std::uint32_t, 3>> points;
  std::vector<mesh::Triangle> triangles;  // indices are in range
};

// Accepts only streams of encodeEdgebreaker's kind with `triangles` triangles. Checks every count before Draco allocates for it. Returns an
// empty string, or what is wrong.
std::string decodeEdgebreaker(std::span<const std::uint8_t> bytes, std::uint32_t triangles, Soup& out);

}  // namespace ridgecast::codec
