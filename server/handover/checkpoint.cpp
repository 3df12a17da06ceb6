#include "server/handover/checkpoint.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <span>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"
#include "common/points/points.h"
#include "common/points/range_coder.h"
#include "server/refinement/stored_vertex.h"

namespace ridgecast::handover {

using lattice::LeafAddress;
using points::Probability;
using points::RangeDecoder;
using points::RangeEncoder;
using refinement::StoredVertex;

namespace {

constexpr std::uint8_t kForm = 0x40;
constexpr int kRootLevel = points::kOpenLevel;
constexpr std::size_t kMaxRoots = 256;
constexpr std::size_t kHead = 1 + 4 * 8 + 2 * 4, kTail = 8;

void put(std::vector<std::uint8_t>& out, std::uint64_t v, int bytes) {
  for (int k = 0; k < bytes; ++k) out.push_back(static_cast<std::uint8_t>(v >> (8 * k)));
}
std::uint64_t take(std::span<const std::uint8_t>& in, int bytes) {
  std::uint64_t v = 0;
  for (int k = 0; k < bytes; ++k) v |= std::uint64_t{in[static_cast<std::size_t>(k)]} << (8 * k);
  in = in.subspan(static_cast<std::size_t>(bytes));
  return v;
}

std::uint64_t hashOf(std::span<const std::uint8_t> bytes) {
  std::uint64_t hash = bytes.size();
  for (std::size_t k = 0; k < bytes.size(); k += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, &bytes[k], std::min<std::size_t>(8, bytes.size() - k));
    hash = lattice::mix(hash + lattice::mix(word));
  }
  return hash;
}

// One walk for both directions, as common/points.
template <class Coder>
class Walk {
 public:
  explicit Walk(Coder& coder) : coder_(coder) {}

  // A Walk that decodes ignores what it is given, and returns what it read.
  std::uint64_t number(int bits, std::uint64_t v) {
    std::uint64_t out = 0;
    for (int k = bits; k-- > 0;) out = out << 1 | std::uint64_t{coder_.even(v >> k & 1)};
    return out;
  }
  // Leaves below a root, `leaves` in canonical order. False: too many, or the bytes have ended.
  bool tree(const LeafAddress& node, const std::vector<LeafAddress>& leaves, std::vector<LeafAddress>& found) {
    const bool isLeaf = !Coder::kDecodes && std::ranges::binary_search(leaves, node);
    bool& last = lastSplit_[static_cast<std::size_t>(node.level)];
    last = node.level > 0 && coder_.bit(split_[static_cast<std::size_t>(node.level)][last], !isLeaf);
    if (coder_.failed() || found.size() >= kMaxLeaves) return false;
    if (!last) return found.push_back(node), true;
    for (int k = 0; k < 4; ++k)
      if (!tree(node.child(k), leaves, found)) return false;
    return true;
  }
  // A vertex in a square of this level, whose unedited height is `base`.
  void vertex(int level, std::int32_t base, StoredVertex& v) {
    const int top = std::min(level + 1, lattice::kMaxLevel);
    int l = top;
    expects(Coder::kDecodes || (v.level >= 0 && v.level <= top), "a vertex is snapped to a level at most one above its leaf's");
    while (l > 0 && coder_.bit(finer_[static_cast<std::size_t>(top - l)][lastFiner_], v.level < l)) --l;
    lastFiner_ = static_cast<std::size_t>(std::min(top - l, 2));
    v.level = l;
    isRaised_ = coder_.bit(raised_[isRaised_], v.y != base);
    v.y = isRaised_ ? base + rise(v.y - base) : base;
  }

 private:
  // Not 0, less than 2^28 either way.
  std::int32_t rise(std::int32_t v) {
    const auto size = static_cast<std::uint32_t>(std::abs(v));
    int length = std::bit_width(size) - 1, k = 0;
    while (k < 27 && coder_.bit(length_[static_cast<std::size_t>(k)], k < length)) ++k;
    std::uint32_t out = 1;
    for (int at = k; at-- > 0;) out = out << 1 | std::uint32_t{coder_.even(size >> at & 1)};
    return coder_.even(v < 0) ? -static_cast<std::int32_t>(out) : static_cast<std::int32_t>(out);
  }

  Coder& coder_;
  std::array<std::array<Probability, 2>, kRootLevel + 1> split_;  // by level; by whether the last node of it did
  std::array<bool, kRootLevel + 1> lastSplit_{};
  std::array<std::array<Probability, 3>, lattice::kMaxLevel + 1> finer_;
  std::size_t lastFiner_ = 0;
  std::array<Probability, 2> raised_;
  std::array<Probability, 27> length_;
  bool isRaised_ = false;
};

// Roots lie within 2^15 of the first.
template <class Coder>
bool codeLeaves(Coder& coder, std::vector<LeafAddress>& leaves) {
  std::vector<LeafAddress> roots;
  if constexpr (!Coder::kDecodes) {
    for (const LeafAddress& leaf : leaves) roots.push_back(lattice::leafAt({leaf.x(), leaf.z()}, kRootLevel));
    std::ranges::sort(roots);
    roots.erase(std::unique(roots.begin(), roots.end()), roots.end());
  }
  Walk<Coder> walk(coder);
  std::vector<LeafAddress> found;
  const auto count = static_cast<std::size_t>(walk.number(9, roots.size()));
  if (count == 0 || count > kMaxRoots) return false;
  roots.resize(count);
  const auto index = [&](std::int64_t v) { return static_cast<std::int64_t>(walk.number(64, static_cast<std::uint64_t>(v))); };
  const LeafAddress first{kRootLevel, index(roots.front().i), index(roots.front().j)};
  if (!lattice::addressIsValid(first)) return false;
  for (LeafAddress& root : roots) {
    const auto offset = [&](std::int64_t v, std::int64_t from) {
      return from + static_cast<std::int64_t>(walk.number(16, static_cast<std::uint64_t>(v - from + 32'768))) - 32'768;
    };
    root = {kRootLevel, offset(root.i, first.i), offset(root.j, first.j)};
    if (!lattice::addressIsValid(root) || !walk.tree(root, leaves, found)) return false;
  }
  std::ranges::sort(found);
  expects(Coder::kDecodes || found == leaves, "a mesh's leaves are those of a quadtree");
  leaves = std::move(found);
  return true;
}

// The unedited heights at these vertices.
std::vector<std::int32_t> heightsAt(const terrain::Terrain& ground, std::span<const StoredVertex> vertices) {
  std::vector<lattice::Step> x, z;
  for (const StoredVertex& v : vertices) {
    x.push_back(v.at.x);
    z.push_back(v.at.z);
  }
  std::vector<std::int32_t> y(vertices.size());
  const auto* const edited = dynamic_cast<const edits::EditedTerrain*>(&ground);
  (edited ? *edited->base() : ground).heightSteps(x, z, y);
  return y;
}

// f(vertex, base, level of its square)
template <class F>
void forEachVertex(std::span<const points::Change> squares, std::vector<StoredVertex>& vertices, std::span<const std::int32_t> bases,
                   F&& f) {
  std::size_t k = 0;
  for (const points::Change& square : squares)
    for (std::size_t n = 0; n < square.inserted.size(); ++n, ++k) f(vertices[k], bases[k], square.square.level);
}

}  // namespace

std::optional<std::string> encode(const Checkpoint& checkpoint, const terrain::Terrain& ground) {
  std::vector<LeafAddress> leaves = checkpoint.mesh.leaves;
  expects(!leaves.empty() && leaves.size() <= kMaxLeaves, "a mesh has leaves");
  std::vector<std::uint8_t> tree, places, heights;
  RangeEncoder treeCoder(tree);
  expects(codeLeaves(treeCoder, leaves), "what is written can be");
  treeCoder.finish();

  std::vector<points::Change> squares;
  auto leaf = leaves.begin();
  for (const StoredVertex& v : checkpoint.mesh.vertices) {
    while (leaf != leaves.end() && !leaf->contains(v.at)) ++leaf;
    const LeafAddress square = leaf != leaves.end() ? *leaf : lattice::leafAt(v.at, points::kOpenLevel);
    if (squares.empty() || squares.back().square != square) squares.push_back({square, {}, {}, {}});
    squares.back().inserted.push_back({static_cast<std::int32_t>(v.at.x - square.x()), static_cast<std::int32_t>(v.at.z - square.z())});
  }
  points::Writer writer(places);
  expects(writer.changes(
              {leaves, leaves, {}}, [](const LeafAddress&) { return 0u; }, squares),
          "vertices come in their order");
  writer.finish();

  std::vector<StoredVertex> vertices = checkpoint.mesh.vertices;
  const std::vector<std::int32_t> bases = heightsAt(ground, vertices);
  RangeEncoder heightCoder(heights);
  Walk<RangeEncoder> walk(heightCoder);
  forEachVertex(squares, vertices, bases, [&](StoredVertex& v, std::int32_t base, int level) { walk.vertex(level, base, v); });
  heightCoder.finish();

  if (kHead + tree.size() + places.size() + heights.size() + kTail > kMaxBytes) return {};
  std::vector<std::uint8_t> out{kForm};
  for (std::uint64_t v :
       {checkpoint.contentHash, checkpoint.edit, checkpoint.meshHash, std::bit_cast<std::uint64_t>(checkpoint.mesh.effectiveThreshold)})
    put(out, v, 8);
  put(out, tree.size(), 4);
  put(out, places.size(), 4);
  for (const auto* part : {&tree, &places, &heights}) out.insert(out.end(), part->begin(), part->end());
  put(out, hashOf(out), 8);
  return std::string(out.begin(), out.end());
}

Outcome<Checkpoint> decode(std::string_view bytes, std::uint64_t contentHash, const terrain::Terrain& ground, std::size_t maxVertices) {
  const Error damaged{"A checkpoint of a camera is damaged."};
  if (bytes.size() < kHead + kTail || bytes.size() > kMaxBytes || static_cast<std::uint8_t>(bytes.front()) != kForm) return damaged;
  std::span<const std::uint8_t> all(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  std::span<const std::uint8_t> tail = all.last(kTail), rest = all.subspan(1, all.size() - 1 - kTail);
  if (take(tail, 8) != hashOf(all.first(all.size() - kTail))) return damaged;
  Checkpoint out;
  out.contentHash = take(rest, 8);
  out.edit = take(rest, 8);
  out.meshHash = take(rest, 8);
  out.mesh.effectiveThreshold = std::bit_cast<double>(take(rest, 8));
  if (out.contentHash != contentHash) return Error{"A checkpoint of a camera is of another world."};
  if (!std::isfinite(out.mesh.effectiveThreshold)) return damaged;
  const std::uint64_t treeBytes = take(rest, 4), placeBytes = take(rest, 4);
  if (treeBytes + placeBytes > rest.size()) return damaged;

  RangeDecoder treeCoder(rest.first(treeBytes));
  if (!codeLeaves(treeCoder, out.mesh.leaves) || !treeCoder.finished()) return damaged;
  points::Reader reader(rest.subspan(treeBytes, placeBytes));
  std::vector<points::Change> squares;
  if (!reader.changes(
          {out.mesh.leaves, out.mesh.leaves, {}}, [](const LeafAddress&) { return 0u; }, squares) ||
      !reader.finished())
    return damaged;
  std::size_t count = 0;
  for (const points::Change& square : squares) count += square.inserted.size();
  if (count > maxVertices) return Error{"A checkpoint of a camera has more vertices than it may have now."};
  std::vector<StoredVertex>& vertices = out.mesh.vertices;
  vertices.reserve(count);
  for (const points::Change& square : squares)
    for (const points::Place& p : square.inserted) vertices.push_back({{square.square.x() + p.x, square.square.z() + p.z}, 0, 0});
  const auto isOn = [](const StoredVertex& v) { return lattice::positionIsValid(v.at.x, v.at.z); };
  if (!std::ranges::all_of(vertices, isOn)) return damaged;
  const std::vector<std::int32_t> bases = heightsAt(ground, vertices);
  RangeDecoder heightCoder(rest.subspan(treeBytes + placeBytes));
  Walk<RangeDecoder> walk(heightCoder);
  forEachVertex(squares, vertices, bases, [&](StoredVertex& v, std::int32_t base, int level) { walk.vertex(level, base, v); });
  const auto isHigh = [](const StoredVertex& v) { return std::abs(v.y) > lattice::kMaxHeight; };
  if (heightCoder.failed() || !heightCoder.finished() || std::ranges::any_of(vertices, isHigh)) return damaged;
  return out;
}

}  // namespace ridgecast::handover
