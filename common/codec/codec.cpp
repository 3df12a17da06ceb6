#include "common/codec/codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstdlib>
#include <string>
#include <utility>

#include "common/codec/draco.h"
#include "common/codec/varint.h"
#include "common/outcome/contract.h"

namespace ridgecast::codec {
namespace {

constexpr std::uint8_t kPlain = 0x10, kDraco = 0x11;
constexpr unsigned kMaxShift = 28;
constexpr std::uint32_t kMaxQuotient = 1u << 28;  // the largest difference of two values in range
constexpr std::uint32_t kPlainWorthTrying = 64;   // triangles; with more, Draco's fixed cost of about 70 bytes never decides
constexpr std::size_t kMinDracoBytes = 90;        // approximately, with header; shorter plain forms are used without trying Draco
constexpr std::size_t kMinPlainBytes = 3;         // of a vertex, and of a triangle

using Quotients = std::array<std::uint32_t, 3>;  // x, z, y: (value - least) >> shift

// How values of one coordinate become small: least value and common power of two.
struct Scale {
  std::int64_t least = 0;
  unsigned shift = 0;
};

std::array<Scale, 3> scalesOf(const std::vector<mesh::LocalVertex>& vertices) {
  const mesh::LocalVertex& first = vertices.front();
  std::array<std::int32_t, 3> least{first.x, first.z, first.y};
  std::array<std::uint32_t, 3> bits{};  // differences to the first value share the same power of two as those to the least
  for (const mesh::LocalVertex& v : vertices) {
    const std::array<std::int32_t, 3> value{v.x, v.z, v.y};
    for (std::size_t k = 0; k < 3; ++k) {
      least[k] = std::min(least[k], value[k]);
      bits[k] |= static_cast<std::uint32_t>(value[k]) - static_cast<std::uint32_t>(std::array{first.x, first.z, first.y}[k]);
    }
  }
  std::array<Scale, 3> scales;
  for (std::size_t k = 0; k < 3; ++k)
    scales[k] = {least[k], bits[k] == 0 ? 0u : std::min<unsigned>(kMaxShift, static_cast<unsigned>(std::countr_zero(bits[k])))};
  return scales;
}

void putHeader(std::vector<std::uint8_t>& out, std::uint8_t form, const std::array<Scale, 3>& scales) {
  out.push_back(form);
  const unsigned shifts = scales[0].shift | scales[1].shift << 5 | scales[2].shift << 10;
  out.push_back(static_cast<std::uint8_t>(shifts & 0xff));
  out.push_back(static_cast<std::uint8_t>(shifts >> 8));
  for (const Scale& s : scales) putVarint(out, zigzag(s.least));
}

void putPlain(std::vector<std::uint8_t>& out, const std::vector<Quotients>& points, const std::vector<mesh::Triangle>& triangles) {
  Quotients last{};
  for (const Quotients& q : points) {
    putVarint(out, q[0] - last[0]);
    for (std::size_t k = 1; k < 3; ++k) putVarint(out, zigzag(std::int64_t{q[k]} - last[k]));
    last = q;
  }
  std::uint32_t first = 0;
  for (const mesh::Triangle& t : triangles) {
    putVarint(out, t[0] - first);
    putVarint(out, t[1] - t[0] - 1);
    putVarint(out, t[2] - t[0] - 1);
    first = t[0];
  }
}

std::string decodePlain(std::span<const std::uint8_t> bytes, std::uint32_t vertices, std::uint32_t triangles, Soup& out) {
  if (bytes.size() < kMinPlainBytes * (std::size_t{vertices} + triangles)) return "it is too short for its counts";
  Reader reader(bytes);
  out.points.reserve(vertices);
  std::array<std::int64_t, 3> q{};
  for (std::uint32_t v = 0; v < vertices; ++v) {
    std::uint64_t dx = 0;
    std::int64_t dz = 0, dy = 0;
    if (!reader.varint(dx) || !reader.zigzagged(dz) || !reader.zigzagged(dy)) return "it ends within a vertex";
    q = {q[0] + static_cast<std::int64_t>(dx), q[1] + dz, q[2] + dy};
    for (std::int64_t k : q)
      if (k < 0 || k > std::int64_t{kMaxQuotient}) return "a vertex is out of range";
    out.points.push_back({static_cast<std::uint32_t>(q[0]), static_cast<std::uint32_t>(q[1]), static_cast<std::uint32_t>(q[2])});
  }
  out.triangles.reserve(triangles);
  std::uint64_t first = 0;
  for (std::uint32_t k = 0; k < triangles; ++k) {
    std::uint64_t a = 0, b = 0, c = 0;
    if (!reader.varint(a) || !reader.varint(b) || !reader.varint(c)) return "it ends within a triangle";
    first += a;
    b += first + 1;
    c += first + 1;
    if (first >= vertices || b >= vertices || c >= vertices) return "a triangle names a vertex that is not there";
    out.triangles.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(c)});
  }
  if (!reader.rest().empty()) return "it has bytes after its end";
  return {};
}

// The start of all our streams: magic, bitstream 2.2, triangular mesh, edgebreaker, no flags, standard traversal.
constexpr std::array<std::uint8_t, 12> kStart{'D', 'R', 'A', 'C', 'O', 2, 2, 1, 1, 0, 0, 0};

// Accepts only streams of encodeEdgebreaker's kind with `triangles` triangles. Checks every count before Draco allocates for it.
std::string decodeEdgebreaker(std::span<const std::uint8_t> bytes, std::uint32_t triangles, Soup& out) {
  if (bytes.size() < kStart.size() || !std::equal(kStart.begin(), kStart.end(), bytes.begin()))
    return "its Draco stream is not of the one kind that is used (2.2, edgebreaker, standard traversal, no metadata)";
  Reader reader(bytes.subspan(kStart.size()));
  std::uint64_t vertices = 0, faces = 0, symbols = 0, splits = 0;
  std::uint8_t moreAttributes = 0;
  if (!reader.varint(vertices) || !reader.varint(faces) || !reader.byte(moreAttributes) || !reader.varint(symbols) ||
      !reader.varint(splits))
    return "its Draco stream ends within its header";
  if (faces != triangles || vertices > 3 * faces || moreAttributes != 0 || symbols > faces || splits > symbols)
    return "its Draco stream does not have the announced counts";
  if (faces > 8 * static_cast<std::uint64_t>(bytes.size())) return "its Draco stream is too short for its counts";  // a bit a triangle

  if (std::string wrong = decodeDraco(bytes, triangles, out); !wrong.empty()) return wrong;
  for (const std::array<std::uint32_t, 3>& q : out.points)
    if (std::max({q[0], q[1], q[2]}) > kMaxDracoValue) return "a vertex is out of range";
  for (const mesh::Triangle& t : out.triangles)
    if (std::max({t[0], t[1], t[2]}) >= out.points.size()) return "a triangle names a vertex that is not there";
  return {};
}

std::string placeVertices(const Soup& soup, const std::array<Scale, 3>& scales, mesh::LeafMesh& leaf) {
  leaf.vertices.reserve(soup.points.size());
  for (const Quotients& q : soup.points) {
    std::array<std::int64_t, 3> value;
    for (std::size_t k = 0; k < 3; ++k) {
      value[k] = scales[k].least + (std::int64_t{q[k]} << scales[k].shift);
      if (std::abs(value[k]) > kMaxOffset) return "a vertex is out of range";
    }
    leaf.vertices.push_back(
        {static_cast<std::int32_t>(value[0]), static_cast<std::int32_t>(value[1]), static_cast<std::int32_t>(value[2])});
    if (!isInRange(leaf.vertices.back())) return "a vertex is out of range";
  }
  return {};
}

Error refusal(const std::string& why) { return {"the leaf's payload cannot be decoded: " + why}; }

}  // namespace

bool isInRange(const mesh::LocalVertex& v) {
  return v.x >= -kMaxOffset && v.x <= kMaxOffset && v.z >= -kMaxOffset && v.z <= kMaxOffset && v.y >= -lattice::kMaxHeight &&
         v.y <= lattice::kMaxHeight;
}

std::vector<std::uint8_t> encodeLeaf(const mesh::LeafMesh& leaf) {
  assert(mesh::isCanonical(leaf));
  assert(std::all_of(leaf.vertices.begin(), leaf.vertices.end(), isInRange));
  expects(leaf.vertices.size() <= 3 * leaf.triangles.size(), "a leaf has no vertices beside those of its triangles");
  if (leaf.triangles.empty()) return {};

  const std::array<Scale, 3> scales = scalesOf(leaf.vertices);
  std::vector<Quotients> points;
  points.reserve(leaf.vertices.size());
  std::uint32_t widest = 0;
  for (const mesh::LocalVertex& v : leaf.vertices) {
    const std::array<std::int64_t, 3> value{v.x, v.z, v.y};
    Quotients q;
    for (std::size_t k = 0; k < 3; ++k) {
      q[k] = static_cast<std::uint32_t>((value[k] - scales[k].least) >> scales[k].shift);
      widest = std::max(widest, q[k]);
    }
    points.push_back(q);
  }

  std::vector<std::uint8_t> plain, draco;
  const auto encodePlain = [&] {
    putHeader(plain, kPlain, scales);
    putPlain(plain, points, leaf.triangles);
  };
  if (leaf.triangles.size() <= kPlainWorthTrying) {
    encodePlain();
    if (plain.size() <= kMinDracoBytes) return plain;
  }
  bool hasDraco = false;
  if (widest <= kMaxDracoValue) {
    draco.reserve(128 + 4 * leaf.triangles.size());
    putHeader(draco, kDraco, scales);
    hasDraco = encodeEdgebreaker(points, leaf.triangles, draco);
  }
  if (!hasDraco && plain.empty()) encodePlain();
  return hasDraco && (plain.empty() || draco.size() < plain.size()) ? draco : plain;
}

Outcome<mesh::LeafMesh> decodeLeaf(std::span<const std::uint8_t> payload, lattice::LeafAddress address, std::uint32_t vertices,
                                   std::uint32_t triangles, const Limits& limits) {
  mesh::LeafMesh leaf{.address = address, .vertices = {}, .triangles = {}};
  if (triangles == 0 && vertices == 0) {
    if (!payload.empty()) return refusal("it should be empty like the leaf");
    return leaf;
  }
  if (triangles == 0 || vertices < 3 || vertices > std::uint64_t{3} * triangles) return refusal("its counts contradict each other");
  if (triangles > limits.maxTriangles)
    return refusal("it announces " + std::to_string(triangles) + " triangles, at most " + std::to_string(limits.maxTriangles) +
                   " are accepted");
  if (payload.size() > limits.maxPayloadBytes || payload.size() > largestPayload(triangles))
    return refusal("it is too long for its counts");

  Reader reader(payload);
  std::uint8_t form = 0, low = 0, high = 0;
  if (!reader.byte(form) || !reader.byte(low) || !reader.byte(high)) return refusal("it ends within its header");
  if (form != kPlain && form != kDraco) return refusal("its form is unknown; known are 0x10 and 0x11");
  const unsigned shifts = low | static_cast<unsigned>(high) << 8;
  std::array<Scale, 3> scales;
  for (std::size_t k = 0; k < 3; ++k) {
    scales[k].shift = shifts >> (5 * k) & 31;
    if (scales[k].shift > kMaxShift || shifts > 0x7fff) return refusal("its shifts are out of range");
    if (!reader.zigzagged(scales[k].least)) return refusal("it ends within its header");
    if (std::abs(scales[k].least) > kMaxOffset) return refusal("its least coordinates are out of range");
  }

  Soup soup;
  std::string wrong =
      form == kPlain ? decodePlain(reader.rest(), vertices, triangles, soup) : decodeEdgebreaker(reader.rest(), triangles, soup);
  if (wrong.empty()) wrong = placeVertices(soup, scales, leaf);
  if (!wrong.empty()) return refusal(wrong);
  leaf.triangles = std::move(soup.triangles);
  mesh::canonicalize(leaf);
  if (leaf.vertices.size() != vertices || leaf.triangles.size() != triangles) return refusal("it does not have the announced counts");
  for (const mesh::Triangle& t : leaf.triangles)
    if (mesh::orientation(leaf.vertices[t[0]], leaf.vertices[t[1]], leaf.vertices[t[2]]) <= 0)
      return refusal("a triangle is not counter-clockwise");
  if (!mesh::isCanonical(leaf)) return refusal("two vertices share a place, or two triangles are the same");
  return leaf;
}

}  // namespace ridgecast::codec
