#include "common/ground/trace.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/ground/walk.h"
#include "common/outcome/contract.h"

namespace ridgecast::ground {

using lattice::Step;

namespace {

constexpr double kLocated = 1.0 / 256;  // metres
constexpr int kParts = 4;               // of an interval that is looked at closely
constexpr int kMostGuesses = 4;         // of where it crosses, before an interval is only divided
constexpr std::size_t kMostSamples = kParts + 1;

struct Sample {
  double t = 0, above = 0;  // metres along the ray, and of it above the ground
};

// The search for the first contact on a stretch: intervals from left to right, those that may hide one in parts. All that it decides
// depends on the stretch and the ground alone.
class Search {
 public:
  void begin(const Stretch& stretch, double until) {
    stretch_ = stretch;
    from_ = {stretch.from, 0};
    isKnown_ = false;
    floor_ = until;
    ends_[0] = {stretch.to, kUnknown};
    depth_ = 1;
    guesses_ = 0;
  }
  // Where the ground is asked next, ascending.
  std::size_t ask(const Walk& walk, std::array<double, kMostSamples>& at) const;
  enum class Result { kMore, kNone, kHit };
  Result take(const Walk& walk, std::span<const Sample> samples);
  double hit() const { return from_.t; }
  double end() const { return stretch_.to; }

 private:
  static constexpr double kUnknown = 1e300;
  static constexpr std::size_t kMostDepth = 24;
  std::size_t askAround(const Walk& walk, double guess, double beside, double slope, double* at) const;
  bool mayHide(const Walk& walk, const Sample& a, const Sample& b) const;

  Stretch stretch_;
  double floor_ = 0;  // above the ground for certain
  Sample from_;       // above the ground; its height only if isKnown_
  bool isKnown_ = false;
  int guesses_ = 0;
  std::array<Sample, kMostDepth> ends_;  // the last one is next
  std::size_t depth_ = 0;
};

// To both sides of a guess where the ray crosses the ground, and as far before it that nothing is hidden in between if it comes down so.
std::size_t Search::askAround(const Walk& walk, double guess, double beside, double slope, double* at) const {
  const double bend = 1.25 * (stretch_.bend / stretch_.side + stretch_.steep);  // a metre
  const double before = (guess - from_.t) * bend / (slope + bend);
  std::size_t n = 0;
  const auto ask = [&](double t) {
    if (t > from_.t && t < ends_[depth_ - 1].t) at[n++] = t;
  };
  if (before > beside && guess - beside - from_.t > walk.spacing(from_.t)) ask(guess - before);
  ask(guess - beside), ask(guess + beside);
  return n;
}

std::size_t Search::ask(const Walk& walk, std::array<double, kMostSamples>& at) const {
  const Sample& end = ends_[depth_ - 1];
  const double length = end.t - from_.t;
  std::size_t n = 0;
  if (!isKnown_) at[n++] = from_.t;
  if (!isKnown_ && depth_ == 1 && stretch_.guess >= 0) {
    if (const std::size_t some =
            askAround(walk, stretch_.guess, std::max(stretch_.bend / stretch_.slope / 4, kLocated / 2), stretch_.slope, &at[n]))
      return n + some;
  } else if (isKnown_ && end.above <= 0 && guesses_ < kMostGuesses) {
    const double slope = (from_.above - end.above) / length;
    if (const std::size_t some =
            askAround(walk, from_.t + from_.above / slope, std::clamp(length / 16, kLocated / 4, kLocated / 2.125), slope, &at[n]))
      return n + some;
  }
  for (int k = 1; k < kParts; ++k) at[n++] = from_.t + length * k / kParts;
  if (end.above == kUnknown) at[n++] = end.t;
  return n;
}

// Whether ground may rise above the ray between two samples above it.
bool Search::mayHide(const Walk& walk, const Sample& a, const Sample& b) const {
  const double length = b.t - a.t;
  if (b.above == kUnknown) return length > kLocated;
  return length > walk.spacing(a.t) &&
         std::min(a.above, b.above) <= stretch_.bend * std::min(1.0, length / stretch_.side) + stretch_.steep * length;
}

Search::Result Search::take(const Walk& walk, std::span<const Sample> samples) {
  if (isKnown_ && ends_[depth_ - 1].above <= 0) ++guesses_;
  // All that is known of the interval, from left to right.
  std::array<Sample, kMostSamples + 2> known;
  std::size_t n = 0;
  if (isKnown_) known[n++] = from_;
  for (const Sample& s : samples) known[n++] = s;
  if (known[n - 1].t < ends_[depth_ - 1].t) known[n++] = ends_[depth_ - 1];
  if (!isKnown_ && known[0].above <= 0) {
    // Below the ground at once: where the ray begins, or where the bounds were wrong.
    if (known[0].t <= floor_) return from_.t = known[0].t, Result::kHit;
    ends_[depth_++] = known[0];
    from_.t = std::max(floor_, known[0].t - stretch_.side);
    return depth_ + 2 < kMostDepth ? Result::kMore : Result::kHit;
  }
  isKnown_ = true;
  ends_[depth_ - 1] = known[n - 1];
  for (std::size_t k = 0; k + 1 < n; ++k) {
    const Sample &a = known[k], &b = known[k + 1];
    const bool crosses = b.above <= 0;
    if (!crosses && !mayHide(walk, a, b)) continue;
    from_ = a;
    if (crosses) {
      if (b.t - a.t <= kLocated) return from_.t += (b.t - a.t) * (a.above / (a.above - b.above)), Result::kHit;
      ends_[0] = b, depth_ = 1;  // there is nothing further
    } else if (k + 2 < n) {
      ends_[depth_++] = b;
    }
    expects(depth_ < kMostDepth, "intervals shrink");
    return Result::kMore;
  }
  // Nothing up to here; on with what comes after.
  from_ = known[n - 1];
  floor_ = from_.t;
  return --depth_ == 0 ? Result::kNone : Result::kMore;
}

}  // namespace

std::uint64_t trace(const terrain::Terrain& terrain, std::span<const Ray> rays, std::span<double> out) {
  expects(rays.size() <= kPacket && out.size() == rays.size(), "rays come by the packet");
  Reader reader(terrain);
  Near near(reader);
  std::array<Walk, kPacket> walks;
  std::array<Search, kPacket> searches;
  std::array<std::uint8_t, kPacket> open;
  std::array<double, kPacket> until{};
  std::array<double, kPacket * kMostSamples> t;
  std::array<Step, kPacket * kMostSamples> x, z;
  std::array<float, kPacket * kMostSamples> height;
  std::array<std::uint8_t, kPacket> count;
  std::uint64_t heights = 0;
  std::size_t n = 0;
  const auto goOn = [&](std::size_t k) {
    Stretch stretch;
    if (!walks[k].next(near, stretch)) return false;
    searches[k].begin(stretch, until[k]);
    return true;
  };
  for (std::size_t k = 0; k < rays.size(); ++k) {
    walks[k] = Walk(rays[k], reader);
    out[k] = kNoHit;
    if (goOn(k)) open[n++] = static_cast<std::uint8_t>(k);
  }
  while (n > 0) {
    std::size_t asked = 0;
    for (std::size_t o = 0; o < n; ++o) {
      const Walk& walk = walks[open[o]];
      std::array<double, kMostSamples> at;
      const std::size_t some = searches[open[o]].ask(walk, at);
      for (std::size_t k = 0; k < some; ++k, ++asked) {
        const lattice::Point place = walk.at(at[k]);
        t[asked] = at[k], x[asked] = place.x, z[asked] = place.z;
      }
      count[o] = static_cast<std::uint8_t>(some);
    }
    terrain.heights(std::span(x).first(asked), std::span(z).first(asked), std::span(height).first(asked));
    heights += asked;
    std::size_t left = 0, first = 0;
    for (std::size_t o = 0; o < n; ++o) {
      const std::size_t k = open[o];
      std::array<Sample, kMostSamples> samples;
      for (std::size_t s = 0; s < count[o]; ++s) samples[s] = {t[first + s], walks[k].above(t[first + s], height[first + s])};
      const auto result = searches[k].take(walks[k], std::span(samples).first(count[o]));
      first += count[o];
      if (result == Search::Result::kHit) out[k] = searches[k].hit();
      if (result == Search::Result::kNone) until[k] = searches[k].end();
      if (result == Search::Result::kMore || (result == Search::Result::kNone && goOn(k))) open[left++] = static_cast<std::uint8_t>(k);
    }
    n = left;
  }
  return heights + reader.heights();
}

}  // namespace ridgecast::ground
