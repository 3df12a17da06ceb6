#pragma once
// Encodes the change from one set of points to another. Both sides know the triangles: the Delaunay triangulation is a function of its
// points alone (common/triangulation). For authors of clients: PROTOCOL.md, Points.
//
// Points are filed by *squares*: the leaves and, where there is none, squares of kOpenLevel. A square's points ascend by x, then z. Removed
// points are named by their place in that order, inserted ones by their position in the square. Heights follow once the triangulation is
// changed, as differences from what the neighbours suggest (guess.h).
//
//   1 byte    form: 0x30
//   rest      bits, arithmetically coded (common/points/range_coder.h)
//
// Writer and Reader walk through a payload in the same steps: changes(); then, once the triangulation is changed, raised() for each point
// of that kind in all changes and inserted() for each of the other; then the end. One owner each.

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/points/range_coder.h"

namespace ridgecast::points {

inline constexpr int kOpenLevel = 8;                  // of the quadtree's roots
inline constexpr std::size_t kMaxPoints = 4'000'000;  // that a client holds

// Steps from the square's least corner: at least 0 and less than its side.
struct Place {
  std::int32_t x = 0, z = 0;
  friend constexpr auto operator<=>(const Place&, const Place&) = default;
};

// What happens to a square's points.
struct Change {
  lattice::LeafAddress square;
  std::vector<std::uint32_t> removed;  // places in the order of those before, ascending
  std::vector<std::uint32_t> raised;   // the same, among those that stay: changed height
  std::vector<Place> inserted;         // ascending
  bool empty() const { return removed.empty() && raised.empty() && inserted.empty(); }
};

// What both sides know before a payload; in canonical order.
struct Leaves {
  std::span<const lattice::LeafAddress> held;    // as they are afterwards
  std::span<const lattice::LeafAddress> fresh;   // of these, what came with the iteration
  std::span<const lattice::LeafAddress> active;  // squares that the last payload changed, if the client followed since
};
// A square's number of points before.
using Count = std::function<std::uint32_t(const lattice::LeafAddress&)>;

template <class Coder>
class Coding {
 public:
  // A Writer codes `changes`, a Reader fills them in. Squares in canonical order, leaves before open squares; no change is empty. False:
  // not such a payload.
  bool changes(const Leaves& leaves, const Count& count, std::vector<Change>& changes);
  // The height of a point in a square of this level: one that had another, or one that is new. A Reader ignores the last argument.
  std::int32_t raised(int level, std::int32_t before, std::int32_t y = 0) { return height(raised_, level, before, y); }
  std::int32_t inserted(int level, std::int32_t guess, bool isSure, std::int32_t y = 0) {
    return height(inserted_[isSure], level, guess, y);
  }

 protected:
  explicit Coding(Coder coder) : coder_(coder) {}
  Coder coder_;

 private:
  struct Number {  // contexts
    std::array<Probability, 32> length, top;
  };
  struct Counts {
    Number removed, raised, inserted;
  };
  struct Heights {
    std::array<Probability, lattice::kMaxLevel + 1> finer;
    Number size;
  };

  std::uint32_t number(Number& n, std::uint32_t v);
  std::uint32_t below(std::uint32_t count, std::uint32_t v);
  std::int32_t difference(Number& n, std::int32_t v);
  bool change(std::uint32_t before, bool isFresh, Change& change);
  bool chosen(Number& n, std::uint32_t before, std::vector<std::uint32_t>& places);
  Place place(int level, bool isFresh, Place p);
  std::int32_t height(Heights& heights, int level, std::int32_t guess, std::int32_t y);

  std::array<std::array<Probability, 2>, 3> changes_;  // by whether the leaf is fresh, or active; by whether the one before changes
  Probability open_;
  Number openI_, openJ_;
  std::array<Counts, 2> counts_;     // by whether the leaf is fresh
  std::array<Probability, 2> grid_;  // the same
  std::array<Probability, lattice::kMaxLevel + 1> finer_;
  Heights raised_;
  std::array<Heights, 2> inserted_;
};

class Writer : public Coding<RangeEncoder> {
 public:
  explicit Writer(std::vector<std::uint8_t>& payload);  // appended to
  void finish() { coder_.finish(); }
};

class Reader : public Coding<RangeDecoder> {
 public:
  explicit Reader(std::span<const std::uint8_t> payload);
  // After the last height: the payload ended there.
  bool finished() const { return known_ && coder_.finished(); }

 private:
  bool known_;  // the form
};

}  // namespace ridgecast::points
