#include "common/raster/detail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/raster/raster_file.h"
#include "common/raster/raster_terrain.h"
#include "common/terrain/terrain.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using terrain::CubicPlaces;

constexpr std::uint32_t kParts = 8;  // by default, or the next smaller number that divides the pitch
constexpr std::uint32_t kSeed = 1;

// 0: none fits. A pitch of whole steps is divided into such.
std::uint32_t partsOf(const Detail& detail, const terrain::RasterShape& shape) {
  const auto divides = [](terrain::Pitch pitch, std::uint32_t parts) {
    const bool isWhole = pitch % terrain::pitchOf(1) == 0;
    return pitch / parts >= terrain::kMinPitch && (!isWhole || pitch % (terrain::pitchOf(1) * parts) == 0);
  };
  const auto fits = [&](std::uint32_t parts) { return divides(shape.x.pitch, parts) && divides(shape.z.pitch, parts); };
  if (detail.parts > 0) return fits(detail.parts) ? detail.parts : 0;
  for (std::uint32_t parts = kParts; parts >= 2; --parts)
    if (fits(parts)) return parts;
  return 0;
}

// Four rows of heights in steps around a row of the map's cells: one sample before the map's first and two behind its last.
class FourRows {
 public:
  explicit FourRows(std::uint32_t width) {
    for (auto& row : rows_) row.resize(std::size_t{width} + 3);
  }
  // `fill(row, heights)` for rows z - 1 to z + 2 that are not there from the last call.
  template <class Fill>
  void moveTo(std::int64_t z, const Fill& fill) {
    const bool next = z == at_ + 1;
    if (next) std::rotate(rows_.begin(), rows_.begin() + 1, rows_.end());
    for (std::size_t k = next ? 3 : 0; k < 4; ++k) fill(z - 1 + static_cast<std::int64_t>(k), std::span(rows_[k]));
    at_ = z;
  }
  void around(std::size_t cell, std::array<std::int32_t, 16>& out) const {
    for (std::size_t k = 0; k < 16; ++k) out[k] = rows_[k / 4][cell + k % 4];
  }

 private:
  std::array<std::vector<std::int32_t>, 4> rows_;
  std::int64_t at_ = -10;
};

class Refinement {
 public:
  Refinement(const Samples& map, const terrain::RasterShape& coarse, const terrain::RasterShape& fine, std::uint32_t parts,
             const RasterOptions& options, std::shared_ptr<const terrain::Terrain> terrain)
      : map_(map),
        coarse_(coarse),
        fine_(fine),
        parts_(parts),
        edge_(options.edge),
        constant_(static_cast<std::int32_t>(std::llround(options.constant * lattice::kStepsPerMetre))),
        factor_(options.detail->factor),
        terrain_(std::move(terrain)),
        own_(map.width()),
        carried_(map.width()) {}

  // A row of the result, rows in ascending order. False: a height is beyond the limits.
  bool row(std::uint32_t z, std::span<std::int32_t> out) {
    const std::int64_t cell = z / parts_;
    if (cell != cell_) {
      own_.moveTo(cell, [this](std::int64_t j, std::span<std::int32_t> heights) { rowOfMap(j, heights); });
      carried_.moveTo(cell,
                      [this](std::int64_t j, std::span<std::int32_t> heights) { heightsAlong(-1, coarse_.x, coarse_.z.of(j), heights); });
      cell_ = cell;
    }
    heightsAlong(0, fine_.x, fine_.z.of(z), out);
    const float beyondZ = beyond(z % parts_, fine_.z);
    std::array<float, CubicPlaces::kMax> own, carried;
    bool fits = true;
    for (std::size_t begin = 0; begin < out.size(); begin += CubicPlaces::kMax) {
      const std::size_t count = std::min(out.size() - begin, CubicPlaces::kMax);
      between(own_, begin, count, beyondZ, own.data());
      between(carried_, begin, count, beyondZ, carried.data());
      for (std::size_t k = 0; k < count; ++k) {
        const double detail = out[begin + k] - double{carried[k]} * lattice::kStepsPerMetre;
        const double steps = std::floor(double{own[k]} * lattice::kStepsPerMetre + factor_ * detail + 0.5);
        fits &= std::abs(steps) <= terrain::kMaxSample;
        out[begin + k] = static_cast<std::int32_t>(std::clamp<double>(steps, -terrain::kMaxSample, terrain::kMaxSample));
      }
    }
    return fits;
  }

 private:
  void rowOfMap(std::int64_t j, std::span<std::int32_t> heights) const {
    const auto z = folded(j, map_.height(), edge_);
    for (std::size_t k = 0; k < heights.size(); ++k) {
      const auto x = folded(static_cast<std::int64_t>(k) - 1, map_.width(), edge_);
      heights[k] = x && z ? map_.at(*x, *z) : constant_;
    }
  }
  // The terrain's, from the map's sample `first` on.
  void heightsAlong(std::int64_t first, const terrain::RasterAxis& axis, Step z, std::span<std::int32_t> heights) {
    const auto onLattice = [](Step v) { return std::clamp(v, -lattice::kMaxPosition, lattice::kMaxPosition); };
    x_.resize(heights.size());
    for (std::size_t k = 0; k < heights.size(); ++k) x_[k] = onLattice(axis.of(first + static_cast<std::int64_t>(k)));
    z_.assign(heights.size(), onLattice(z));
    terrain_->heightSteps(x_, z_, heights);
  }
  static float beyond(std::size_t part, const terrain::RasterAxis& fine) { return terrain::Between{0, part * fine.pitch}.steps(); }
  void between(const FourRows& rows, std::size_t begin, std::size_t count, float beyondZ, float* out) {
    std::array<std::int32_t, 16> around;
    for (std::size_t k = 0; k < count; ++k) {
      rows.around((begin + k) / parts_, around);
      places_.set(k, around, beyond((begin + k) % parts_, fine_.x), beyondZ);
    }
    terrain::cubicHeights(places_, static_cast<int>(count), coarse_.x.inverse(), coarse_.z.inverse(), out);
  }

  const Samples& map_;
  const terrain::RasterShape &coarse_, &fine_;
  const std::uint32_t parts_;
  const Edge edge_;
  const std::int32_t constant_;
  const double factor_;
  const std::shared_ptr<const terrain::Terrain> terrain_;
  FourRows own_, carried_;  // the map's heights, and the terrain's at its samples
  std::int64_t cell_ = -1;
  std::vector<Step> x_, z_;
  CubicPlaces places_;
};

}  // namespace

Outcome<Detailed> withDetail(const std::string& name, const Samples& map, const terrain::RasterShape& shape, const RasterOptions& options,
                             std::uint64_t inMemory, std::uint64_t total) {
  expects(options.detail.has_value(), "detail is asked for");
  expects(shape.width == map.width() && shape.height == map.height(), "a map has its shape");
  const Detail& detail = *options.detail;
  const std::uint32_t parts = partsOf(detail, shape);
  if (parts == 0)
    return Error{name + ": its samples are " + text::rounded(shape.finest(), 6) + " steps of 1/256 m apart, which " +
                 (detail.parts > 0 ? std::to_string(detail.parts) : "2 to 8") +
                 " parts of at least 16 whole steps do not make up: say another number of parts (detail=" + detail.terrain + ":" +
                 text::rounded(detail.factor, 6) + ":PARTS), or another --raster pitch="};
  terrain::RasterShape fine = shape, coarse = shape;
  fine.x.pitch /= parts;
  fine.z.pitch /= parts;
  coarse.x.pitch = fine.x.pitch * parts;
  coarse.z.pitch = fine.z.pitch * parts;
  // A map that is repeated has ground between its last column and its first.
  const auto refined = [&](std::uint32_t n) {
    return options.edge == Edge::kRepeat ? std::uint64_t{n} * parts : std::uint64_t{n - 1} * parts + 1;
  };
  const std::uint64_t width = refined(shape.width), height = refined(shape.height),
                      most = std::min(kMaxSamples, total / sizeof(std::int32_t));
  if (width > most || height > most / width)
    return Error{name + ": with detail it has " + std::to_string(width) + " x " + std::to_string(height) + " samples, more than the " +
                 std::to_string(most) + " that there is room for: say fewer parts (detail=" + detail.terrain + ":" +
                 text::rounded(detail.factor, 6) + ":2)"};
  fine.width = static_cast<std::uint32_t>(width);
  fine.height = static_cast<std::uint32_t>(height);
  auto samples = Samples::create(fine.width, fine.height, inMemory);
  if (!samples) return Error{name + ": " + samples.error().message};
  auto terrain = terrain::create(detail.terrain, kSeed);
  if (!terrain) return terrain.error();
  Refinement refinement(map, coarse, fine, parts, options, *terrain);
  for (std::uint32_t z = 0; z < fine.height; ++z)
    if (!refinement.row(z, samples->row(z)))
      return Error{name + ": with detail it has heights beyond 32,768 m: correct --raster scale=, offset= or detail="};
  return Detailed{std::move(*samples), fine};
}

}  // namespace ridgecast::raster
