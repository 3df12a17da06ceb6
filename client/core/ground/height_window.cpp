#include "client/core/ground/height_window.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>

#include "common/outcome/contract.h"

namespace ridgecast::core {

using terrain::kTileBits;
using terrain::kTileSide;
using terrain::TileAddress;

namespace {

std::int64_t distance(TileAddress a, TileAddress b) { return std::max(std::abs(a.i - b.i), std::abs(a.j - b.j)); }

}  // namespace

HeightWindow::HeightWindow(std::string name, std::string source, std::uint32_t seed, const terrain::RasterShape& shape, double reach)
    : name_(std::move(name)), source_(std::move(source)), seed_(seed), shape_(shape) {
  const double tile = shape.finest() * lattice::kMetresPerStep * kTileSide;
  tilesFromCentre_ = static_cast<std::int64_t>(std::clamp(std::ceil(reach / tile), 1.0, static_cast<double>(kMaxTilesFromCentre)));
  centre_ = tileOf(at_);
}

TileAddress HeightWindow::tileOf(lattice::Point p) const {
  return {shape_.x.at(p.x).sample >> kTileBits, shape_.z.at(p.z).sample >> kTileBits};
}

void HeightWindow::moveTo(lattice::Point p) {
  at_ = p;
  const TileAddress centre = tileOf(p);
  if (centre == centre_) return;
  centre_ = centre;
  ++version_;
}

std::vector<TileAddress> HeightWindow::take() {
  std::vector<TileAddress> out;
  for (std::int64_t ring = 0; ring <= tilesFromCentre_; ++ring)
    for (std::int64_t j = -ring; j <= ring; ++j)
      for (std::int64_t i = -ring; i <= ring; ++i) {
        const TileAddress a{centre_.i + i, centre_.j + j};
        if (std::max(std::abs(i), std::abs(j)) != ring || !terrain::tileIsValid(shape_, a) || tiles_.contains(a) || pending_.contains(a))
          continue;
        if (pending_.size() >= kMax) return out;
        pending_.insert(a);
        out.push_back(a);
      }
  return out;
}

bool HeightWindow::complete() const {
  for (std::int64_t j = -tilesFromCentre_; j <= tilesFromCentre_; ++j)
    for (std::int64_t i = -tilesFromCentre_; i <= tilesFromCentre_; ++i)
      if (const TileAddress a{centre_.i + i, centre_.j + j}; terrain::tileIsValid(shape_, a) && !tiles_.contains(a)) return false;
  return true;
}

Outcome<void> HeightWindow::put(const wire::HeightTile& tile) {
  if (pending_.erase(tile.address) == 0) return Error{"a tile of heights came that was not requested"};
  auto decoded = terrain::decodeTile(tile.samples);
  if (!decoded) return decoded.error();
  if (!tile.colours.empty() && tile.colours.size() != terrain::kTileColourBytes)
    return Error{"a tile's colours are not as many as its samples"};
  tiles_[tile.address] = std::make_unique<Held>(Held{*decoded, tile.colours});
  ++version_;
  while (tiles_.size() > kMaxTilesHeld)
    tiles_.erase(std::max_element(tiles_.begin(), tiles_.end(), [this](const auto& a, const auto& b) {
      return distance(a.first, centre_) < distance(b.first, centre_);
    }));
  return {};
}

const HeightWindow::Held* HeightWindow::find(TileAddress address) const {
  const auto it = tiles_.find(address);
  return it == tiles_.end() ? nullptr : it->second.get();
}

std::optional<std::array<std::int32_t, 16>> HeightWindow::around(std::int64_t i, std::int64_t j) const {
  std::array<std::int32_t, 16> out;
  for (std::int64_t k = 0; k < 16; ++k) {
    const std::int64_t x = i - 1 + k % 4, z = j - 1 + k / 4;
    const Held* tile = find({x >> kTileBits, z >> kTileBits});
    if (!tile) return std::nullopt;
    out[static_cast<std::size_t>(k)] = tile->samples[static_cast<std::size_t>((z & (kTileSide - 1)) * kTileSide + (x & (kTileSide - 1)))];
  }
  return out;
}

void HeightWindow::heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const {
  expects(x.size() == out.size() && z.size() == out.size(), "each place has an x, a z and room for its height");
  thread_local terrain::CubicPlaces places;
  for (std::size_t begin = 0; begin < out.size(); begin += terrain::CubicPlaces::kMax) {
    const std::size_t count = std::min<std::size_t>(out.size() - begin, terrain::CubicPlaces::kMax);
    std::bitset<terrain::CubicPlaces::kMax> unknown;
    for (std::size_t k = 0; k < count; ++k) {
      const terrain::Between bx = shape_.x.at(x[begin + k]), bz = shape_.z.at(z[begin + k]);
      const auto samples = around(bx.sample, bz.sample);
      unknown[k] = !samples;
      if (samples) places.set(k, *samples, bx.steps(), bz.steps());
    }
    terrain::cubicHeights(places, static_cast<int>(count), shape_.x.inverse(), shape_.z.inverse(), &out[begin]);
    for (std::size_t k = 0; k < count; ++k)
      if (unknown[k]) out[begin + k] = std::numeric_limits<float>::quiet_NaN();
  }
}

void HeightWindow::tile(TileAddress address, terrain::Tile& out) const {
  if (const Held* held = find(address))
    out = held->samples;
  else
    out.fill(0);
}

bool HeightWindow::knows(lattice::Point p) const { return around(shape_.x.at(p.x).sample, shape_.z.at(p.z).sample).has_value(); }

// Tiles that are missing bound it; what the cubic needs beyond a tile is two samples.
double HeightWindow::knownReach() const {
  const auto sampleX = shape_.x.at(at_.x).sample, sampleZ = shape_.z.at(at_.z).sample;
  std::int64_t nearest = (tilesFromCentre_ + 1) * kTileSide;
  for (std::int64_t j = -tilesFromCentre_ - 1; j <= tilesFromCentre_ + 1; ++j)
    for (std::int64_t i = -tilesFromCentre_ - 1; i <= tilesFromCentre_ + 1; ++i) {
      const TileAddress a{centre_.i + i, centre_.j + j};
      if (std::max(std::abs(i), std::abs(j)) <= tilesFromCentre_ && tiles_.contains(a)) continue;
      const auto gap = [](std::int64_t from, std::int64_t first) {
        return std::max({first - from, from - (first + kTileSide - 1), std::int64_t{0}});
      };
      nearest = std::min(nearest, std::max(gap(sampleX, a.i * kTileSide), gap(sampleZ, a.j * kTileSide)));
    }
  return static_cast<double>(std::max<std::int64_t>(nearest - 2, 0)) * shape_.finest() * lattice::kMetresPerStep;
}

}  // namespace ridgecast::core
