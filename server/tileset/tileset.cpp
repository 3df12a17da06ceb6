#include "server/tileset/tileset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <unordered_map>
#include <utility>

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

Json boxOf(const Known& tile, lattice::Point origin) {
  const double west = metres(tile.low.x - origin.x), east = metres(tile.high.x - origin.x);
  const double north = -metres(tile.low.z - origin.z), south = -metres(tile.high.z - origin.z);
  return {{"box",
           {(west + east) / 2, (north + south) / 2, (tile.lowest + tile.highest) / 2, (east - west) / 2, 0, 0, 0, (north - south) / 2, 0, 0,
            0, (tile.highest - tile.lowest) / 2}}};
}

// The tile without content and children, in the parent's frame.
Json tileOf(LeafAddress square, const Known& known, lattice::Point parent) {
  const lattice::Point frame = frameOf(square);
  Json out{{"boundingVolume", boxOf(known, frame)}, {"geometricError", known.error}};
  if (frame != parent)
    out["transform"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, metres(frame.x - parent.x), -metres(frame.z - parent.z), 0, 1};
  return out;
}

Json contentOf(LeafAddress square, const char* folder, const char* ending, const std::string& query) {
  return {{"uri", folder + std::to_string(square.level) + "/" + std::to_string(square.i) + "/" + std::to_string(square.j) + ending +
                      (query.empty() ? "" : "?" + query)}};
}

// Null: there is no such tile.
Json tree(const Pyramid& pyramid, LeafAddress square, int last, lattice::Point parent) {
  const auto known = pyramid.tile(square);
  if (!known) return nullptr;
  Json out = tileOf(square, *known, parent);
  const bool refers = square.level < last && square.level > pyramid.finest;
  out["content"] = contentOf(square, "../../", refers ? ".json" : ".glb", pyramid.query);
  if (refers || square.level == pyramid.finest) return out;
  for (int quadrant = 0; quadrant < 4; ++quadrant)
    if (Json child = tree(pyramid, square.child(quadrant), last, frameOf(square)); !child.is_null())
      out["children"].push_back(std::move(child));
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
  for (const LeafAddress square : root.squares) {
    const auto known = pyramid.tile(square);
    if (!known) continue;
    children.push_back(tileOf(square, *known, root.origin));
    children.back()["content"] = contentOf(square, "", square.level == pyramid.finest ? ".glb" : ".json", pyramid.query);
    if (!all) all = known;
    all->include(*known);
  }
  Json out{
      {"boundingVolume", boxOf(all.value_or(Known()), root.origin)}, {"geometricError", root.error}, {"children", std::move(children)}};
  if (root.transform) out["transform"] = *root.transform;
  Json asset = Json::object();
  if (!root.extras.empty()) asset["extras"] = Json::parse(root.extras);
  return written(std::move(out), root.error, std::move(asset));
}

std::string tilesetOf(const Pyramid& pyramid, LeafAddress square) {
  const int last = std::max(pyramid.finest, square.level - kLevels + 1);
  Json root = tree(pyramid, square, last, frameOf(square));
  const double error = root["geometricError"];
  return written(std::move(root), 2 * error);
}

std::string rootTileset(const terrain::Terrain& terrain, const Question& question, std::string_view query) {
  int level = 0;
  while (level < kCoarsest && metres(LeafAddress{level + 1, 0, 0}.side()) <= question.reach) ++level;
  const auto reach = static_cast<Step>(std::ceil(question.reach * lattice::kStepsPerMetre));
  const auto [x, z] = question.middle;
  const LeafAddress low = lattice::leafAt({x - reach, z - reach}, level), high = lattice::leafAt({x + reach - 1, z + reach - 1}, level);
  Root root{.squares = {}, .origin = question.middle, .transform = {}, .error = 2 * question.reach};
  for (LeafAddress at = low; at.i <= high.i; ++at.i)
    for (at.j = low.j; at.j <= high.j; ++at.j)
      if (isTile(at)) root.squares.push_back(at);
  root.transform = earth::rootOf(question.isPrivate ? nullptr : terrain.raster(), question.middle, question.at);
  return rootTileset({[&](LeafAddress at) { return knownBy(at, Heights(terrain, at, level)[at]); }, 0, std::string(query)}, root);
}

std::string tilesetOf(const terrain::Terrain& terrain, LeafAddress square, std::string_view query) {
  const Heights heights(terrain, square, std::max(0, square.level - kLevels));
  return tilesetOf({[&](LeafAddress at) { return knownBy(at, heights[at]); }, 0, std::string(query)}, square);
}

}  // namespace ridgecast::tileset
