#pragma once
// The sides of a box, each divided as a line, so that adjoining boxes share it to the bit.

#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include "common/outcome/turns.h"
#include "common/terrain/terrain.h"
#include "server/box/samples.h"

namespace ridgecast::box {

struct Side {
  triangulation::Point2 from, to;  // along x or z
  double error;                    // metres
  int vertical;                    // the spacing of vertices' heights, as a power of two in steps
};

// Finds points between a side's ends such that the terrain along it stays within the error of straight lines between them (Douglas and
// Peucker 1973). They depend only on the two ends, not on their order. One thread at a time.
class Division {
 public:
  Division(const terrain::Terrain& terrain, const Frame& frame, const Side& side);
  // A turn ends where pauses(), called every few thousand heights, returns true.
  Turns work(std::function<bool()> pauses);
  std::vector<triangulation::Point2> take() { return std::move(points_); }  // once work() is done

 private:
  struct Sample {
    std::int32_t at, height;  // units along the side; steps
  };
  void sample();  // some more
  bool steep(const Sample& a, const Sample& b) const;
  triangulation::Point2 place(std::int32_t at) const;
  void evaluate();  // wanted_, into heights_

  const terrain::Terrain& terrain_;
  const Frame frame_;
  const Side side_;
  const bool alongX_;
  const double limit_;  // steps
  std::int32_t end_ = 0, spacing_ = 0;
  std::vector<Sample> samples_, rest_;  // in order; those beyond, the nearest last
  std::vector<std::int32_t> wanted_, heights_;
  std::vector<triangulation::Point2> points_;
};

}  // namespace ridgecast::box
