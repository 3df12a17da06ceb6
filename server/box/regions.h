#pragma once
// The working squares of a box's mesh, and which of them may be processed concurrently: work on one may also write its eight neighbours.

#include <array>
#include <cstddef>
#include <vector>

#include "common/triangulation/triangulation.h"

namespace ridgecast::box {

class Regions final : public triangulation::Partition {
 public:
  Regions(triangulation::Point2 low, triangulation::Point2 high);
  void addTo(triangulation::Triangulation& mesh);

  triangulation::RegionId regionAt(triangulation::Point2 p) const override;
  std::size_t size() const { return ids_.size(); }
  triangulation::RegionId operator[](std::size_t k) const { return ids_[k]; }
  std::vector<triangulation::RegionId>::const_iterator begin() const { return ids_.begin(); }
  std::vector<triangulation::RegionId>::const_iterator end() const { return ids_.end(); }
  // Those of one colour, by index: no two of them have a neighbour in common.
  static constexpr std::size_t kColours = 9;
  const std::vector<std::size_t>& colour(std::size_t k) const { return colours_[k]; }
  std::vector<triangulation::Point2> corners(triangulation::Point2 low, triangulation::Point2 high) const;  // strictly inside
  // A region and its neighbours.
  void around(std::size_t k, std::vector<triangulation::RegionId>& out) const;

 private:
  int bits_;
  triangulation::Point2 first_;  // in regions
  std::int32_t across_, down_;
  std::vector<triangulation::RegionId> ids_;
  std::array<std::vector<std::size_t>, kColours> colours_;
};

}  // namespace ridgecast::box
