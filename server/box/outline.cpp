#include "server/box/outline.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"

namespace ridgecast::box {

using lattice::Step;
using triangulation::Point2;

namespace {

constexpr std::int32_t kSpacing = 32;  // steps between samples where the ground is not steep, at least; and at most 2^15 of them
constexpr std::size_t kPlacesATime = 4096, kLooksATime = 32768;

}  // namespace

Division::Division(const terrain::Terrain& terrain, const Frame& frame, const Side& side)
    : terrain_(terrain), frame_(frame), side_(side), alongX_(side.from.z == side.to.z), limit_(side.error * lattice::kStepsPerMetre) {
  expects((side.from.x == side.to.x) != (side.from.z == side.to.z), "a side runs along x or z");
  const auto [begin, end] = alongX_ ? std::minmax(side.from.x, side.to.x) : std::minmax(side.from.z, side.to.z);
  end_ = end;
  spacing_ = std::max(kSpacing >> frame.unitBits, ((end - begin) >> 15) + 1);
  samples_.push_back({begin, terrain.heightStep(frame.global(place(begin)))});
}

Turns Division::work(std::function<bool()> pauses) {
  while (samples_.back().at < end_) {
    if (pauses()) co_yield 0;
    sample();
  }
  std::vector<std::pair<std::size_t, std::size_t>> pieces{{0, samples_.size() - 1}};  // from one sample to another
  const auto snapped = [this](const Sample& s) { return static_cast<double>(lattice::roundTo(s.height, side_.vertical)); };
  for (std::size_t looks = 0; !pieces.empty();) {
    const auto [from, to] = pieces.back();
    pieces.pop_back();
    const Sample &a = samples_[from], &b = samples_[to];
    double worst = limit_;  // the farthest so far from the line between the ends,
    std::size_t where = 0;  // and which it is; 0: none
    for (std::size_t k = from + 1; k < to; ++k) {
      if (++looks % kLooksATime == 0 && pauses()) co_yield 0;
      const Sample& s = samples_[k];
      const double t = static_cast<double>(s.at - a.at) / static_cast<double>(b.at - a.at);
      const double off = std::abs(snapped(a) + t * (snapped(b) - snapped(a)) - s.height);
      if (off > worst) {
        worst = off;
        where = k;
      }
    }
    if (where == 0) continue;
    points_.push_back(place(samples_[where].at));
    pieces.push_back({from, where});
    pieces.push_back({where, to});
  }
}

// What rises by more than the error from one sample to the next may be a wall anywhere between: halved until it does not.
void Division::sample() {
  wanted_.clear();
  if (rest_.empty()) {
    for (std::int32_t at = samples_.back().at; at < end_ && wanted_.size() < kPlacesATime;)
      wanted_.push_back(at = end_ - at > spacing_ ? at + spacing_ : end_);
    evaluate();
    for (std::size_t k = wanted_.size(); k-- > 0;) rest_.push_back({wanted_[k], heights_[k]});
  } else {
    const std::size_t gaps = std::min(rest_.size(), kPlacesATime), kept = rest_.size() - gaps;
    const std::vector<Sample> ends(rest_.begin() + static_cast<std::ptrdiff_t>(kept), rest_.end());  // the nearest last
    rest_.resize(kept);
    const auto before = [&](std::size_t k) { return k + 1 < gaps ? ends[k + 1] : samples_.back(); };
    for (std::size_t k = 0; k < gaps; ++k)
      if (steep(before(k), ends[k])) wanted_.push_back((before(k).at + ends[k].at) / 2);
    evaluate();
    for (std::size_t k = 0, middle = 0; k < gaps; ++k) {
      rest_.push_back(ends[k]);
      if (!steep(before(k), ends[k])) continue;
      rest_.push_back({wanted_[middle], heights_[middle]});
      ++middle;
    }
  }
  for (; !rest_.empty() && !steep(samples_.back(), rest_.back()); rest_.pop_back()) samples_.push_back(rest_.back());
}

bool Division::steep(const Sample& a, const Sample& b) const { return b.at - a.at > 1 && std::abs(b.height - a.height) > limit_; }

Point2 Division::place(std::int32_t at) const { return alongX_ ? Point2{at, side_.from.z} : Point2{side_.from.x, at}; }

void Division::evaluate() {
  std::vector<Step> x, z;
  for (const std::int32_t at : wanted_) {
    const lattice::Point p = frame_.global(place(at));
    x.push_back(p.x);
    z.push_back(p.z);
  }
  heights_.resize(wanted_.size());
  terrain_.heightSteps(x, z, heights_);
}

}  // namespace ridgecast::box
