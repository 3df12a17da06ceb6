#pragma once
// Ground under bodies: tiles of heights around each of them, kept while they move, for physics engines.
//
// A tile is a grid of kCells x kCells squares, `spacing` steps wide each; the corner of least x and z of tile (i, j) is at i, j times its
// side.
// Neighbours share their border's heights, which are the terrain's, bit for bit. Bodies close together share tiles.
//
// move() says where the bodies are, once a step. Ground is made ahead of them by a thread of its own, the nearest first, so no step waits:
// a body keeps its tiles until it has moved a quarter of a tile beyond what they cover. changes() then says what came and what is gone.
//
// One owner; the thread only calls `heights`. Bounds: kMostBodies, kMostPlaces, and `memory` bytes of tiles: what does not fit is not made,
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

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::standing {

inline constexpr std::int64_t kCells = 32;
inline constexpr std::size_t kMostBodies = 100'000;
inline constexpr std::size_t kMostPlaces = 1'000'000;  // tiles around bodies, counted for each body

struct Tile {
  std::int64_t i = 0, j = 0;
  lattice::Step spacing = 0;
  std::uint64_t version = 0;        // of all tiles of this ground: grows with each that is made
  float error = 0;                  // metres: the true ground is at most so far from the squares, split along either diagonal (measured)
  float lowest = 0, highest = 0;    // metres, of `heights`
  std::vector<float> heights = {};  // metres, (kCells + 1) a row of ascending x, rows of ascending z
  lattice::Step x() const { return i * kCells * spacing; }
  lattice::Step z() const { return j * kCells * spacing; }
};

struct Changes {
  std::vector<std::shared_ptr<const Tile>> gone, came;  // those that went first
};

// The true terrain's heights (query::Ground). Called by the ground's own thread.
using Heights = std::function<Outcome<void>(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out)>;

class StandingGround {
 public:
  struct Options {
    lattice::Step spacing = lattice::kStepsPerMetre;      // steps, a multiple of 4 up to 2^20
    lattice::Step radius = 32 * lattice::kStepsPerMetre;  // steps of ground around each body: 0 to 64 tiles
    std::size_t memory = 50'000'000;                      // bytes
  };
  // Error: an option out of range.
  static Outcome<std::unique_ptr<StandingGround>> open(Heights heights, const Options& options);
  ~StandingGround();  // waits for the tile in work

  // All bodies, in the same order each time: the k-th is the one that was the k-th before. Never waits for heights. Error: too many, too
  // much ground around them, or one beyond the lattice; then nothing changed.
  Outcome<void> move(std::span<const lattice::Point> bodies);
  // Until the ground around all bodies is there. Error: it does not come, and why.
  Outcome<void> wait(std::chrono::milliseconds timeout);
  // What changed since the last call. A tile may be used until it is told that it is gone.
  Changes changes();
  std::size_t bytes() const;  // of tiles
  bool full() const;          // no tile more fits, and some are missing

 private:
  using Key = std::pair<std::int64_t, std::int64_t>;
  struct KeyHash {
    std::size_t operator()(const Key& k) const {
      return lattice::mix(static_cast<std::uint64_t>(k.first) + lattice::mix(static_cast<std::uint64_t>(k.second)));
    }
  };
  struct Window {  // of tiles, inclusive
    std::int64_t i0 = 0, j0 = 0, i1 = -1, j1 = -1;
    bool holds(const Window& other) const { return i0 <= other.i0 && j0 <= other.j0 && i1 >= other.i1 && j1 >= other.j1; }
  };
  struct Place {
    std::size_t bodies = 0;              // whose windows hold it
    double distance = 0;                 // of the body that asked first, then
    std::shared_ptr<const Tile> tile{};  // null: not made yet
    bool told = false;                   // that it came
  };

  StandingGround(Heights heights, const Options& options);
  Window around(lattice::Point body, lattice::Step radius) const;
  void add(const Window& window, lattice::Point body);
  void remove(const Window& window);
  void run();
  Outcome<std::shared_ptr<const Tile>> make(Key key);

  const Heights heights_;
  const Options options_;
  const std::size_t most_;       // tiles
  std::vector<Window> windows_;  // of the bodies

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable work_, done_;
  std::unordered_map<Key, Place, KeyHash> places_;
  std::set<std::pair<double, Key>> wanted_;        // that are not made, the nearest first
  std::set<Key> came_;                             // and are not told
  std::vector<std::shared_ptr<const Tile>> gone_;  // were told before
  std::size_t made_ = 0;                           // tiles held
  std::uint64_t version_ = 0;
  std::optional<Error> failed_;  // why the last try did
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace ridgecast::standing
