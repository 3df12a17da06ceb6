#include "common/codec/delta.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "common/codec/delta_walk.h"
#include "common/codec/varint.h"

namespace ridgecast::codec {
namespace {

constexpr std::uint8_t kForm = 0x20;
constexpr std::size_t kTrianglesAByte = 64;  // more never come out of a byte of a delta

WalkMemory& memory() {
  thread_local WalkMemory mine;
  return mine;
}

Error refusal(const std::string& why) { return {"the leaf's delta cannot be decoded: " + why}; }

// What a decoder knows beforehand: nothing.
struct Unknown {
  bool goes(std::uint32_t) const { return false; }
};

// What an encoder knows: both meshes.
class Difference {
 public:
  Difference(const mesh::LeafMesh& base, const mesh::LeafMesh& target) : target_(target) {
    // Both orders ascend, so one pass over each finds what they share; and the triangles' order survives renumbering.
    toTarget_.assign(base.vertices.size(), kNobody);
    number_.assign(target.vertices.size(), kNobody);
    for (std::uint32_t b = 0, t = 0; b < base.vertices.size() && t < target.vertices.size();) {
      if (base.vertices[b] == target.vertices[t]) {
        toTarget_[b] = t;
        number_[t++] = b++;
      } else if (base.vertices[b] < target.vertices[t]) {
        ++b;
      } else {
        ++t;
      }
    }
    goes_.assign(base.triangles.size(), 1);
    std::vector<char> stays(target.triangles.size(), 0);
    std::uint32_t t = 0;
    for (std::uint32_t b = 0; b < base.triangles.size(); ++b) {
      const mesh::Triangle& v = base.triangles[b];
      const mesh::Triangle there{toTarget_[v[0]], toTarget_[v[1]], toTarget_[v[2]]};
      if (there[0] == kNobody || there[1] == kNobody || there[2] == kNobody) continue;
      while (t < target.triangles.size() && target.triangles[t] < there) ++t;
      if (t < target.triangles.size() && !(there < target.triangles[t])) {
        goes_[b] = 0;
        stays[t++] = 1;
      }
    }
    std::vector<char> used(target.vertices.size(), 0);
    for (std::uint32_t k = 0; k < target.triangles.size(); ++k) {
      if (stays[k]) continue;
      const mesh::Triangle& v = target.triangles[k];
      added_.push_back(k);
      for (std::size_t c = 0; c < 3; ++c) {
        left_.push_back({v[c], v[(c + 1) % 3], v[(c + 2) % 3], k});
        if (number_[v[c]] == kNobody && !used[v[c]]) used[v[c]] = 1, ++counts.fresh;
      }
    }
    std::sort(left_.begin(), left_.end(), [](const Left& p, const Left& q) { return std::tie(p.a, p.b) < std::tie(q.a, q.b); });
    counts.added = static_cast<std::uint32_t>(added_.size());
    counts.removed = static_cast<std::uint32_t>(std::count(goes_.begin(), goes_.end(), 1));
    coded_.assign(target.triangles.size(), 0);
  }

  DeltaCounts counts;

  bool goes(std::uint32_t t) const { return goes_[t]; }
  // The walk came to a triangle twice, because another one lies on the same side of an edge: it has coded something else than the target.
  bool tangled() const { return tangled_; }

  Apex apex(std::uint32_t a, std::uint32_t b) {
    const std::uint32_t ta = targetOf(a), tb = targetOf(b);
    const auto it = std::lower_bound(left_.begin(), left_.end(), std::pair{ta, tb},
                                     [](const Left& l, const auto& e) { return std::tie(l.a, l.b) < std::tie(e.first, e.second); });
    if (it == left_.end() || it->a != ta || it->b != tb) return {};
    if (coded_[it->triangle]) tangled_ = true;
    coded_[it->triangle] = 1;
    return apexOf(it->c);
  }

  std::array<Apex, 3> seed() {
    while (coded_[added_[next_]]) ++next_;
    const mesh::Triangle& t = target_.triangles[added_[next_]];
    coded_[added_[next_]] = 1;
    return {apexOf(t[0]), apexOf(t[1]), apexOf(t[2])};
  }
  Apex again(const Apex& apex) const { return apex.kind == Apex::kFresh ? apexOf(apex.vertex) : apex; }

  void named(std::uint32_t vertex, std::uint32_t number) {
    number_[vertex] = number;
    fresh_.push_back(vertex);
  }

 private:
  struct Left {
    std::uint32_t a, b, c, triangle;
  };
  std::uint32_t targetOf(std::uint32_t number) const {
    return number < toTarget_.size() ? toTarget_[number] : fresh_[number - toTarget_.size()];
  }
  Apex apexOf(std::uint32_t vertex) const {
    if (number_[vertex] != kNobody) return {Apex::kKnown, number_[vertex], {}};
    return {Apex::kFresh, vertex, target_.vertices[vertex]};
  }

  const mesh::LeafMesh& target_;
  std::vector<std::uint32_t> toTarget_;  // base vertex -> target vertex
  std::vector<std::uint32_t> number_;    // target vertex -> its number in the walk
  std::vector<std::uint32_t> fresh_;     // new number -> target vertex
  std::vector<char> goes_, coded_;
  std::vector<std::uint32_t> added_;  // triangles of the target
  std::size_t next_ = 0;
  std::vector<Left> left_;
  bool tangled_ = false;
};

// What stays of the base and what came, in canonical order; empty text, or what is wrong.
std::string assemble(const mesh::LeafMesh& base, const std::vector<char>& fates, char goes, const std::vector<mesh::LocalVertex>& vertices,
                     const std::vector<mesh::Triangle>& added, mesh::LeafMesh& out) {
  std::vector<char> used(vertices.size(), 0);
  std::size_t kept = 0;
  for (std::size_t t = 0; t < base.triangles.size(); ++t) {
    if (fates[t] == goes) continue;
    ++kept;
    for (std::uint32_t v : base.triangles[t]) used[v] = 1;
  }
  for (const mesh::Triangle& t : added)
    for (std::uint32_t v : t) used[v] = 1;

  const auto old = static_cast<std::uint32_t>(base.vertices.size());
  std::vector<std::uint32_t> fresh;
  for (std::uint32_t v = old; v < vertices.size(); ++v) {
    if (!used[v]) return "a new vertex has no triangle";
    fresh.push_back(v);
  }
  std::sort(fresh.begin(), fresh.end(), [&](std::uint32_t p, std::uint32_t q) { return vertices[p] < vertices[q]; });
  std::vector<std::uint32_t> place(vertices.size(), kNobody);
  out.vertices.reserve(vertices.size());
  const auto put = [&](std::uint32_t v) {
    place[v] = static_cast<std::uint32_t>(out.vertices.size());
    out.vertices.push_back(vertices[v]);
  };
  auto next = fresh.begin();
  for (std::uint32_t v = 0; v < old; ++v) {
    if (!used[v]) continue;
    while (next != fresh.end() && vertices[*next] < vertices[v]) put(*next++);
    put(v);
  }
  while (next != fresh.end()) put(*next++);
  for (std::size_t v = 1; v < out.vertices.size(); ++v)
    if (out.vertices[v - 1].x == out.vertices[v].x && out.vertices[v - 1].z == out.vertices[v].z) return "two vertices share a place";

  std::vector<mesh::Triangle> came;
  came.reserve(added.size());
  for (const mesh::Triangle& t : added) came.push_back(mesh::rotated({place[t[0]], place[t[1]], place[t[2]]}));
  std::sort(came.begin(), came.end());
  out.triangles.reserve(kept + came.size());
  auto comes = came.begin();
  for (std::size_t t = 0; t < base.triangles.size(); ++t) {
    if (fates[t] == goes) continue;
    const mesh::Triangle& v = base.triangles[t];
    const mesh::Triangle here{place[v[0]], place[v[1]], place[v[2]]};
    while (comes != came.end() && *comes < here) out.triangles.push_back(*comes++);
    out.triangles.push_back(here);
  }
  out.triangles.insert(out.triangles.end(), comes, came.end());
  for (std::size_t t = 1; t < out.triangles.size(); ++t)
    if (out.triangles[t - 1] == out.triangles[t]) return "two triangles are the same";
  return {};
}

std::uint64_t hashOf(const lattice::LeafAddress& address, const std::vector<mesh::LocalVertex>& vertices, const mesh::Triangle& t) {
  lattice::Vertex v[3];
  for (std::size_t k = 0; k < 3; ++k) v[k] = {address.x() + vertices[t[k]].x, address.z() + vertices[t[k]].z, vertices[t[k]].y};
  return mesh::hashTriangle(v[0], v[1], v[2]);
}

struct Head {
  DeltaCounts counts;
  std::uint32_t check = 0;
  std::span<const std::uint8_t> body;
};

Outcome<Head> readHead(std::span<const std::uint8_t> payload, std::size_t baseTriangles, const Limits& limits) {
  if (payload.size() > limits.maxPayloadBytes) return refusal("it is too long");
  Reader reader(payload);
  std::uint8_t form = 0;
  std::uint64_t removed = 0, added = 0, fresh = 0;
  if (!reader.byte(form) || !reader.varint(removed) || !reader.varint(added) || !reader.varint(fresh))
    return refusal("it ends within its header");
  if (form != kForm) return refusal("its form is unknown; known is 0x20");
  Head head;
  for (int k = 0; k < 4; ++k) {
    std::uint8_t byte = 0;
    if (!reader.byte(byte)) return refusal("it ends within its header");
    head.check |= std::uint32_t{byte} << (8 * k);
  }
  head.body = reader.rest();
  if (removed > baseTriangles) return refusal("more triangles go than the leaf has");
  if (baseTriangles - removed + added > limits.maxTriangles)
    return refusal("the leaf would have more than " + std::to_string(limits.maxTriangles) + " triangles");
  if (fresh > 3 * added || added > kTrianglesAByte * (head.body.size() + 1)) return refusal("its counts contradict each other");
  head.counts = {static_cast<std::uint32_t>(removed), static_cast<std::uint32_t>(added), static_cast<std::uint32_t>(fresh)};
  return head;
}

}  // namespace

std::optional<std::vector<std::uint8_t>> encodeDelta(const mesh::LeafMesh& base, const mesh::LeafMesh& target, std::uint64_t targetHash) {
  assert(base.address == target.address);
  assert(mesh::isCanonical(base) && mesh::isCanonical(target));
  Difference truth(base, target);
  const DeltaCounts counts = truth.counts;
  std::vector<std::uint8_t> out;
  if (counts.removed == 0 && counts.added == 0) return out;
  out.reserve(64 + 8 * counts.fresh);
  out.push_back(kForm);
  for (std::uint32_t n : {counts.removed, counts.added, counts.fresh}) putVarint(out, n);
  for (int k = 0; k < 4; ++k) out.push_back(static_cast<std::uint8_t>(targetHash >> (8 * k)));
  const std::size_t head = out.size();
  RangeEncoder coder(out);
  Walk walk(coder, truth, base, counts, memory());
  if (!walk.run() || truth.tangled()) return std::nullopt;
  coder.finish();
  if (counts.added > kTrianglesAByte * (out.size() - head + 1)) return std::nullopt;
  return out;
}

Outcome<DeltaCounts> deltaCounts(std::span<const std::uint8_t> payload, std::size_t baseTriangles, const Limits& limits) {
  if (payload.empty()) return DeltaCounts{};
  auto head = readHead(payload, baseTriangles, limits);
  if (!head) return head.error();
  return head->counts;
}

Outcome<Changed> decodeDelta(std::span<const std::uint8_t> payload, const mesh::LeafMesh& base, std::uint64_t baseHash,
                             const Limits& limits) {
  assert(std::all_of(base.vertices.begin(), base.vertices.end(), isInRange));
  if (payload.empty()) return Changed{base, baseHash};
  const auto head = readHead(payload, base.triangles.size(), limits);
  if (!head) return head.error();
  RangeDecoder coder(head->body);
  Unknown truth;
  Walk walk(coder, truth, base, head->counts, memory());
  if (!walk.run()) return refusal("it does not fit the leaf that is held");
  if (!coder.finished()) return refusal("it does not have the length that its content needs");

  Changed changed{{.address = base.address, .vertices = {}, .triangles = {}}, baseHash};
  constexpr char kGoes = decltype(walk)::kGoes;
  const std::string wrong = assemble(base, walk.fates(), kGoes, walk.vertices(), walk.added(), changed.leaf);
  if (!wrong.empty()) return refusal(wrong);
  for (std::size_t t = 0; t < base.triangles.size(); ++t)
    if (walk.fates()[t] == kGoes) changed.hash -= hashOf(base.address, base.vertices, base.triangles[t]);
  for (const mesh::Triangle& t : walk.added()) changed.hash += hashOf(base.address, walk.vertices(), t);
#ifndef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION  // or a fuzzer would never get past this line
  if (static_cast<std::uint32_t>(changed.hash) != head->check) return refusal("the leaf it makes is not the one that was meant");
#endif
  return changed;
}

}  // namespace ridgecast::codec
