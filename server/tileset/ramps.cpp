#include "server/tileset/ramps.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"

namespace ridgecast::tileset {

using lattice::Step;

Ramps::Ramps(const terrain::Terrain& terrain, lattice::LeafAddress square) : terrain_(terrain), square_(square) {
  const int shift = square.sideBits() - kHeightBits;
  expects(shift >= 0, "the heights along a square's side lie on the lattice");
  std::vector<Step> x, z;
  for (Step j = 0; j <= kHeights; ++j)
    for (Step i = 0; i <= kHeights; ++i) {
      x.push_back(square.x() + (i << shift));
      z.push_back(square.z() + (j << shift));
    }
  height_.resize(x.size());
  terrain.heights(x, z, height_);
}

bool Ramps::widen() {
  if (bits_ == kHeightBits) return false;
  ++bits_;
  return true;
}

double Ramps::width() const { return std::ldexp(lattice::kMetresPerStep, square_.sideBits() - kHeightBits + bits_); }

double Ramps::between(std::int32_t i, std::int32_t j, double u, double v) const {
  const std::int32_t cell = 1 << bits_;
  const double north = at(i, j) + u * (at(i + cell, j) - at(i, j));
  const double south = at(i, j + cell) + u * (at(i + cell, j + cell) - at(i, j + cell));
  return north + v * (south - north);
}

void Ramps::heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const {
  expects(x.size() == out.size() && z.size() == out.size(), "each place gets its height");
  const int shift = square_.sideBits() - kHeightBits + bits_;
  const auto last = (kHeights >> bits_) - 1;
  const double perCell = std::ldexp(1.0, -shift);
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double u = std::clamp(static_cast<double>(x[k] - square_.x()) * perCell, 0.0, last + 1.0);
    const double v = std::clamp(static_cast<double>(z[k] - square_.z()) * perCell, 0.0, last + 1.0);
    const auto i = std::min(static_cast<std::int32_t>(u), last), j = std::min(static_cast<std::int32_t>(v), last);
    out[k] = static_cast<float>(between(i << bits_, j << bits_, u - i, v - j));
  }
}

double Ramps::apartFrom(lattice::Point low, lattice::Point high, double apart) const {
  expects(low.x <= high.x && low.z <= high.z, "a part of a square begins before it ends");
  const std::int32_t cell = 1 << bits_;
  const int shift = square_.sideBits() - kHeightBits;
  const auto first = [&](Step v) { return static_cast<std::int32_t>(std::clamp<Step>((v >> shift) & -cell, 0, kHeights)); };
  const auto last = [&](Step v) { return static_cast<std::int32_t>(std::clamp<Step>(v >> shift, 0, kHeights - 1)); };
  double most = 0;
  for (std::int32_t j = first(low.z - square_.z()); j <= last(high.z - square_.z()); j += cell)
    for (std::int32_t i = first(low.x - square_.x()); i <= last(high.x - square_.x()); i += cell) {
      double off = 0;
      float lowest = at(i, j), highest = lowest;
      for (std::int32_t b = 0; b <= cell; ++b)
        for (std::int32_t a = 0; a <= cell; ++a) {
          const float h = at(i + a, j + b);
          off = std::max(off, std::abs(h - between(i, j, static_cast<double>(a) / cell, static_cast<double>(b) / cell)));
          lowest = std::min(lowest, h);
          highest = std::max(highest, h);
        }
      most = std::max(most, off <= apart ? off : static_cast<double>(highest) - lowest);
    }
  return most;
}

}  // namespace ridgecast::tileset
