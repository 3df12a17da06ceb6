#pragma once
// Where a session's members are: each by its number, the nearest to a place, and how many are where.
//
// Members lie in square cells of 256 m. The nearest are searched ring by ring of cells around the place, or in all cells if those are
// fewer: with members anywhere up to the lattice's edge, all at one place or far apart, a search looks at each cell once.
// Not thread-safe. Bounds: one entry a member, one cell a member at most.

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/wire/messages.h"

namespace ridgecast::presence {

class Crowd {
 public:
  struct Cell {
    std::int64_t i = 0, j = 0;
    friend auto operator<=>(const Cell&, const Cell&) = default;
  };
  class Participant {
   public:
    const wire::Member& member() const { return member_; }
    std::uint64_t version() const { return version_; }  // of its last change
    // wire::encodePart of its last move, made once; there is one.
    const std::string& moved(bool withState) const;

   private:
    friend class Crowd;
    wire::Member member_;
    std::uint64_t version_ = 0;
    Cell cell_;              // if it has a place
    std::size_t index_ = 0;  // in that cell
    mutable std::array<std::string, 2> moved_;
  };

  // The member is new.
  Participant& add(wire::Member member);
  void move(Participant& who, wire::Moved moved);
  void remove(std::uint64_t camera);  // if it is there
  const Participant* find(std::uint64_t camera) const;
  Participant* find(std::uint64_t camera) { return const_cast<Participant*>(std::as_const(*this).find(camera)); }
  const std::map<std::uint64_t, Participant>& all() const { return all_; }
  std::size_t size() const { return all_.size(); }
  std::uint64_t version() const { return version_; }  // grows with each change

  // So many nearest to this member, itself not among them, by distance, equal ones by number; then those without a place, by number. To a
  // member without a place all are equally near.
  std::vector<const Participant*> nearest(const Participant& to, std::size_t count) const;

  // Of the least cells that are `most` at most.
  wire::Crowd counts(std::size_t most) const;

 private:
  struct Spot {  // steps
    double x = 0, z = 0, y = 0;
    Participant* who = nullptr;
  };
  struct HashOfCell {
    std::size_t operator()(const Cell& c) const {
      return lattice::mix(static_cast<std::uint64_t>(c.i) ^ lattice::mix(static_cast<std::uint64_t>(c.j)));
    }
  };
  class Search;

  void place(Participant& who);
  void unplace(Participant& who);

  std::map<std::uint64_t, Participant> all_;
  std::unordered_map<Cell, std::vector<Spot>, HashOfCell> cells_;  // none is empty
  std::size_t placed_ = 0;
  std::uint64_t version_ = 0;
};

}  // namespace ridgecast::presence
