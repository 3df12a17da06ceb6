#include "server/tileset/tileset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <unordered_map>
#include <utility>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "server/box/samples.h"
#include "server/tileset/tile.h"

namespace ridgecast::tileset {

using lattice::LeafAddress;
using lattice::Step;
using Json = nlohmann::json;

namespace {

using lattice::metres;

struct Range {  // metres
  double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();
  void include(const Range& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
  }
};

Range rangeOf(const box::Tile& tile) {
  const auto [low, high] = std::ranges::minmax(std::span(tile.height, tile.count()));
  const double slack = tile.most;
  return {low - slack, high + slack};
}

// Heights of the squares of one level that a larger square contains, and of their ancestors.
class Heights {
 public:
  Heights(const terrain::Terrain& terrain, LeafAddress square, int finest) {
    const int unitBits = std::max(0, square.sideBits() - 20);
    const auto side = static_cast<std::int32_t>(square.side() >> unitBits);
    const int bits = lattice::kFinestSideBits + finest - unitBits - box::Samples::kCellBits;
    const box::Frame frame{{square.x(), square.z()}, unitBits};
    box::Samples samples(terrain, frame, {0, 0}, {side - 1, side - 1}, bits);
    for (std::size_t k = 0; k < samples.size(); ++k) {
      samples.fill(k);
      Range range = rangeOf(samples[k]);
      if (const terrain::Raster* map = terrain.raster(); map && !terrain.edits()) {
        const terrain::RasterBounds bounds = terrain::boundsOf(map->shape());
        range = {std::max(range.low, bounds.lowest), std::min(range.high, bounds.highest)};
      }
      for (LeafAddress at = lattice::leafAt(frame.global(samples[k].corner), finest); at.level <= square.level; at = at.parent())
        ranges_[at].include(range);
    }
  }
  const Range& operator[](LeafAddress square) const { return ranges_.at(square); }

 private:
  std::unordered_map<LeafAddress, Range, lattice::LeafAddressHash> ranges_;
};

lattice::Point middleOf(LeafAddress square) { return {square.x() + square.side() / 2, square.z() + square.side() / 2}; }

// From the frame's own axes, x east, y north, z up, to the globe, by the plane at `place`.
std::optional<earth::Matrix> worldOf(const earth::Placement& placement, lattice::Point frame, lattice::Point place) {
  const auto plane = placement.at(place);
  if (!plane) return std::nullopt;
  return earth::product(*plane, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, metres(frame.x - place.x), -metres(frame.z - place.z), 0, 1});
}

// Where its tiles lie on planes of their own, they leave that of a larger one by as much as the Earth is curved.
Known curved(Known tile) {
  const double across = std::hypot(metres(tile.high.x - tile.low.x), metres(tile.high.z - tile.low.z)) / 2;
  const double drop = across * across / kEarthRadius;  // twice that of a sphere
  const auto aside =
      static_cast<Step>((std::max(std::abs(tile.lowest), std::abs(tile.highest)) + drop) * across / kEarthRadius * 256 + 256);
  tile.lowest -= drop;
  tile.highest += drop / 8;  // a place's ellipsoid beside that of WGS84, scale
  tile.low = {tile.low.x - aside, tile.low.z - aside};
  tile.high = {tile.high.x + aside, tile.high.z + aside};
  return tile;
}

Json boxOf(const Known& tile, lattice::Point origin) {
  const double west = metres(tile.low.x - origin.x), east = metres(tile.high.x - origin.x);
  const double north = -metres(tile.low.z - origin.z), south = -metres(tile.high.z - origin.z);
  return {{"box",
           {(west + east) / 2, (north + south) / 2, (tile.lowest + tile.highest) / 2, (east - west) / 2, 0, 0, 0, (north - south) / 2, 0, 0,
            0, (tile.highest - tile.lowest) / 2}}};
}

// Where a tile's own coordinates begin, the place whose plane it lies on and, on the globe, from them to it; empty: it is out of reach.
struct Frame {
  lattice::Point origin, place;
  std::optional<earth::Matrix> world;
};
Frame frameAt(const Pyramid& pyramid, lattice::Point origin, lattice::Point place) {
  return {origin, place, pyramid.placement ? worldOf(*pyramid.placement, origin, place) : std::nullopt};
}
Frame ownOf(const Pyramid& pyramid, LeafAddress square) { return frameAt(pyramid, frameOf(square), middleOf(square)); }

// The tile without content and children, in the parent's frame. Null: the globe does not reach there.
Json tileOf(const Pyramid& pyramid, LeafAddress square, const Known& known, const Frame& own, const Frame& parent) {
  Json out{{"boundingVolume", boxOf(pyramid.placement ? curved(known) : known, own.origin)},
           {"geometricError", known.error + (pyramid.placement ? dropOf(square.level) : 0)}};
  if (own.origin == parent.origin && own.place == parent.place) return out;
  if (!pyramid.placement) {
    if (own.origin != parent.origin)
      out["transform"] = {
          1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, metres(own.origin.x - parent.origin.x), -metres(own.origin.z - parent.origin.z), 0, 1};
    return out;
  }
  if (!own.world || !parent.world) return nullptr;
  out["transform"] = earth::product(earth::inverse(*parent.world), *own.world);
  return out;
}

Json contentOf(LeafAddress square, const char* folder, const char* ending, const std::string& query) {
  return {{"uri", folder + std::to_string(square.level) + "/" + std::to_string(square.i) + "/" + std::to_string(square.j) + ending +
                      (query.empty() ? "" : "?" + query)}};
}

// Without a parent: in its own frame. Null: there is no such tile.
Json tree(const Pyramid& pyramid, LeafAddress square, int last, const Frame* parent) {
  const auto known = pyramid.tile(square);
  if (!known) return nullptr;
  const Frame own = ownOf(pyramid, square);
  Json out = tileOf(pyramid, square, *known, own, parent ? *parent : own);
  if (out.is_null()) return out;
  const bool refers = square.level < last && square.level > pyramid.finest;
  out["content"] = contentOf(square, "../../", refers ? ".json" : ".glb", pyramid.query);
  if (refers || square.level == pyramid.finest) return out;
  for (int quadrant = 0; quadrant < 4; ++quadrant)
    if (Json child = tree(pyramid, square.child(quadrant), last, &own); !child.is_null()) out["children"].push_back(std::move(child));
  return out;
}

// Of a square of the terrain.
Known knownBy(LeafAddress square, const Range& heights) {
  const double error = errorOf(square.level);
  return {{square.x(), square.z()},
          {square.x() + square.side(), square.z() + square.side()},
          heights.low - error - skirtOf(error),
          heights.high + error,
          error};
}

std::optional<earth::Placement> placementOf(const terrain::Terrain& terrain, const Question& question) {
  return earth::Placement::of(question.isPrivate ? nullptr : terrain.raster(), question.middle, question.where);
}

std::string written(Json root, double error, Json asset = Json::object()) {
  root["refine"] = "REPLACE";
  asset["version"] = "1.1";
  asset["generator"] = "Ridgecast";
  return Json{{"asset", std::move(asset)}, {"geometricError", error}, {"root", std::move(root)}}.dump();
}

}  // namespace

void Known::include(const Known& other) {
  low = {std::min(low.x, other.low.x), std::min(low.z, other.low.z)};
  high = {std::max(high.x, other.high.x), std::max(high.z, other.high.z)};
  lowest = std::min(lowest, other.lowest);
  highest = std::max(highest, other.highest);
  error = std::max(error, other.error);
}

std::string rootTileset(const Pyramid& pyramid, const Root& root) {
  Json children = Json::array();
  std::optional<Known> all;
  const Frame own = frameAt(pyramid, root.origin, root.origin);
  for (const LeafAddress square : root.squares) {
    const auto known = pyramid.tile(square);
    if (!known) continue;
    Json child = tileOf(pyramid, square, *known, ownOf(pyramid, square), own);
    if (child.is_null()) continue;
    children.push_back(std::move(child));
    children.back()["content"] = contentOf(square, "", square.level == pyramid.finest ? ".glb" : ".json", pyramid.query);
    if (!all) all = known;
    all->include(*known);
  }
  Known covered = all.value_or(Known());
  if (pyramid.placement) covered = curved(covered);
  Json out{{"boundingVolume", boxOf(covered, root.origin)}, {"geometricError", root.error}, {"children", std::move(children)}};
  if (own.world) out["transform"] = *own.world;
  Json asset = Json::object();
  if (!root.extras.empty()) asset["extras"] = Json::parse(root.extras);
  if (pyramid.placement)
    asset["extras"]["heights"] =
        pyramid.placement->heights() == earth::Heights::kSea ? "above the sea (EGM96)" : "above the ellipsoid (WGS84)";
  return written(std::move(out), root.error, std::move(asset));
}

std::string tilesetOf(const Pyramid& pyramid, LeafAddress square) {
  expects(isTile(square) && square.level >= pyramid.finest, "a tileset begins at a tile of its pyramid");
  const int last = std::max(pyramid.finest, square.level - kLevels + 1);
  Json root = tree(pyramid, square, last, nullptr);
  const double error = root["geometricError"];
  return written(std::move(root), 2 * error);
}

std::string rootTileset(const terrain::Terrain& terrain, const Question& question, std::string_view query) {
  expects(question.reach >= kMinReach && question.reach <= kMaxReach, "a tileset reaches 100 m to 1,000 km");
  int level = 0;
  while (level < kCoarsest && metres(LeafAddress{level + 1, 0, 0}.side()) <= question.reach) ++level;
  const auto reach = static_cast<Step>(std::ceil(question.reach * lattice::kStepsPerMetre));
  const auto [x, z] = question.middle;
  const LeafAddress low = lattice::leafAt({x - reach, z - reach}, level), high = lattice::leafAt({x + reach - 1, z + reach - 1}, level);
  Root root{.squares = {}, .origin = question.middle, .error = 2 * question.reach};
  for (LeafAddress at = low; at.i <= high.i; ++at.i)
    for (at.j = low.j; at.j <= high.j; ++at.j)
      if (isTile(at)) root.squares.push_back(at);
  return rootTileset(
      {[&](LeafAddress at) { return knownBy(at, Heights(terrain, at, level)[at]); }, 0, std::string(query), placementOf(terrain, question)},
      root);
}

std::string tilesetOf(const terrain::Terrain& terrain, const Question& question, LeafAddress square, std::string_view query) {
  const Heights heights(terrain, square, std::max(0, square.level - kLevels));
  return tilesetOf({[&](LeafAddress at) { return knownBy(at, heights[at]); }, 0, std::string(query), placementOf(terrain, question)},
                   square);
}

}  // namespace ridgecast::tileset
