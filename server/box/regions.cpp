#include "server/box/regions.h"

#include <algorithm>
#include <bit>
#include <cstdint>

#include "common/outcome/contract.h"

namespace ridgecast::box {

using triangulation::Point2;
using triangulation::RegionId;

namespace {

constexpr std::int32_t kAcross = 16;  // along the longer side, about
constexpr int kMinBits = 8;

}  // namespace

Regions::Regions(Point2 low, Point2 high)
    : bits_(std::max(kMinBits, static_cast<int>(
                                   std::bit_width(static_cast<std::uint32_t>((std::max(high.x - low.x, high.z - low.z) - 1) / kAcross))))),
      first_{low.x >> bits_, low.z >> bits_},
      across_((high.x >> bits_) - first_.x + 1),
      down_((high.z >> bits_) - first_.z + 1) {}

void Regions::addTo(triangulation::Triangulation& mesh) {
  expects(ids_.empty(), "regions are those of one mesh");
  for (std::int32_t j = 0; j < down_; ++j)
    for (std::int32_t i = 0; i < across_; ++i) {
      colours_[static_cast<std::size_t>(i % 3 + j % 3 * 3)].push_back(ids_.size());
      ids_.push_back(mesh.addRegion({(first_.x + i) << bits_, (first_.z + j) << bits_, 1 << bits_}));
    }
}

RegionId Regions::regionAt(Point2 p) const {
  const std::int32_t i = (p.x >> bits_) - first_.x, j = (p.z >> bits_) - first_.z;
  return i < 0 || j < 0 || i >= across_ || j >= down_ ? triangulation::kOutside
                                                      : ids_[static_cast<std::size_t>(std::int64_t{j} * across_ + i)];
}

std::vector<Point2> Regions::corners(Point2 low, Point2 high) const {
  std::vector<Point2> out;
  const std::int32_t side = 1 << bits_;
  for (std::int32_t x = first_.x * side; x < high.x; x += side)
    for (std::int32_t z = first_.z * side; z < high.z; z += side)
      if (x > low.x && z > low.z) out.push_back({x, z});
  return out;
}

void Regions::around(std::size_t k, std::vector<RegionId>& out) const {
  expects(k < ids_.size(), "a region that has neighbours is there");
  const auto i = static_cast<std::int32_t>(k) % across_, j = static_cast<std::int32_t>(k) / across_;
  out.clear();
  for (std::int32_t b = std::max(j - 1, 0); b <= std::min(j + 1, down_ - 1); ++b)
    for (std::int32_t a = std::max(i - 1, 0); a <= std::min(i + 1, across_ - 1); ++a)
      out.push_back(ids_[static_cast<std::size_t>(b) * static_cast<std::size_t>(across_) + static_cast<std::size_t>(a)]);
}

}  // namespace ridgecast::box
