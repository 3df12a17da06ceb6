#include "server/tileset/tileset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "common/terrain/raster.h"
#include "server/box/samples.h"
#include "server/tileset/tile.h"

namespace ridgecast::tileset {

using lattice::LeafAddress;
using lattice::Step;
using Json = nlohmann::json;

namespace {

constexpr int kLevels = 3;  // of tiles in a tileset; it refers to those of the next

double metres(Step steps) { return static_cast<double>(steps) * lattice::kMetresPerStep; }

struct Range {  // metres
  double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();
  void include(const Range& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
  }
};

Range rangeOf(const box::Tile& tile) {
  const auto [low, high] = std::ranges::minmax(tile.height);
  const double slack = std::ranges::max(tile.slack);
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
      if (const terrain::Raster* map = terrain.raster()) {
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

Json boxOf(double x, double y, double halfX, double halfY, const Range& z) {
  return {{"box", {x, y, (z.low + z.high) / 2, halfX, 0, 0, 0, halfY, 0, 0, 0, (z.high - z.low) / 2}}};
}

// The tile without content and children, in the parent's frame.
Json tileOf(LeafAddress square, const Range& heights, lattice::Point parent) {
  const lattice::Point frame = frameOf(square);
  const double half = metres(square.side()) / 2, error = errorOf(square.level);
  const Range all{heights.low - error - skirtOf(square.level), heights.high + error};
  Json out{{"boundingVolume", boxOf(metres(square.x() - frame.x) + half, -(metres(square.z() - frame.z) + half), half, half, all)},
           {"geometricError", error}};
  if (frame != parent)
    out["transform"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, metres(frame.x - parent.x), -metres(frame.z - parent.z), 0, 1};
  return out;
}

Json contentOf(LeafAddress square, const char* folder, const char* ending, std::string_view query) {
  return {{"uri", folder + std::to_string(square.level) + "/" + std::to_string(square.i) + "/" + std::to_string(square.j) + ending + "?" +
                      std::string(query)}};
}

Json tree(const Heights& heights, LeafAddress square, int last, lattice::Point parent, std::string_view query) {
  Json out = tileOf(square, heights[square], parent);
  const bool refers = square.level < last && square.level > 0;
  out["content"] = contentOf(square, "../../", refers ? ".json" : ".glb", query);
  if (refers || square.level == 0) return out;
  for (int quadrant = 0; quadrant < 4; ++quadrant)
    out["children"].push_back(tree(heights, square.child(quadrant), last, frameOf(square), query));
  return out;
}

std::string written(Json root, double error) {
  root["refine"] = "REPLACE";
  return Json{{"asset", {{"version", "1.1"}, {"generator", "Ridgecast"}}}, {"geometricError", error}, {"root", std::move(root)}}.dump();
}

}  // namespace

std::array<double, 16> eastNorthUp(const Place& place) {
  constexpr double kRadius = 6'378'137, kFlattening = 1 / 298.257223563, kEccentricity2 = kFlattening * (2 - kFlattening);
  const double sinLon = std::sin(place.longitude), cosLon = std::cos(place.longitude);
  const double sinLat = std::sin(place.latitude), cosLat = std::cos(place.latitude);
  const double normal = kRadius / std::sqrt(1 - kEccentricity2 * sinLat * sinLat), out = (normal + place.height) * cosLat;
  return {-sinLon,
          cosLon,
          0,
          0,
          -sinLat * cosLon,
          -sinLat * sinLon,
          cosLat,
          0,
          cosLat * cosLon,
          cosLat * sinLon,
          sinLat,
          0,
          out * cosLon,
          out * sinLon,
          (normal * (1 - kEccentricity2) + place.height) * sinLat,
          1};
}

std::string rootTileset(const terrain::Terrain& terrain, const Question& question, std::string_view query) {
  int level = 0;
  while (level < kCoarsest && metres(LeafAddress{level + 1, 0, 0}.side()) <= question.reach) ++level;
  const auto reach = static_cast<Step>(std::ceil(question.reach * lattice::kStepsPerMetre));
  const auto [x, z] = question.middle;
  const LeafAddress low = lattice::leafAt({x - reach, z - reach}, level), high = lattice::leafAt({x + reach - 1, z + reach - 1}, level);
  Json children = Json::array();
  Range all;
  for (LeafAddress at = low; at.i <= high.i; ++at.i)
    for (at.j = low.j; at.j <= high.j; ++at.j) {
      if (!isTile(at)) continue;
      const Range range = Heights(terrain, at, level)[at];
      children.push_back(tileOf(at, range, question.middle));
      children.back()["content"] = contentOf(at, "", level == 0 ? ".glb" : ".json", query);
      all.include({range.low - errorOf(level) - skirtOf(level), range.high + errorOf(level)});
    }
  const double west = metres(low.x() - x), east = metres(high.x() + high.side() - x);
  const double north = metres(low.z() - z), south = metres(high.z() + high.side() - z);
  // The root itself shows nothing: it is always refined while any of it is larger than a few pixels.
  const double error = 2 * question.reach;
  Json root{{"boundingVolume", boxOf((west + east) / 2, -(north + south) / 2, (east - west) / 2, (south - north) / 2, all)},
            {"geometricError", error},
            {"children", std::move(children)}};
  if (question.at) root["transform"] = eastNorthUp(*question.at);
  return written(std::move(root), error);
}

std::string tilesetOf(const terrain::Terrain& terrain, LeafAddress square, std::string_view query) {
  const int last = std::max(0, square.level - kLevels + 1);
  const Heights heights(terrain, square, std::max(0, last - 1));
  Json root = tree(heights, square, last, frameOf(square), query);
  return written(std::move(root), 2 * errorOf(square.level));
}

}  // namespace ridgecast::tileset
