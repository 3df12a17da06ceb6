#include "common/ground/bounds.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"

namespace ridgecast::ground {

using lattice::Step;
using terrain::Raster;

namespace {

template <class Value, int kMost>
struct KeptWith final : terrain::Kept {
  Recent<Value> all{kMost};
};
template <class Value, int kMost>
Recent<Value>& keptWith(const terrain::Terrain& terrain) {
  terrain::Kept& kept =
      terrain.kept([](const terrain::Terrain&) -> std::unique_ptr<terrain::Kept> { return std::make_unique<KeptWith<Value, kMost>>(); });
  return static_cast<KeptWith<Value, kMost>&>(kept).all;
}

// A bicubic leaves the range of its samples by at most 9/32 of it (terrain::boundsOf), and its floats are off by less than the rest.
constexpr double kSwing = 0.2875, kRounded = 0.008;
// Its second derivative along an axis: at most 6 ranges a pitch squared, 5/4 of that by the weights across.
constexpr double kCurvature = 7.5;

float up(double v) { return std::nextafter(static_cast<float>(v), 1e9f); }

constexpr std::size_t slotOf(int a, int b, int across) {
  return static_cast<std::size_t>(b) * static_cast<std::size_t>(across) + static_cast<std::size_t>(a);
}

}  // namespace

Reader::Reader(const terrain::Terrain& terrain)
    : ground_(terrain.unedited()),
      edits_(terrain.edits()),
      isMap_(terrain.relief().known == terrain::Relief::Known::kProven),
      highest_(terrain.relief().highest),
      kept_(keptWith<Bounds, kMaxKept>(terrain.unedited())) {
  if (isMap_) {
    finestOfMap_ = ground_.raster()->shape().finest() * lattice::kMetresPerStep;
    while (coarsestWithCorners_ > 0 && 2 * cellMetres(coarsestWithCorners_) > finestOfMap_) --coarsestWithCorners_;
  }
  if (!edits_) return;
  expects(&terrain != &ground_, "who has edits has a ground without them");
  keptRises_.emplace(keptWith<Rises, kMaxKeptRises>(terrain));
  const terrain::RasterShape& shape = edits_->shape();
  highest_ += (shape.highest + kSwing * (static_cast<double>(shape.highest) - shape.lowest)) * lattice::kMetresPerStep;
}

const Bounds& Reader::bounds(const Square& square) {
  return kept_.at(square, [&] {
    Bounds made = isMap_ ? ofMap(square) : ofOctaves(square);
    made.highest = *std::ranges::max_element(made.high);
    return made;
  });
}

Rises Reader::rises(const Square& square) {
  if (!edits_) return {};
  return keptRises_->at(square, [&]() -> Rises {
    const int bits = cellBits(square.level) + kCellsBits;
    const terrain::RasterShape& shape = edits_->shape();
    const std::int64_t x = shape.x.at(square.i << bits).sample - 1, z = shape.z.at(square.j << bits).sample - 1;
    const Raster::Range range =
        edits_->range(x, z, shape.x.at((square.i + 1) << bits).sample + 3 - x, shape.z.at((square.j + 1) << bits).sample + 3 - z);
    if (range.lowest == 0 && range.highest == 0) return {};
    const double swing = kSwing * (static_cast<double>(range.highest) - range.lowest) * lattice::kMetresPerStep + kRounded;
    return {-up(-range.lowest * lattice::kMetresPerStep + swing), up(range.highest * lattice::kMetresPerStep + swing)};
  });
}

Bounds Reader::ofOctaves(const Square& square) {
  // Cells of 16 m and more hide what is in some places only, those of 64 m so much that what lies around the square counts, too.
  const bool isWide = square.level >= 3;
  const int ring = square.level >= 4 ? 1 : 0, across = kCells + 1 + 2 * ring;
  constexpr std::size_t kMost = (kCells + 3) * (kCells + 3);
  const int bits = cellBits(square.level);
  const Step cornerX = (square.i << bits) * kCells, cornerZ = (square.j << bits) * kCells;
  std::array<Step, kMost> x, z;
  std::array<float, kMost> height;
  std::size_t n = 0;
  for (int b = -ring; b <= kCells + ring; ++b)
    for (int a = -ring; a <= kCells + ring; ++a, ++n) x[n] = cornerX + (Step{a} << bits), z[n] = cornerZ + (Step{b} << bits);
  ground_.heights(std::span(x).first(n), std::span(z).first(n), std::span(height).first(n));
  heights_ += n;

  // How much the ground bends: at each height along both axes and both diagonals, where there are others to both sides, and within cells.
  std::array<float, kMost> bend{};
  float most = 0;
  for (int b = 0; b < across; ++b)
    for (int a = 0; a < across; ++a) {
      const std::size_t k = slotOf(a, b, across);
      const float* const h = &height[k];
      const bool isInX = a > 0 && a + 1 < across, isInZ = b > 0 && b + 1 < across;
      const auto around = [&](int step) { bend[k] = std::max(bend[k], std::abs(h[-step] + h[step] - 2 * h[0])); };
      if (isInX) around(1);
      if (isInZ) around(across);
      if (isInX && isInZ) around(across + 1), around(across - 1);
      most = std::max(most, bend[k]);
      if (a + 1 < across && b + 1 < across) most = std::max(most, std::abs(h[0] + h[across + 1] - h[1] - h[across]));
    }
  Bounds out;
  const double side = cellMetres(square.level);
  for (int b = 0; b <= kCells; ++b)
    for (int a = 0; a <= kCells; ++a) {
      const std::size_t k = slotOf(a + ring, b + ring, across), next = k + static_cast<std::size_t>(across);
      out.corner[slotOf(a, b, kCells + 1)] = height[k];
      if (a == kCells || b == kCells) continue;
      const auto greatest = [k, next](const auto& of) { return std::max({of[k], of[k + 1], of[next], of[next + 1]}); };
      const double margin = isWide ? most + 0.05 * side : 0.4 * greatest(bend) + 0.7 * most + 0.02 * side;
      const std::size_t cell = slotOf(a, b, kCells);
      out.high[cell] = up(greatest(height) + margin);
      out.lowered[cell] = out.high[cell];
    }
  return out;
}

Bounds Reader::ofMap(const Square& square) {
  const Raster& map = *ground_.raster();
  const terrain::RasterShape& shape = map.shape();
  const int bits = cellBits(square.level);
  const Step cornerX = (square.i << bits) * kCells, cornerZ = (square.j << bits) * kCells;
  const bool hasCorners = square.level <= coarsestWithCorners_;
  Bounds out;
  if (hasCorners) {
    std::array<Step, (kCells + 1) * (kCells + 1)> x, z;
    for (std::size_t k = 0; k < x.size(); ++k) {
      x[k] = cornerX + (static_cast<Step>(k % (kCells + 1)) << bits);
      z[k] = cornerZ + (static_cast<Step>(k / (kCells + 1)) << bits);
    }
    ground_.heights(x, z, out.corner);
    heights_ += x.size();
  }
  const double side = static_cast<double>(Step{1} << bits);
  const double bent = kCurvature / 8 * (side * side) * (1 / (shape.x.steps() * shape.x.steps()) + 1 / (shape.z.steps() * shape.z.steps()));
  for (int b = 0; b < kCells; ++b)
    for (int a = 0; a < kCells; ++a) {
      const Step x0 = cornerX + (Step{a} << bits), z0 = cornerZ + (Step{b} << bits);
      const std::int64_t x = shape.x.at(x0).sample - 1, z = shape.z.at(z0).sample - 1;
      const Raster::Range range =
          map.range(x, z, shape.x.at(x0 + (Step{1} << bits)).sample + 3 - x, shape.z.at(z0 + (Step{1} << bits)).sample + 3 - z);
      const double low = range.lowest * lattice::kMetresPerStep, high = range.highest * lattice::kMetresPerStep;
      const std::size_t cell = slotOf(a, b, kCells), k = slotOf(a, b, kCells + 1);
      out.high[cell] = up(high + kSwing * (high - low) + kRounded);
      out.lowered[cell] = out.high[cell];
      if (!hasCorners) continue;
      const float corner = std::max({out.corner[k], out.corner[k + 1], out.corner[k + kCells + 1], out.corner[k + kCells + 2]});
      out.high[cell] = up(corner + std::min(bent, 1 + 2 * kSwing) * (high - low) + kRounded);
      out.lowered[cell].lower(out.high[cell]);
    }
  return out;
}

}  // namespace ridgecast::ground
