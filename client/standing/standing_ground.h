#pragma once
// Ground under bodies: tiles of heights around each of them, kept while they move, for physics engines.
//
// A tile is a grid of kCells x kCells squares, `spacing` steps wide each; the corner of least x and z of tile (i, j) is at i, j times its
// side.
// Neighbours share their border's heights, which are the terrain's, bit for bit. Bodies close together share tiles.
//
// move() takes the bodies' positions, once a step. A separate thread makes ground ahead of them, nearest first, so no step waits: a body
// keeps its tiles until it has moved a quarter of a tile beyond what they cover. changes() then says what came and what is gone.
//
// A tile whose ground an edit changes stays until it is remade: it goes and its successor comes in the same changes(). Edits are taken in
// by move(), wait() and changes().
//
// One owner; the thread only asks `source`. Bounds: kMaxBodies, kMaxPlaces, and `memory` bytes of tiles: what does not fit is not made,
// and wait() says so.

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "client/query/ground.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::standing {

inline constexpr std::int64_t kCells = 32;
inline constexpr std::size_t kMaxBodies = 100'000;
inline constexpr std::size_t kMaxPlaces = 1'000'000;  // tiles around bodies, counted for each body

struct Tile {
  std::int64_t i = 0, j = 0;
  lattice::Step spacing = 0;
  std::uint64_t version = 0;        // of all tiles of this ground: grows with each one made
  std::uint64_t edit = 0;           // the last edit that it includes; later ones changed other ground, as far as heard
  float error = 0;                  // metres: the true ground is at most this far from the squares, split along either diagonal (measured)
  float lowest = 0, highest = 0;    // metres, of `heights`
  std::vector<float> heights = {};  // metres, (kCells + 1) a row of ascending x, rows of ascending z
  lattice::Step x() const { return i * kCells * spacing; }
  lattice::Step z() const { return j * kCells * spacing; }
  lattice::Area area() const { return {x(), z(), x() + kCells * spacing + 1, z() + kCells * spacing + 1}; }  // its border included
};

struct Changes {
  std::vector<std::shared_ptr<const Tile>> gone, came;  // `gone` comes first
};

// The true terrain: query::Ground's functions of these names.
struct Source {
  // Returns the last edit that all of them include. Called on the ground's own thread.
  std::function<Outcome<std::uint64_t>(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out)> heights;
  // Never waits; called by both threads.
  std::function<query::News(std::uint64_t edit)> since;
  // Waits until what it must know is heard of, or for so long.
  std::function<void(std::chrono::milliseconds timeout)> hear;
};
Source sourceOf(query::Ground ground);

class StandingGround {
 public:
  struct Options {
    lattice::Step spacing = lattice::kStepsPerMetre;      // steps, a multiple of 4 up to 2^20
    lattice::Step radius = 32 * lattice::kStepsPerMetre;  // steps of ground around each body: 0 to 64 tiles
    std::size_t memory = 50'000'000;                      // bytes
  };
  // Error: an option out of range.
  static Outcome<std::unique_ptr<StandingGround>> open(Source source, const Options& options);
  ~StandingGround();  // waits for the tile being made

  // All bodies, in the same order each time: the k-th stays the k-th. Never waits for heights. Error: too many, too much ground around
  // them, or one beyond the lattice; then nothing changed.
  Outcome<void> move(std::span<const lattice::Point> bodies);
  std::size_t bodies() const { return bodies_.size(); }
  // For each body, 1: the ground within its radius is there, with all edits that were heard of; 0: not yet. `out` has bodies() of them.
  void ready(std::span<std::uint8_t> out) const;
  // Waits until the ground around all bodies is there, with all edits that were heard of or that the source must know. Error: why it did
  // not come.
  Outcome<void> wait(std::chrono::milliseconds timeout);
  // Changes since the last call. A tile may be used until it is reported as gone. Never waits.
  Changes changes();
  std::size_t bytes() const;  // of tiles
  bool full() const;          // no further tile fits, and some are missing

 private:
  using Key = std::pair<std::int64_t, std::int64_t>;
  struct KeyHash {
    std::size_t operator()(const Key& k) const {
      return lattice::mix(static_cast<std::uint64_t>(k.first) + lattice::mix(static_cast<std::uint64_t>(k.second)));
    }
  };
  struct Window {  // of tiles, inclusive
    std::int64_t i0 = 0, j0 = 0, i1 = -1, j1 = -1;
    double count() const { return static_cast<double>(i1 - i0 + 1) * static_cast<double>(j1 - j0 + 1); }
    bool holds(const Window& other) const { return i0 <= other.i0 && j0 <= other.j0 && i1 >= other.i1 && j1 >= other.j1; }
  };
  struct Place {
    std::size_t bodies = 0;              // whose windows hold it
    double distance = 0;                 // of the first body that needed it, at that time
    std::shared_ptr<const Tile> tile{};  // null: not made yet
    bool told = false;                   // that it came
  };
  using Queue = std::set<std::pair<double, Key>>;  // the nearest first

  StandingGround(Source source, const Options& options);
  Window around(lattice::Point body, lattice::Step radius) const;
  void add(const Window& window, lattice::Point body);
  void remove(const Window& window);
  bool isReady(const Window& window) const;
  std::uint64_t hear();  // takes in edits and what they changed; returns one to wait for, 0: none
  void run();
  // Under the lock.
  bool isDone() const { return stale_.empty() && (wanted_.empty() || made_ >= most_); }
  const Queue* next() const;  // whose first tile is to be made; null: none
  void keep(Key key, std::shared_ptr<const Tile> tile);
  bool age(Key key, const query::Change& change);  // true: its tile lacks this change
  Outcome<std::shared_ptr<const Tile>> make(Key key);

  const Source source_;
  const Options options_;
  const std::size_t most_;  // tiles
  std::vector<lattice::Point> bodies_;
  std::vector<Window> windows_;  // of the bodies

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable work_, done_;
  std::uint64_t heard_ = 0;  // the last edit
  std::unordered_map<Key, Place, KeyHash> places_;
  Queue wanted_;                                   // that are not made
  Queue stale_;                                    // made before a later edit of their ground
  std::set<Key> came_;                             // made and not reported yet
  std::vector<std::shared_ptr<const Tile>> gone_;  // reported before
  std::size_t made_ = 0;                           // tiles held
  std::uint64_t version_ = 0;
  std::optional<Error> failed_;  // why the last attempt failed
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace ridgecast::standing
