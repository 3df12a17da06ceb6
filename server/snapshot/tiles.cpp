#include "server/snapshot/tiles.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "server/snapshot/description.h"
#include "server/tileset/tile.h"
#include "server/tileset/tileset.h"

namespace ridgecast::snapshot {

namespace {

using lattice::LeafAddress;
using lattice::Step;

constexpr Step kMinPosts = 64;    // along a side of the finest tiles
constexpr double kMaxDrop = 0.4;  // of their error

// The squares of a level that a box meets.
struct Squares {
  LeafAddress low, high;
  Squares(const box::Box& box, int level)
      : low(lattice::leafAt(box.low, level)), high(lattice::leafAt({box.high.x - 1, box.high.z - 1}, level)) {}
  std::uint64_t across() const { return static_cast<std::uint64_t>(high.i - low.i + 1); }
  std::uint64_t count() const { return across() * static_cast<std::uint64_t>(high.j - low.j + 1); }
  template <class F>
  void forEach(F&& f) const {
    for (LeafAddress at = low; at.i <= high.i; ++at.i)
      for (at.j = low.j; at.j <= high.j; ++at.j) f(at);
  }
};

// The levels of a box's tiles.
struct Levels {
  int finest = 0, coarsest = 0;
  Levels(const box::Box& box, const terrain::Raster* map, bool isOnGlobe) {
    expects(box.low.x < box.high.x && box.low.z < box.high.z && box.error > 0, "a box of tiles has ground and an error");
    const Step posts = map ? static_cast<Step>(std::ceil(kMinPosts * map->shape().finest())) : 0;
    while (finest < tileset::kCoarsest && tileset::errorOf(finest) < box.error) ++finest;
    while (finest < tileset::kCoarsest && LeafAddress{finest, 0, 0}.side() < posts &&
           !(isOnGlobe && tileset::dropOf(finest + 1) > kMaxDrop * box.error))
      ++finest;
    coarsest = finest;
    while (coarsest < tileset::kCoarsest && Squares(box, coarsest).count() > 4) ++coarsest;
  }
  std::uint64_t tiles(const box::Box& box) const {
    std::uint64_t sum = 0;
    for (int level = finest; level <= coarsest; ++level) sum += Squares(box, level).count();
    return sum;
  }
};

Problem tooMany(const box::Box& box, const terrain::Raster* map, bool isOnGlobe, std::uint64_t tiles) {
  box::Box coarser = box;
  std::uint64_t fewer = tiles;
  while (fewer > kMaxTiles) {
    coarser.error *= 2;
    expects(std::isfinite(coarser.error), "at some error a box has few enough tiles");
    fewer = Levels(coarser, map, isOnGlobe).tiles(coarser);
  }
  return {Problem::Kind::kTooMuch, "This box at an error of " + text::rounded(box.error, 6) + " m takes " + std::to_string(tiles) +
                                       " tiles, more than " + std::to_string(kMaxTiles) + ", the limit; at an error of " +
                                       text::rounded(coarser.error, 6) + " m it takes " + std::to_string(fewer) + "."};
}

std::string nameOf(LeafAddress square, const char* ending) {
  return std::to_string(square.level) + "/" + std::to_string(square.i) + "/" + std::to_string(square.j) + ending;
}

class Making {
 public:
  Making(Snapshots& snapshots, const session::Session& session, const Question& question, const Put& put)
      : snapshots_(snapshots),
        session_(session),
        ground_(session.ground()),
        question_(question),
        box_(std::get<OfBox>(question.of)),
        placement_(
            earth::Placement::of(session.resources().limits.sendsTerrain ? ground_.terrain->raster() : nullptr, origin(), question.where)),
        levels_(box_, ground_.terrain->raster(), placement_.has_value()),
        put_(put) {}

  Result<std::uint32_t> run(unsigned threads, const std::stop_token& stop, TilesProgress* progress) {
    const std::uint64_t all = levels_.tiles(box_);
    if (all > kMaxTiles) return tooMany(box_, ground_.terrain->raster(), placement_.has_value(), all);
    std::vector<LeafAddress> squares;
    for (int level = levels_.coarsest; level >= levels_.finest; --level)
      Squares(box_, level).forEach([&](LeafAddress square) { squares.push_back(square); });
    if (progress) progress->tiles = static_cast<std::uint32_t>(all);
    std::atomic<std::size_t> next{0};
    {
      std::vector<std::jthread> workers;
      for (unsigned k = 0; k < std::max(1u, threads); ++k)
        workers.emplace_back([&] {
          for (std::size_t at; (at = next++) < squares.size() && !failed();) {
            make(squares[at], stop);
            if (progress) ++progress->done;
          }
        });
    }
    if (problem_) return *problem_;
    if (!putTilesets()) return *problem_;
    return static_cast<std::uint32_t>(all);
  }

 private:
  void make(LeafAddress square, const std::stop_token& stop) {
    Question question = question_;
    question.format = Format::kGlb;
    OfTile of = tileset::whole(square);
    of.box.low = {std::max(of.box.low.x, box_.low.x), std::max(of.box.low.z, box_.low.z)};
    of.box.high = {std::min(of.box.high.x, box_.high.x), std::min(of.box.high.z, box_.high.z)};
    of.box.error = std::ldexp(box_.error, square.level - levels_.finest);
    question.of = of;
    auto made = snapshots_.take(session_, ground_, question, false, stop);
    if (!made) return fail(made.error());
    if (!put(nameOf(square, ".glb"), made->file)) return;
    expects(made->tile.has_value(), "a tile's snapshot says what the tile holds");
    const std::lock_guard lock(mutex_);
    known_.emplace(square, *made->tile);
  }

  bool putTilesets() {
    for (int level = levels_.finest; level < levels_.coarsest; ++level)  // a tile's box contains those below it
      Squares(box_, level).forEach([&](LeafAddress square) { known_.at(square.parent()).include(known_.at(square)); });
    const tileset::Pyramid pyramid{[this](LeafAddress square) {
                                     const auto found = known_.find(square);
                                     return found == known_.end() ? std::nullopt : std::optional(found->second);
                                   },
                                   levels_.finest, "", placement_};
    bool done = true;
    for (int level = levels_.coarsest; level > levels_.finest; level -= tileset::kLevels)
      Squares(box_, level).forEach([&](LeafAddress square) {
        done = done && put(nameOf(square, ".json"), tileset::tilesetOf(pyramid, square));
      });
    return done && put("tileset.json", root(pyramid));
  }

  lattice::Point origin() const { return {(box_.low.x + box_.high.x) / 2, (box_.low.z + box_.high.z) / 2}; }

  std::string root(const tileset::Pyramid& pyramid) const {
    tileset::Root root;
    const auto metres = [](Step steps) { return static_cast<double>(steps) * lattice::kMetresPerStep; };
    Squares(box_, levels_.coarsest).forEach([&](LeafAddress square) { root.squares.push_back(square); });
    root.origin = origin();
    root.error = metres(std::max(box_.high.x - box_.low.x, box_.high.z - box_.low.z));
    nlohmann::json extras{{"of", "tiles"},
                          {"box", describeBox(box_.low, box_.high)},
                          {"error", {{"unit", "metres"}, {"asked", box_.error}}},
                          {"origin", {{"x", metres(root.origin.x)}, {"z", metres(root.origin.z)}}},
                          {"tiles", known_.size()}};
    describeWorld(session_, ground_, root.origin, extras);
    root.extras = extras.dump();
    return tileset::rootTileset(pyramid, root);
  }

  bool put(const std::string& name, std::string_view bytes) {
    if (put_(name, bytes)) return true;
    fail({Problem::Kind::kFailed, "Cannot write '" + name + "'; is there room for it?"});
    return false;
  }
  void fail(const Problem& problem) {
    const std::lock_guard lock(mutex_);
    if (!problem_) problem_ = problem;
  }
  bool failed() const {
    const std::lock_guard lock(mutex_);
    return problem_.has_value();
  }

  Snapshots& snapshots_;
  const session::Session& session_;
  const editing::Ground ground_;  // of all tiles
  const Question& question_;
  const box::Box box_;
  const std::optional<earth::Placement> placement_;
  const Levels levels_;
  const Put& put_;
  mutable std::mutex mutex_;
  std::unordered_map<LeafAddress, tileset::Known, lattice::LeafAddressHash> known_;
  std::optional<Problem> problem_;
};

}  // namespace

std::string TilesProgress::text() const {
  return "meshing, tile " + std::to_string(std::min(done + 1, tiles.load())) + " of " + std::to_string(tiles);
}

Result<std::uint32_t> makeTiles(Snapshots& snapshots, const session::Session& session, const Question& question, unsigned threads,
                                const Put& put, std::stop_token stop, TilesProgress* progress) {
  return Making(snapshots, session, question, put).run(threads, stop, progress);
}

}  // namespace ridgecast::snapshot
