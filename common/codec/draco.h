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
  std::vector<mesh::Triangle> triangles;
};

// Of a stream whose header was checked (codec.cpp): counts are those of `triangles` faces, values and indices are as they came. Returns an
// empty string, or what is wrong. A page has its own (client/web/wasm/draco.cpp).
std::string decodeDraco(std::span<const std::uint8_t> bytes, std::uint32_t triangles, Soup& out);

}  // namespace ridgecast::codec
