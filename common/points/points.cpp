#include "common/points/points.h"

#include <algorithm>
#include <bit>
#include <cstdlib>

#include "common/outcome/contract.h"

namespace ridgecast::points {

namespace {

constexpr std::uint8_t kForm = 0x30;
constexpr std::int64_t kNoHeight = std::int64_t{1} << 30;  // nor anything between this and the lattice's greatest

// Whether each of ascending addresses is in an ascending list.
class Walk {
 public:
  explicit Walk(std::span<const lattice::LeafAddress> list) : list_(list) {}
  bool holds(const lattice::LeafAddress& address) {
    while (!list_.empty() && list_.front() < address) list_ = list_.subspan(1);
    return !list_.empty() && list_.front() == address;
  }

 private:
  std::span<const lattice::LeafAddress> list_;
};

// The open square that holds a leaf's corner.
lattice::LeafAddress openSquareOf(const lattice::LeafAddress& leaf) { return lattice::leafAt({leaf.x(), leaf.z()}, kOpenLevel); }

}  // namespace

// v < 2^31: the length of v + 1 in unary, its second bit adaptively, the rest as even bits.
template <class Coder>
std::uint32_t Coding<Coder>::number(Number& n, std::uint32_t v) {
  expects(v < 1u << 31, "a number has 31 bits");
  const std::uint32_t plus = v + 1;
  unsigned length = static_cast<unsigned>(std::bit_width(plus)) - 1, k = 0;
  while (k < 31 && coder_.bit(n.length[k], k < length)) ++k;
  std::uint32_t out = 1;
  for (unsigned at = k; at-- > 0;) out = out << 1 | (at + 1 == k ? coder_.bit(n.top[k], plus >> at & 1) : coder_.even(plus >> at & 1));
  return out - 1;
}

// v < count, except that a Reader may get more.
template <class Coder>
std::uint32_t Coding<Coder>::below(std::uint32_t count, std::uint32_t v) {
  expects(count > 0 && (Coder::kDecodes || v < count), "a place lies in its square, and is named in ascending order");
  std::uint32_t out = 0;
  for (int k = std::bit_width(count - 1); k-- > 0;) out = out << 1 | coder_.even(v >> k & 1);
  return out;
}

// |v| < 2^30.
template <class Coder>
std::int32_t Coding<Coder>::difference(Number& n, std::int32_t v) {
  const auto size = static_cast<std::int32_t>(std::min(number(n, static_cast<std::uint32_t>(std::abs(v))), 1u << 30));
  return size != 0 && coder_.even(v < 0) ? -size : size;
}

template <class Coder>
bool Coding<Coder>::changes(const Leaves& leaves, const Count& count, std::vector<Change>& list) {
  std::size_t next = 0, inserted = 0;  // of the list; points
  const auto take = [&](const lattice::LeafAddress& square, bool isFresh) {
    if constexpr (Coder::kDecodes) list.push_back({square, {}, {}, {}});
    const bool isSound = change(count(square), isFresh, list[next]);
    inserted += list[next++].inserted.size();
    return isSound && inserted <= kMaxPoints;
  };
  bool changes = false;
  for (Walk fresh(leaves.fresh), active(leaves.active); const lattice::LeafAddress& leaf : leaves.held) {
    const bool isFresh = fresh.holds(leaf), isActive = active.holds(leaf);
    const bool isNext = !Coder::kDecodes && next < list.size() && list[next].square == leaf;
    changes = coder_.bit(changes_[isFresh ? 2 : isActive][changes], isNext);
    if (coder_.failed() || (changes && !take(leaf, isFresh))) return false;
  }
  lattice::LeafAddress square = leaves.held.empty() ? lattice::LeafAddress{kOpenLevel, 0, 0} : openSquareOf(leaves.held.front());
  for (bool isFirst = true; coder_.bit(open_, !Coder::kDecodes && next < list.size()); isFirst = false) {
    const lattice::LeafAddress to = Coder::kDecodes ? square : list[next].square, before = square;
    square.i += difference(openI_, static_cast<std::int32_t>(to.i - square.i));
    square.j += difference(openJ_, static_cast<std::int32_t>(to.j - square.j));
    if (coder_.failed() || !lattice::addressIsValid(square) || (!isFirst && square <= before) || !take(square, false)) return false;
  }
  return true;
}

template <class Coder>
bool Coding<Coder>::change(std::uint32_t before, bool isFresh, Change& c) {
  Counts& counts = counts_[isFresh];
  if (!chosen(counts.removed, before, c.removed) || !chosen(counts.raised, before - static_cast<std::uint32_t>(c.removed.size()), c.raised))
    return false;
  const std::uint32_t inserted = number(counts.inserted, static_cast<std::uint32_t>(c.inserted.size()));
  for (std::uint32_t k = 0; k < inserted; ++k) {
    const Place p = place(c.square.level, isFresh, Coder::kDecodes ? Place{} : c.inserted[k]);
    if constexpr (!Coder::kDecodes) continue;
    if (coder_.failed() || (k > 0 && p <= c.inserted.back())) return false;
    c.inserted.push_back(p);
  }
  return !c.empty();
}

template <class Coder>
bool Coding<Coder>::chosen(Number& n, std::uint32_t before, std::vector<std::uint32_t>& places) {
  const std::uint32_t count = number(n, static_cast<std::uint32_t>(places.size()));
  if (count > before) return false;
  std::uint32_t first = 0;  // that may be chosen
  for (std::uint32_t k = 0; k < count; ++k) {
    const std::uint32_t room = before - first - (count - 1 - k);
    const std::uint32_t at = first + below(room, Coder::kDecodes ? 0 : places[k] - first);
    if constexpr (Coder::kDecodes) {
      if (at - first >= room || coder_.failed()) return false;
      places.push_back(at);
    }
    first = at + 1;
  }
  return true;
}

template <class Coder>
Place Coding<Coder>::place(int level, bool isFresh, Place p) {
  expects(level >= 0 && level <= lattice::kMaxLevel, "a square has a level");
  const int sideBits = lattice::kFinestSideBits + level, half = sideBits - 1;
  const auto multiples = [&](int bits) {  // of 2^bits, in the square
    const std::uint32_t count = 1u << (sideBits - bits);
    const std::uint32_t x = below(count, static_cast<std::uint32_t>(p.x >> bits)),
                        z = below(count, static_cast<std::uint32_t>(p.z >> bits));
    return Place{static_cast<std::int32_t>(x << bits), static_cast<std::int32_t>(z << bits)};
  };
  const auto areMultiples = [&](int bits) { return ((p.x | p.z) & ((1 << bits) - 1)) == 0; };
  if (coder_.bit(grid_[isFresh], areMultiples(half))) return multiples(half);
  int l = level;
  while (l > 0 && coder_.bit(finer_[static_cast<std::size_t>(level - l)], !areMultiples(lattice::horizontalBits(l)))) --l;
  return multiples(lattice::horizontalBits(l));
}

template <class Coder>
std::int32_t Coding<Coder>::height(Heights& heights, int level, std::int32_t guess, std::int32_t y) {
  expects(level >= 0 && level <= lattice::kMaxLevel, "a square has a level");
  int l = level;
  const auto isMultiple = [&] { return (y & ((1 << lattice::verticalBits(l)) - 1)) == 0; };
  while (l > 0 && coder_.bit(heights.finer[static_cast<std::size_t>(level - l)], !isMultiple())) --l;
  const int bits = lattice::verticalBits(l);
  const std::int64_t units = std::int64_t{guess >> bits} + difference(heights.size, (y >> bits) - (guess >> bits));
  return static_cast<std::int32_t>(std::clamp<std::int64_t>(units << bits, -kNoHeight, kNoHeight));
}

Writer::Writer(std::vector<std::uint8_t>& payload) : Coding((payload.push_back(kForm), RangeEncoder(payload))) {}

Reader::Reader(std::span<const std::uint8_t> payload)
    : Coding(RangeDecoder(payload.subspan(std::min<std::size_t>(payload.size(), 1)))),
      known_(!payload.empty() && payload.front() == kForm) {}

template class Coding<RangeEncoder>;
template class Coding<RangeDecoder>;

}  // namespace ridgecast::points
