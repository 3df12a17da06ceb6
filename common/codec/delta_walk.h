#pragma once
// The part of the delta format that encoder and decoder share: the walk over holes and their edges. `Coder` is a RangeEncoder or a
// RangeDecoder. An encoder's `Truth` knows what to code; a decoder's knows nothing.
//
// Vertices are numbered: the base's in canonical order, then new ones in the order in which they are coded. An *open edge* (a, b) has its
// left side still to be filled.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/codec/range_coder.h"

namespace ridgecast::codec {

using mesh::orientation;

inline constexpr std::uint32_t kNobody = 0xffffffffu;
inline constexpr std::uint32_t kMaxWalk = 32;

// Positive if d lies inside the circle through a, b, c (counter-clockwise). Approximate, in doubles: it only chooses a probability.
inline bool isInside(const mesh::LocalVertex& a, const mesh::LocalVertex& b, const mesh::LocalVertex& c, const mesh::LocalVertex& d) {
  const double ax = double(a.x) - d.x, az = double(a.z) - d.z, bx = double(b.x) - d.x, bz = double(b.z) - d.z, cx = double(c.x) - d.x,
               cz = double(c.z) - d.z;
  const double aa = ax * ax + az * az, bb = bx * bx + bz * bz, cc = cx * cx + cz * cz;
  return aa * (bz * cx - bx * cz) + bb * (cz * ax - cx * az) + cc * (az * bx - ax * bz) > 0;
}

// A Truth's answer about the left side of an open edge.
struct Apex {
  enum Kind { kNone, kKnown, kFresh } kind = kNone;
  std::uint32_t vertex = kNobody;  // kKnown: its number; kFresh: the encoder's own name for it
  mesh::LocalVertex position;      // kFresh
};

// An edge of a hole, or of its filling.
struct OpenEdge {
  std::uint32_t a, b;
  std::uint32_t third;  // with a and b, predicts how the surface continues
  std::uint8_t kind;    // what lies on its right: 0 a triangle that stays, 1 nothing of the base, 2 a new triangle
  bool open = true;
  std::uint32_t nextOut = kNobody, previousOut = kNobody, nextIn = kNobody, previousIn = kNobody;
};

// A walk's arrays by vertex and triangle, separate so that their memory can be reused.
struct WalkMemory {
  std::vector<std::uint32_t> start, around, end, gone;
  std::vector<char> fate, listed;
  std::vector<mesh::LocalVertex> vertices;
  std::vector<mesh::Triangle> added;
  std::vector<OpenEdge> edges;
  std::vector<std::uint32_t> out, in, filled;
};

template <class Coder, class Truth>
class Walk {
 public:
  // `memory` must not be used by others while the walk lives.
  Walk(Coder& coder, Truth& truth, const mesh::LeafMesh& base, const DeltaCounts& counts, WalkMemory& memory)
      : coder_(coder), truth_(truth), base_(base), counts_(counts), level_(base.address.level), memory_(memory) {
    gone_.clear();
    added_.clear();
    edges_.clear();
  }

  // False: not a delta, or one that needs more work than its size allows.
  bool run() {
    effort_ = 256 * (base_.triangles.size() + std::size_t{counts_.added}) + 65536;
    vertices_.reserve(base_.vertices.size() + counts_.fresh);
    vertices_.assign(base_.vertices.begin(), base_.vertices.end());
    freshLeft_ = counts_.fresh;
    added_.reserve(counts_.added);
    return file() && remove() && open() && fill() && freshLeft_ == 0;
  }

  std::vector<mesh::LocalVertex>& vertices() { return vertices_; }     // of the base, then the new ones
  const std::vector<char>& fates() const { return fate_; }             // of the base's triangles: kGoes or not
  const std::vector<mesh::Triangle>& added() const { return added_; }  // as indices into vertices()

  enum Fate : char { kUndecided, kStays, kGoes };

 private:
  using Edge = OpenEdge;

  bool spend(std::size_t n = 1) {
    if (effort_ < n) return false;
    effort_ -= n;
    return !coder_.failed();
  }

  // ---- numbers ----

  struct Number {
    std::array<Probability, 33> length;
    std::array<Probability, 33> top;
  };
  // v below 2^32 - 1: the length of v + 1 in unary, its second bit adaptively, the rest as plain bits.
  std::uint32_t number(Number& n, std::uint32_t v) {
    const std::uint64_t plus = std::uint64_t{v} + 1;
    unsigned length = static_cast<unsigned>(std::bit_width(plus)) - 1, k = 0;
    while (k < 31 && coder_.bit(n.length[k], k < length)) ++k;
    std::uint64_t out = 1;
    for (unsigned at = 0; at < k; ++at) {
      const bool value = plus >> (k - 1 - at) & 1;
      out = out << 1 | (at == 0 ? coder_.bit(n.top[k], value) : coder_.even(value));
    }
    return static_cast<std::uint32_t>(out - 1);
  }
  // v in [0, count).
  std::uint32_t below(std::uint32_t count, std::uint32_t v) {
    std::uint32_t out = 0;
    for (int k = static_cast<int>(std::bit_width(count - 1)) - 1; k >= 0; --k) out = out << 1 | (coder_.even(v >> k & 1) ? 1u : 0u);
    return out;
  }
  // `fine` low bits plain, the rest as a number, then the sign.
  std::int64_t difference(Number& n, unsigned fine, std::int64_t v) {
    const auto size = static_cast<std::uint64_t>(std::abs(v));
    std::uint64_t out = number(n, static_cast<std::uint32_t>(std::min<std::uint64_t>(size >> fine, 0xfffffffeu)));
    for (unsigned k = fine; k-- > 0;) out = out << 1 | (coder_.even(size >> k & 1) ? 1u : 0u);
    if (out == 0) return 0;
    out = std::min(out, std::uint64_t{1} << 31);  // out of range whatever it is added to
    return coder_.even(v < 0) ? -static_cast<std::int64_t>(out) : static_cast<std::int64_t>(out);
  }

  // ---- the base's triangles ----

  // The triangles at each vertex: a run of `around_`. An encoder lists only vertices it will query: the corners of removed triangles.
  bool file() {
    std::vector<char>& listed = memory_.listed;
    listed.assign(base_.vertices.size(), Coder::kDecodes);
    if constexpr (!Coder::kDecodes)
      for (std::uint32_t t = 0; t < base_.triangles.size(); ++t)
        if (truth_.goes(t))
          for (std::uint32_t v : base_.triangles[t]) listed[v] = 1;
    start_.assign(base_.vertices.size() + 1, 0);
    for (const mesh::Triangle& t : base_.triangles)
      for (std::uint32_t v : t) start_[v + 1] += static_cast<std::uint32_t>(listed[v]);
    for (std::size_t v = 0; v < base_.vertices.size(); ++v) start_[v + 1] += start_[v];
    around_.resize(start_.back());
    std::vector<std::uint32_t>& at = memory_.end;
    at.assign(start_.begin(), start_.end() - 1);
    for (std::uint32_t t = 0; t < base_.triangles.size(); ++t)
      for (std::uint32_t v : base_.triangles[t])
        if (listed[v]) around_[at[v]++] = t;
    fate_.assign(base_.triangles.size(), kUndecided);
    return true;
  }
  // The triangle beyond the k-th edge of t; kNobody: none.
  bool beyond(std::uint32_t t, std::size_t k, std::uint32_t& out) {
    const std::uint32_t a = base_.triangles[t][k], b = base_.triangles[t][(k + 1) % 3];
    out = kNobody;
    for (std::uint32_t n = start_[b]; n < start_[b + 1]; ++n) {
      if (!spend()) return false;
      const mesh::Triangle& s = base_.triangles[around_[n]];
      if ((s[0] == b && s[1] == a) || (s[1] == b && s[2] == a) || (s[2] == b && s[0] == a)) {
        out = around_[n];
        return true;
      }
    }
    return true;
  }

  // Removed triangles: a first one, then its neighbours across edges, and so on; then the next first one.
  bool remove() {
    std::uint32_t left = counts_.removed, cursor = 0;
    const auto count = static_cast<std::uint32_t>(base_.triangles.size());
    while (left > 0) {
      std::uint32_t gap = 0;
      if constexpr (!Coder::kDecodes)
        for (std::uint32_t t = cursor; t < count && !(fate_[t] == kUndecided && truth_.goes(t)); ++t) gap += fate_[t] == kUndecided;
      gap = number(gap_, gap);
      for (; cursor < count; ++cursor) {
        if (fate_[cursor] != kUndecided) continue;
        if (gap == 0) break;
        --gap;
        fate_[cursor] = kStays;
      }
      if (cursor >= count) return false;
      fate_[cursor] = kGoes;
      gone_.push_back(cursor);
      --left;
      for (std::size_t next = gone_.size() - 1, first = next; next < gone_.size() && left > 0; ++next)
        for (std::size_t k = 0; k < 3 && left > 0; ++k) {
          std::uint32_t s = kNobody;
          if (!beyond(gone_[next], k, s)) return false;
          if (s == kNobody || fate_[s] != kUndecided) continue;
          const std::size_t seen = std::min<std::size_t>(next - first, 3);
          if (coder_.bit(grows_[seen], truth_.goes(s))) {
            fate_[s] = kGoes;
            gone_.push_back(s);
            --left;
          } else {
            fate_[s] = kStays;
          }
        }
    }
    return true;
  }

  // ---- open edges ----

  void openEdge(std::uint32_t a, std::uint32_t b, std::uint32_t third, std::uint8_t kind) {
    const auto e = static_cast<std::uint32_t>(edges_.size());
    edges_.push_back({a, b, third, kind});
    Edge& edge = edges_.back();
    edge.nextOut = out_[a];
    if (edge.nextOut != kNobody) edges_[edge.nextOut].previousOut = e;
    out_[a] = e;
    edge.nextIn = in_[b];
    if (edge.nextIn != kNobody) edges_[edge.nextIn].previousIn = e;
    in_[b] = e;
  }
  void closeEdge(std::uint32_t e, bool filled) {
    Edge& edge = edges_[e];
    edge.open = false;
    (edge.previousOut == kNobody ? out_[edge.a] : edges_[edge.previousOut].nextOut) = edge.nextOut;
    if (edge.nextOut != kNobody) edges_[edge.nextOut].previousOut = edge.previousOut;
    (edge.previousIn == kNobody ? in_[edge.b] : edges_[edge.previousIn].nextIn) = edge.nextIn;
    if (edge.nextIn != kNobody) edges_[edge.nextIn].previousIn = edge.previousIn;
    if (!filled || edge.kind != 1) return;
    edge.nextOut = filled_[edge.a];
    filled_[edge.a] = e;
  }
  bool find(const std::vector<std::uint32_t>& from, std::uint32_t a, std::uint32_t b, std::uint32_t& out) {
    for (out = from[a]; out != kNobody && edges_[out].b != b; out = edges_[out].nextOut)
      if (!spend()) return false;
    return true;
  }

  // The edges of the holes.
  bool open() {
    out_.assign(vertices_.size() + counts_.fresh, kNobody);
    in_ = filled_ = out_;
    for (const std::uint32_t t : gone_)
      for (std::size_t k = 0; k < 3; ++k) {
        std::uint32_t s = kNobody;
        if (!beyond(t, k, s)) return false;
        if (s != kNobody && fate_[s] == kGoes) continue;
        const mesh::Triangle& v = base_.triangles[t];
        openEdge(v[k], v[(k + 1) % 3], v[(k + 2) % 3], s == kNobody ? 1 : 0);
      }
    return true;
  }

  // ---- new triangles ----

  bool fill() {
    std::uint32_t cursor = 0, current = kNobody;
    while (added_.size() < counts_.added) {
      if (!spend(4)) return false;
      if (current == kNobody) {
        while (cursor < edges_.size() && !edges_[cursor].open) ++cursor;
        if (cursor == edges_.size()) {
          if (!seed()) return false;
          continue;
        }
        current = cursor;
      }
      const Edge edge = edges_[current];
      std::uint32_t apex = kNobody;
      if (!codeApex(edge, apex)) return false;
      closeEdge(current, apex != kNobody);
      if (apex != kNobody && !add(edge.a, edge.b, apex)) return false;
      current = out_[edge.b];
      if (current == kNobody && apex != kNobody) current = out_[apex];
    }
    return true;
  }

  // A triangle over the edge (a, b), which is already closed.
  bool add(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (orientation(vertices_[a], vertices_[b], vertices_[c]) <= 0) return false;
    added_.push_back({a, b, c});
    return pass(b, c, a) && pass(c, a, b);
  }
  // The new triangle's edge (a, b): closes an open edge, or opens the other way if (a, b) is neither open nor filled.
  bool pass(std::uint32_t a, std::uint32_t b, std::uint32_t third) {
    std::uint32_t e = kNobody;
    if (!find(out_, a, b, e)) return false;
    if (e != kNobody) {
      closeEdge(e, true);
      return true;
    }
    if (!find(out_, b, a, e)) return false;
    if (e == kNobody && !find(filled_, b, a, e)) return false;
    if (e == kNobody) openEdge(b, a, third, 2);
    return true;
  }

  // The vertex `steps` open edges after b, or before a.
  std::uint32_t walk(std::uint32_t from, bool forwards, std::uint32_t steps) const {
    for (; steps > 0 && from != kNobody; --steps) {
      const std::uint32_t e = forwards ? out_[from] : in_[from];
      from = e == kNobody ? kNobody : forwards ? edges_[e].b : edges_[e].a;
    }
    return from;
  }

  bool codeApex(const Edge& edge, std::uint32_t& apex) {
    Apex is;
    if constexpr (!Coder::kDecodes) is = truth_.apex(edge.a, edge.b);
    const mesh::LocalVertex &a = vertices_[edge.a], &b = vertices_[edge.b];
    const auto candidate = [&](std::uint32_t v) { return v != kNobody && orientation(a, b, vertices_[v]) > 0 ? v : kNobody; };
    const std::uint32_t before = candidate(walk(edge.a, false, 1)), behind = candidate(walk(edge.b, true, 1));
    std::size_t situation = 0;  // 0: one of them, 1: both are one, 2: before is nearer, 3: behind is
    if (before != kNobody && behind != kNobody)
      situation = before == behind ? 1 : isInside(a, b, vertices_[before], vertices_[behind]) ? 3 : 2;
    const bool known = is.kind == Apex::kKnown;
    if (before != kNobody && coder_.bit(isBefore_[edge.kind][situation], known && is.vertex == before)) {
      apex = before;
      return true;
    }
    if (behind != kNobody && behind != before && coder_.bit(isBehind_[edge.kind][situation], known && is.vertex == behind)) {
      apex = behind;
      return true;
    }
    if (freshLeft_ > 0 && coder_.bit(isFresh_[edge.kind][before != kNobody || behind != kNobody], is.kind == Apex::kFresh))
      return fresh(edge, is, apex);
    if (coder_.bit(isNone_[edge.kind], is.kind == Apex::kNone)) {
      apex = kNobody;
      return true;
    }
    // Farther along the edges of the hole, or anywhere.
    std::uint32_t steps = 0;
    bool forwards = true;
    if constexpr (!Coder::kDecodes) {
      std::uint32_t on = edge.b, back = edge.a;
      for (std::uint32_t k = 1; k <= kMaxWalk && steps == 0; ++k) {
        on = on == kNobody ? kNobody : walk(on, true, 1);
        back = back == kNobody ? kNobody : walk(back, false, 1);
        if (on == is.vertex)
          steps = k;
        else if (back == is.vertex)
          steps = k, forwards = false;
      }
    }
    if (coder_.bit(isWalk_, steps > 0)) {
      forwards = coder_.bit(isForwards_, forwards);
      steps = number(steps_, steps - 1) + 1;
      if (steps > kMaxWalk) return false;
      apex = walk(forwards ? edge.b : edge.a, forwards, steps);
      return apex != kNobody;
    }
    return any(is.vertex, apex);
  }

  bool any(std::uint32_t is, std::uint32_t& v) {
    const auto count = static_cast<std::uint32_t>(vertices_.size());
    if (count == 0) return false;
    v = below(count, is);
    return v < count;
  }

  // A triangle that touches no open edge.
  bool seed() {
    std::array<Apex, 3> is;
    if constexpr (!Coder::kDecodes) is = truth_.seed();
    std::array<std::uint32_t, 3> v;
    Edge none{0, 0, kNobody, 2};
    for (std::size_t k = 0; k < 3; ++k) {
      // A vertex that was new when coded may be known by now.
      if constexpr (!Coder::kDecodes) is[k] = truth_.again(is[k]);
      if (freshLeft_ > 0 && coder_.bit(seedIsFresh_, is[k].kind == Apex::kFresh)) {
        none.a = none.b = none.third = k == 0 ? kNobody : v[k - 1];
        if (!fresh(none, is[k], v[k])) return false;
      } else if (!any(is[k].vertex, v[k])) {
        return false;
      }
    }
    if (orientation(vertices_[v[0]], vertices_[v[1]], vertices_[v[2]]) <= 0) return false;
    added_.push_back(v);
    return pass(v[0], v[1], v[2]) && pass(v[1], v[2], v[0]) && pass(v[2], v[0], v[1]);
  }

  // ---- new vertices ----

  static std::int64_t third(std::int64_t v) { return v >= 0 ? v / 3 : -((-v + 2) / 3); }  // rounded down

  bool fresh(const Edge& edge, const Apex& is, std::uint32_t& number) {
    mesh::LocalVertex a{}, b{}, c{};
    if (edge.a == kNobody) {
      a.x = b.x = c.x = a.z = b.z = c.z = 1 << (lattice::kFinestSideBits + level_ - 1);
    } else {
      a = vertices_[edge.a], b = vertices_[edge.b], c = vertices_[edge.third];
    }
    // Inside the former triangle, or where its mirror image would be.
    const auto guess = [&](std::int64_t p, std::int64_t q, std::int64_t r) {
      return edge.kind == 2 && edge.a != edge.b ? third(2 * p + 2 * q - r) : third(p + q + r);
    };
    mesh::LocalVertex v = is.position;
    const int h = spacing(finer_, v.x | v.z, [](int level) { return lattice::horizontalBits(level); });
    const auto extent = static_cast<std::uint32_t>(std::max(std::abs(b.x - a.x), std::abs(b.z - a.z))) >> h;
    const unsigned fine = static_cast<unsigned>(std::max(0, static_cast<int>(std::bit_width(extent)) - 3));
    std::int64_t x = 0, z = 0, y = 0;
    x = coordinate(place_, fine, h, guess(a.x, b.x, c.x), v.x);
    z = coordinate(place_, fine, h, guess(a.z, b.z, c.z), v.z);
    if (std::abs(x) > kMaxOffset || std::abs(z) > kMaxOffset) return false;
    v.x = static_cast<std::int32_t>(x);
    v.z = static_cast<std::int32_t>(z);
    const int s = spacing(finerHeight_, v.y, [](int level) { return lattice::verticalBits(level); });
    y = coordinate(height_, 0, s, heightAt(a, b, c, v), v.y);
    if (std::abs(y) > lattice::kMaxHeight) return false;
    v.y = static_cast<std::int32_t>(y);
    number = static_cast<std::uint32_t>(vertices_.size());
    vertices_.push_back(v);
    --freshLeft_;
    if constexpr (!Coder::kDecodes) truth_.named(is.vertex, number);
    return true;
  }

  // The power of two that divides the value: that of the leaf's level, or a finer one.
  template <class Bits>
  int spacing(std::array<Probability, lattice::kMaxLevel + 1>& finer, std::int32_t value, const Bits& bits) {
    int level = level_;
    while (level > 0) {
      const bool fits = (value & ((1 << bits(level)) - 1)) == 0;
      if (!coder_.bit(finer[static_cast<std::size_t>(level_ - level)], !fits)) break;
      --level;
    }
    return bits(level);
  }

  std::int64_t coordinate(Number& n, unsigned fine, int bits, std::int64_t guess, std::int64_t value) {
    const std::int64_t from = lattice::floorTo(guess, bits);
    return from + difference(n, fine, (value - from) >> bits) * (std::int64_t{1} << bits);
  }

  // The height of the plane through three vertices at a fourth, limited to a range around them.
  static std::int64_t heightAt(const mesh::LocalVertex& a, const mesh::LocalVertex& b, const mesh::LocalVertex& c,
                               const mesh::LocalVertex& v) {
    const double ux = double(b.x) - a.x, uz = double(b.z) - a.z, wx = double(c.x) - a.x, wz = double(c.z) - a.z;
    const double px = double(v.x) - a.x, pz = double(v.z) - a.z, det = ux * wz - uz * wx;
    const std::int64_t low = std::min({a.y, b.y, c.y}), high = std::max({a.y, b.y, c.y});
    if (det == 0) return (low + high) >> 1;
    const double y = a.y + (px * wz - pz * wx) / det * (double(b.y) - a.y) + (ux * pz - uz * px) / det * (double(c.y) - a.y);
    const double least = static_cast<double>(2 * low - high), most = static_cast<double>(2 * high - low);
    return static_cast<std::int64_t>(std::floor(std::min(std::max(y, least), most)));
  }

  Coder& coder_;
  Truth& truth_;
  const mesh::LeafMesh& base_;
  const DeltaCounts counts_;
  const int level_;
  std::size_t effort_ = 0;
  std::uint32_t freshLeft_ = 0;

  WalkMemory& memory_;
  std::vector<std::uint32_t>&start_ = memory_.start, &around_ = memory_.around, &gone_ = memory_.gone;
  std::vector<char>& fate_ = memory_.fate;
  std::vector<mesh::LocalVertex>& vertices_ = memory_.vertices;
  std::vector<mesh::Triangle>& added_ = memory_.added;
  std::vector<Edge>& edges_ = memory_.edges;
  std::vector<std::uint32_t>&out_ = memory_.out, &in_ = memory_.in;  // by vertex: the newest open edge from it, and to it
  std::vector<std::uint32_t>& filled_ = memory_.filled;              // by vertex: the newest filled edge of kind 1 from it

  using P = Probability;
  Number gap_, steps_, place_, height_;
  std::array<P, 4> grows_;
  P isBefore_[3][4], isBehind_[3][4], isFresh_[3][2], isNone_[3], isWalk_, isForwards_, seedIsFresh_;
  std::array<P, lattice::kMaxLevel + 1> finer_, finerHeight_;
};

}  // namespace ridgecast::codec
